"""Noise in the gradient of an image, and the image with that noise filtered out (docs/method.md, equations 4.5 and
4.6).

The sums of a correlation are weighted by the gradient of the reference image. Its noise adds ``sigma^2 g`` to the mean
square of each component, where g is the gain of the differentiated spline after the low-pass, and holds no information
on the motion. The Wiener filter (N. Wiener, Extrapolation, Interpolation, and Smoothing of Stationary Time Series,
1949) is the linear filter whose image is nearest to the pattern in the mean square, wave by wave. The part that it
removes is orthogonal to the part that it keeps, so that the mean product of its gradient with that of the pattern is
the mean square of its gradient. A matrix M made of it has the right size: so have steps and error bars.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import scipy

from idic.images.interpolate import prefilter
from idic.images.gaussian_lowpass import lowpass_weights

SAMPLE_PX, RIM_PX = 256, 16  # side of the simulated noise, and its rim that is left out
TAPER_PX = 16.0  # along the edges of the specimen, which would add to the spectrum
N_BINS = 48  # of wave numbers up to the corner, sqrt(2) pi
MIN_FINE_WAVE = 0.8  # of pi rad/px: waves above hold noise and hardly any pattern
MIN_BLUR_GAIN = 0.01  # of the noise power that the low-pass leaves; less cannot be measured


def gradient_noise_share(fx: np.ndarray, fy: np.ndarray, noise_std: float, degree: int,
                         lowpass_px: float = 0.0) -> float:
    """Mean square of the noise in a gradient over that of the pattern; infinite where all of it is noise.

    Parameters
    ----------
    fx, fy : arrays (n_pixels,)
        Gradient of the spline of `degree` through the image blurred by `lowpass_px` (GV/px).
    noise_std : float
        Of a pixel before the blur (GV).
    """
    noise_power = 2.0 * noise_std**2 * slope_gain(degree, lowpass_px)
    total_power = float(np.mean(np.square(fx, dtype=float)) + np.mean(np.square(fy, dtype=float)))
    return noise_power / (total_power - noise_power) if total_power > noise_power else np.inf


@lru_cache(maxsize=8)
def slope_gain(degree: int, lowpass_px: float) -> float:
    """Variance of a component of the spline's gradient at a pixel / variance of the pixels' white noise (1/px^2)."""
    noise = np.random.default_rng(0).standard_normal((SAMPLE_PX, SAMPLE_PX)).astype(np.float32)
    iy, ix = (part.ravel().astype(np.int32) for part in np.mgrid[RIM_PX:SAMPLE_PX - RIM_PX, RIM_PX:SAMPLE_PX - RIM_PX])
    gx, gy = prefilter(noise, degree, lowpass_px).gradient_at_pixels(ix, iy)
    return float(0.5 * (np.var(gx, dtype=float) + np.var(gy, dtype=float)))


def without_noise(image: np.ndarray, region: np.ndarray, noise_std: float,
                  lowpass_px: float = 0.0) -> tuple[np.ndarray, float]:
    """The image through a Wiener filter, the same in all directions.

    Parameters
    ----------
    image : array (ny, nx)
        Blurred by `lowpass_px` already.
    region : array (ny, nx), bool
        Where the specimen is: its spectrum is that of the pattern.
    noise_std : float
        Of a pixel before the blur (GV), as it was stated or measured.

    Returns
    -------
    image : array (ny, nx)
    noise_std : float
        As given, or less where the finest waves of the image have less power (rendered images).
    """
    wave, power, blur = radial_spectrum(image, region, lowpass_px)
    finest = (wave > MIN_FINE_WAVE * np.pi) & (wave <= np.pi) & (blur > MIN_BLUR_GAIN)
    variance = min(noise_std**2, float(np.mean(power[finest] / blur[finest]))) if finest.any() else noise_std**2
    signal_share = np.clip(1.0 - variance * blur / np.maximum(power, np.finfo(float).tiny), 0.0, 1.0)
    ny, nx = image.shape
    rows, columns = np.pi * np.arange(ny) / ny, np.pi * np.arange(nx) / nx
    gain = np.interp(np.hypot(rows[:, None], columns[None, :]), wave, signal_share)
    coefficients = scipy.fft.dctn(np.asarray(image, dtype=float), workers=1)
    return scipy.fft.idctn(gain * coefficients, workers=1), float(np.sqrt(variance))


def radial_spectrum(image: np.ndarray, region: np.ndarray,
                    lowpass_px: float = 0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Wave numbers (rad/px), mean power (GV^2), and the part of white noise that the blur leaves there  # three (n,)

    The power of white noise is its variance at every wave.
    """
    rows, columns = (np.flatnonzero(region.any(axis=axis)) for axis in (1, 0))
    box = (slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1))
    inside = np.pad(region[box], 1)  # the border of the box is an edge, too
    distance = scipy.ndimage.distance_transform_edt(inside)[1:-1, 1:-1]
    window = np.sin(0.5 * np.pi * np.minimum(distance / TAPER_PX, 1.0)) ** 2
    grey = np.asarray(image[box], dtype=float)
    level = float((window * grey).sum() / window.sum())
    power = np.abs(scipy.fft.fft2(window * (grey - level), workers=1)) ** 2 / (window**2).sum()
    down, along = (2.0 * np.pi * scipy.fft.fftfreq(n) for n in power.shape)
    length = np.hypot(down[:, None], along[None, :])
    blur = _blur_gain(down, lowpass_px)[:, None] * _blur_gain(along, lowpass_px)[None, :]
    place = np.minimum((length * N_BINS / (np.sqrt(2.0) * np.pi)).astype(int), N_BINS - 1).ravel()
    number = np.bincount(place, minlength=N_BINS)
    filled = number > 0
    wave, power, blur = (np.bincount(place, values.ravel(), minlength=N_BINS)[filled] / number[filled]
                         for values in (length, power, blur))
    return wave, power, blur


def _blur_gain(wave: np.ndarray, lowpass_px: float) -> np.ndarray:
    """What the blur along one direction leaves of the power of white noise  # (n,) rad/px -> (n,)"""
    weights = np.array(lowpass_weights(lowpass_px))
    reach = np.arange(len(weights)) - len(weights) // 2
    return (np.cos(wave[:, None] * reach) @ weights) ** 2
