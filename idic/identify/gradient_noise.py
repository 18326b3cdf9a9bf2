"""Noise in the gradient of the reference image: it enters M and tells nothing of the motion.

The sums weigh by the gradient of the reference image. Its noise adds ``sigma^2 g`` to the mean square of each component, g
being what differentiating the spline (after the low-pass) makes of white noise. With s = that over the pattern's own
share, and for what images alone determine: M is 1 + s times too large, so that the stated standard deviation is
sqrt(1 + s) too small; the variance of b grows as M does, so that the true one is sqrt(1 + s) above the bound of Cramer and Rao.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from idic.correlation.comparison import DEGREE
from idic.correlation.rows import build_reference
from idic.experiment import Experiment
from idic.images.interpolate import gradient_at_pixels, prefilter

COUNTS = 0.1  # of the pattern's share: error bars are a tenth too small together with the scatter
SIDE, RIM = 256, 16  # px


def gradient_noise(experiment: Experiment) -> float:
    """Mean square of the noise in the reference image's gradient over that of the pattern, where the mesh is seen.

    0 where it is not known (heights, images whose noise nobody stated or measured), infinite where all is noise. Where
    even the whole image has gradient enough, with the background that hardly has any, that is the answer.
    """
    noise = experiment.noise.std_gv
    if experiment.stack is None or experiment.quantity != "grey" or not noise:
        return 0.0
    options = experiment.options
    degree = DEGREE[options.interpolation]
    own = 2.0 * noise**2 / experiment.n_references * slope_gain(degree, options.lowpass_px)
    image = experiment.stack.frame(experiment.reference)
    iy, ix = (part.ravel() for part in np.indices(image.shape, dtype=np.int32))
    share = _share(own, *gradient_at_pixels(prefilter(image, degree, options.lowpass_px), ix, iy))
    if share <= COUNTS:
        return share
    reference = build_reference(experiment, experiment.camera)
    return _share(own, reference.fx, reference.fy)


def _share(own: float, fx: np.ndarray, fy: np.ndarray) -> float:
    whole = float(np.mean(np.square(fx, dtype=float)) + np.mean(np.square(fy, dtype=float)))
    return own / (whole - own) if whole > own else np.inf


def gradient_notes(experiment: Experiment) -> list[str]:
    """What is to be said of error bars where the gradient is noisy."""
    share = gradient_noise(experiment)
    if share <= COUNTS:
        return []
    if not np.isfinite(share):
        return ["the gradient of the reference image is all noise: there is no pattern to follow, and the error bars mean "
                "nothing"]
    return [f"noise is {100.0 * share / (1.0 + share):.0f} % of the mean square of the reference image's gradient: what the "
            f"images alone determine scatters up to {1.0 + share:.2g} times as much as its error bar says (lowpass_px under "
            "[options], or more reference images, make that small)"]


@lru_cache(maxsize=8)
def slope_gain(degree: int, lowpass_px: float) -> float:
    """Variance of a component of the spline's gradient at a pixel / variance of the pixels' white noise (1/px^2)."""
    noise = np.random.default_rng(0).standard_normal((SIDE, SIDE)).astype(np.float32)
    iy, ix = (part.ravel().astype(np.int32) for part in np.mgrid[RIM:SIDE - RIM, RIM:SIDE - RIM])
    gx, gy = gradient_at_pixels(prefilter(noise, degree, lowpass_px), ix, iy)
    return float(0.5 * (np.var(gx, dtype=float) + np.var(gy, dtype=float)))
