"""Size of the speckle: the width of its autocorrelation, as in the guide of good practice
(doi:10.32720/idics/gpg.ed1)."""

from __future__ import annotations

import numpy as np
import scipy

from idic.images.quality.patterned_region import patterned, without_trend
from idic.windows import away_from_edges, weighted_along

MAX_SHIFT_PX = 60  # of the autocorrelation: a coarser pattern is not a speckle
SMOOTHING_PX = 1.0  # standard deviation, before the slopes of edges are taken
MIN_PIXELS = 400  # of the region, for an autocorrelation
MIN_DETAIL = 1e-6  # of the variance, that is no trend of the light: rounding leaves less
WINDOWS_PX = (121, 31)  # of a local contrast: wide plain places, then narrow ones
LARGEST_PX = 512  # side of the part that is looked at: thousands of speckles


def speckle_size(image: np.ndarray, region: np.ndarray, noise_std: float = 0.0) -> float | None:
    """Full width at half maximum of the autocorrelation of a pattern, mean over all directions.

    R(d) = <(f(x) - m(x)) (f(x + d) - m(x + d))> over the pairs of pixels that both lie in the pattern, m uneven light;
    the width is twice the radius at which R falls to half of R(0) less the variance of the noise, which adds to R(0)
    alone. Round dots of diameter D give 0.81 D.

    Parameters
    ----------
    image : (ny, nx)
    region : (ny, nx) bool
        Where to look; gaps and plain places, as background and grips, are left out.
    noise_std : float
        Standard deviation of the noise of this image, in its unit.

    Returns
    -------
    float or None
        px; None where there is no pattern, or none that falls off within 60 px.
    """
    image = np.asarray(image, dtype=float)
    pattern = np.asarray(region, dtype=bool) & np.isfinite(image)
    if np.count_nonzero(pattern) < MIN_PIXELS:
        return None
    image, pattern = _middle(image, pattern)
    width, n_seen = _width(image, pattern, noise_std), np.count_nonzero(pattern)
    for window in WINDOWS_PX:
        part = patterned(image, pattern, window)
        n_part = np.count_nonzero(part)
        if MIN_PIXELS <= n_part < n_seen and (narrower := _width(image, part, noise_std)) is not None:
            width, n_seen = narrower, n_part
    return width


def _middle(image: np.ndarray, pattern: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Image and pattern in the box around the pattern, of a large one in its middle."""
    places = []
    for axis in (1, 0):
        along = np.flatnonzero(pattern.any(axis=axis))
        low, high = int(along[0]), int(along[-1]) + 1
        if high - low > LARGEST_PX:
            counts = np.cumsum(pattern.sum(axis=axis))
            middle = int(np.searchsorted(counts, 0.5 * counts[-1]))
            low = int(np.clip(middle - LARGEST_PX // 2, low, high - LARGEST_PX))
            high = low + LARGEST_PX
        places.append(slice(low, high))
    return image[tuple(places)], pattern[tuple(places)]


def _width(image: np.ndarray, pattern: np.ndarray, noise_std: float) -> float | None:
    """Full width at half maximum of the autocorrelation in the pattern; None where it has none."""
    if np.count_nonzero(pattern) < MIN_PIXELS:
        return None
    detail = without_trend(image, pattern)
    variance = float(np.var(image[pattern]))
    correlation = _by_radius(detail, pattern)
    top = correlation[0] - noise_std**2
    if not top > MIN_DETAIL * variance:
        return None  # light without a pattern
    below = np.flatnonzero(correlation[1:] < 0.5 * top) + 1
    if not len(below):
        return None
    k = int(below[0])
    previous = top if k == 1 else correlation[k - 1]
    return 2.0 * float(k - 1 + (previous - 0.5 * top) / (previous - correlation[k]))


def edge_blur(image: np.ndarray, region: np.ndarray, noise_std: float = 0.0) -> float | None:
    """Blur of the edges of a pattern, whatever the size of its speckles: 0.3 to 0.9 px in focus.

    A step that is blurred by a Gaussian of standard deviation s has the slope of that Gaussian, for which the root mean
    square of the first derivative is sqrt(2) s times that of the second; s^2 less that of the smoothing is returned as
    its root. The variance that noise adds to both derivatives is taken off.

    Parameters
    ----------
    image : (ny, nx)
    region : (ny, nx) bool
        The pattern.
    noise_std : float
        Standard deviation of the noise of this image, in its unit.

    Returns
    -------
    float or None
        px; None where there is no pattern.
    """
    image, pattern = np.asarray(image, dtype=float), np.asarray(region, dtype=bool)
    pattern = away_from_edges(pattern & np.isfinite(image), 4)
    if np.count_nonzero(pattern) < MIN_PIXELS:
        return None
    reach = np.arange(-4.0, 5.0)
    bell = np.exp(-0.5 * (reach / SMOOTHING_PX) ** 2)
    bell /= bell.sum()
    filled, squares = np.where(np.isfinite(image), image, 0.0), []
    for difference in (np.array([-0.5, 0.0, 0.5]), np.array([1.0, -2.0, 1.0])):
        taps = np.convolve(bell, difference)
        added = noise_std**2 * (taps**2).sum() * (bell**2).sum()
        derivatives = [weighted_along(weighted_along(filled, taps, axis), bell, 1 - axis) for axis in (0, 1)]
        squares.append(sum(float((part[pattern] ** 2).mean()) for part in derivatives) - 2.0 * added)
    if not min(squares) > 0.0:
        return None
    return float(np.sqrt(max(0.5 * squares[0] / squares[1] - SMOOTHING_PX**2, 0.0)))


def _by_radius(detail: np.ndarray, pattern: np.ndarray) -> np.ndarray:
    """Autocorrelation over whole radii 0, 1, 2 … px: sums over rings, weighted by the pairs of pixels  # (n,)"""
    reach = min(MAX_SHIFT_PX, min(pattern.shape) // 2)
    shape = [scipy.fft.next_fast_len(n + reach + 1, real=True) for n in pattern.shape]
    spectra = (np.abs(scipy.fft.rfft2(part, shape))**2 for part in (detail, pattern.astype(float)))
    products, pairs = (scipy.fft.irfft2(spectrum, shape) for spectrum in spectra)
    dy, dx = np.meshgrid(*(np.r_[0:reach + 1, -reach:0] for _ in range(2)), indexing="ij")
    radius = np.hypot(dy, dx)
    products, pairs = products[dy, dx], pairs[dy, dx]
    means = []
    for r in range(reach + 1):
        weight = np.clip(1.0 - np.abs(radius - r), 0.0, None) * pairs  # linear in the radius
        means.append(float((weight * products / np.maximum(pairs, 0.5)).sum() / max(weight.sum(), 0.5)))
    return np.array(means)
