"""A slight Gaussian low-pass of every image before correlation: it reduces aliasing, which no interpolator can undo.

Speckle finer than the pixels makes f - g(x + u) differ by more than noise at every sub-pixel shift. Blurring both by
0.6 px takes most of that away (a rendered plate with a hole, true motion, quintic spline: residual variance 1.09 ->
1.06 of the camera noise; 1.02 at 0.8 px), for 1 to 4 % in standard deviation (3 to 9 % at 0.8 px). The remaining
noise is correlated between neighbours; `noise_share` is the part of it in a sum against the gradient
(docs/method.md, equation 6.4).
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import scipy

REACH_STDS = 4.0  # standard deviations; beyond, the weights are below 1e-4 of the middle one

SECOND_DERIVATIVE = np.array([-1.0, 16.0, -30.0, 16.0, -1.0]) / 12.0  # fourth order


@lru_cache(maxsize=16)
def lowpass_weights(std_px: float) -> tuple[float, ...]:
    """1D Gaussian weights, their sum is 1  # (2 r + 1,)"""
    if std_px <= 0:
        return (1.0,)
    radius = max(1, int(np.ceil(REACH_STDS * std_px)))
    weights = np.exp(-0.5 * (np.arange(-radius, radius + 1) / std_px) ** 2)
    return tuple(weights / weights.sum())


def lowpass(image: np.ndarray, std_px: float) -> np.ndarray:
    """The image blurred by a Gaussian of this standard deviation (px); unchanged for 0  # (ny, nx)"""
    if std_px <= 0:
        return image
    weights = np.array(lowpass_weights(std_px), dtype=np.float32)
    rows = scipy.ndimage.correlate1d(np.asarray(image, dtype=np.float32), weights, axis=1, mode="mirror")
    return scipy.ndimage.correlate1d(rows, weights, axis=0, mode="mirror")


def mirrored_rim_px(std_px: float) -> int:
    """Pixels along the borders of an image that its mirror image has a part in after the low-pass; 0 without it.

    The reach of the weights and one more, where the spline still bends with the mirror.
    """
    return len(lowpass_weights(std_px)) // 2 + 1 if std_px > 0 else 0


def still_gain(std_px: float) -> float:
    """Variance of a blurred pixel / variance of a pixel (independent noise)."""
    return float(np.sum(np.square(lowpass_weights(std_px)))) ** 2


def noise_share(fx: np.ndarray, fy: np.ndarray, std_px: float) -> float:
    """Variance of sum(grad f · blurred noise) / variance of the same sum with noise of the pixels' own variance.

    fx, fy : (ny, nx) gradient of the blurred image. The blur acts on the gradient once more; 1 without it.
    """
    if std_px <= 0:
        return 1.0
    power = float(np.sum(fx**2, dtype=float) + np.sum(fy**2, dtype=float))
    twice_blurred_power = sum(float(np.sum(lowpass(part, std_px) ** 2, dtype=float)) for part in (fx, fy))
    return twice_blurred_power / power


def blur_column(image: np.ndarray) -> np.ndarray:
    """-laplace / 2 of an image: the change by a further blur of variance w, per w (1/px²)  # (ny, nx)

    docs/method.md, equation 1.4.
    """
    image = np.asarray(image, dtype=float)
    return -0.5 * sum(scipy.ndimage.correlate1d(image, SECOND_DERIVATIVE, axis=axis, mode="mirror") for axis in (0, 1))
