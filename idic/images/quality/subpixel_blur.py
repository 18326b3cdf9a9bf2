"""How much more blurred a frame looks where its pattern lies between the pixels, from the reference image alone.

A pattern with detail near two pixels is not what its pixels say: the spline loses a part of its finest waves at every
position but whole pixels, and waves beyond the pixels' reach appear as coarser ones that do not move with the
specimen. Both take from the frame, at a motion of u px, what a blur of variance

    w(u) = A_x sin²(pi u_x) + A_y sin²(pi u_y)

takes. Of a wave of k periods per pixel along an axis, whose share rho(k) is of waves beyond, a motion by half a pixel
loses

    e(k) = 2 (1 - rho) K(k - 1) + 2 rho K(k),       K(k) = sinc(k)^(n+1) / sum_m sinc(k + m)^(n+1)

with K the transfer function of the interpolating spline of degree n (Unser 1999, doi:10.1109/79.799930). A is the
slope of e against half the squared wave number, weighed by the power spectrum of the image, in which its noise loses
nothing; gain and offset of a frame take the mean. rho supposes that the spectrum of the surface falls exponentially, at
the rate of its upper half, and passes the area of a pixel; what is beyond is no stronger than what is just within
reach.
"""

from __future__ import annotations

import numpy as np
import scipy

from idic.images.gaussian_lowpass import SECOND_DERIVATIVE, lowpass_weights

TAPER_PX = 8.0  # from the edge of the region to its full weight: its own waves are longer
N_BANDS = 8  # of wave numbers from 0 to 1/2 per pixel
MAX_DECAY_PX = 60.0  # of the spectrum, exp(-decay k): nothing is beyond the pixels' reach
N_POINTS = 33  # of a mean over a quarter of the reach
N_ALIASES = 4  # of the spline's transfer function, to both sides: the next is below 1e-6


def subpixel_blur(image: np.ndarray, region: np.ndarray, degree: int, lowpass_px: float,
                  noise_gv2: float = 0.0, correlation: np.ndarray | None = None) -> np.ndarray:
    """Variances A by which frames look blurred at a motion of half a pixel along the columns and along the rows.

    Parameters
    ----------
    image : (ny, nx) GV, before the low-pass
    region : (ny, nx) bool, pixels of the specimen
    degree : of the spline, 3 or 5
    noise_gv2 : variance of the noise of a pixel (GV²)
    correlation : (2 L + 1, 2 L + 1) of the noise of pixels so many rows and columns apart; None: independent

    Returns
    -------
    array (2,), px², not negative
    """
    power, along = _spectrum(image, region)
    noise = noise_gv2 if correlation is None else noise_gv2 * _noise_spectrum(correlation, along)
    surface = power - noise
    passed = [_symbol(np.array(lowpass_weights(lowpass_px)), k) ** 2 for k in along]
    passband = np.outer(passed[1], passed[0])
    passband[0, 0] = 0.0
    curvature = -0.5 * (_symbol(SECOND_DERIVATIVE, along[1])[:, None] + _symbol(SECOND_DERIVATIVE, along[0]))
    curvature -= (power * passband * curvature).sum() / (power * passband).sum()
    spread = float((power * passband * curvature**2).sum())  # the column of a blur has the noise of the image, too
    slope = surface * passband * curvature
    variances = [float(slope.sum(axis=axis) @ _lost(np.abs(k), surface.sum(axis=axis), degree))
                 for axis, k in enumerate(along)]
    return np.maximum(variances, 0.0) / spread


def _spectrum(image: np.ndarray, region: np.ndarray) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray]]:
    """Power of the image in the region (GV²), and wave numbers along columns and rows (1/px)."""
    distance = scipy.ndimage.distance_transform_edt(np.pad(region, 1))[1:-1, 1:-1]
    weight = np.sin(0.5 * np.pi * np.minimum(distance / TAPER_PX, 1.0)) ** 2
    values = np.where(region, image, 0.0)
    values = (values - (weight * values).sum() / weight.sum()) * weight
    shape = tuple(scipy.fft.next_fast_len(n) for n in values.shape)
    power = np.abs(scipy.fft.fft2(values, shape)) ** 2 / (weight**2).sum()
    return power, (np.fft.fftfreq(shape[1]), np.fft.fftfreq(shape[0]))


def _symbol(weights: np.ndarray, k: np.ndarray) -> np.ndarray:
    """Transfer function of symmetric weights."""
    return np.cos(2.0 * np.pi * np.outer(k, np.arange(len(weights)) - len(weights) // 2)) @ weights


def _noise_spectrum(correlation: np.ndarray, along: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    lags = np.arange(len(correlation)) - len(correlation) // 2
    by_column, by_row = (np.exp(2j * np.pi * np.outer(k, lags)) for k in along)
    return (by_row @ correlation @ by_column.T).real


def _lost(k: np.ndarray, power: np.ndarray, degree: int) -> np.ndarray:
    """e(k) of the module  # k (n,) >= 0, power (n,) of the surface at k, as the pixels show it"""
    beyond = _share_beyond(k, power)
    return 2.0 * ((1.0 - beyond) * _transfer(k - 1.0, degree) + beyond * _transfer(k, degree))


def _transfer(k: np.ndarray, degree: int) -> np.ndarray:
    aperture, order = np.sinc(k), degree + 1
    return aperture**order / sum(np.sinc(k + m) ** order for m in range(-N_ALIASES, N_ALIASES + 1))


def _share_beyond(k: np.ndarray, power: np.ndarray) -> np.ndarray:
    """rho(k): share of waves beyond the pixels' reach in what is seen as k; 1 - k is the wave that looks alike."""
    band = np.minimum((2 * N_BANDS * k).astype(int), N_BANDS - 1)
    density = np.bincount(band, power, N_BANDS) / np.maximum(np.bincount(band, minlength=N_BANDS), 1)
    half, quarter = N_BANDS // 2, N_BANDS // 4
    lower, upper = density[half:half + quarter].mean(), density[half + quarter:].mean()
    if upper <= 0.0:
        return np.zeros_like(k)
    rate = _rate(lower / upper)
    within, beyond = _passed(rate, k), _passed(rate, 1.0 - k)
    return np.minimum(beyond / (within + beyond), 0.5 * upper / np.maximum(density, upper)[band])


def _passed(rate: float, k: np.ndarray) -> np.ndarray:
    """Power of a surface whose spectrum falls at a rate (px), through the area of a pixel."""
    return np.exp(-rate * k) * np.sinc(k) ** 2


def _rate(ratio: float) -> float:
    """Rate from the power at 1/4 to 3/8 of a period per pixel over that at 3/8 to 1/2."""
    def expected(rate: float) -> float:
        lower, upper = ((_passed(rate, k) + _passed(rate, 1.0 - k)).mean()
                        for k in (np.linspace(0.25, 0.375, N_POINTS), np.linspace(0.375, 0.5, N_POINTS)))
        return float(lower / upper)

    if ratio <= expected(0.0):
        return 0.0
    if ratio >= expected(MAX_DECAY_PX):
        return MAX_DECAY_PX
    return float(scipy.optimize.brentq(lambda rate: expected(rate) - ratio, 0.0, MAX_DECAY_PX))
