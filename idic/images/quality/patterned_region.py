"""The part of a region that holds a pattern, and its grey values without uneven light.

A ROI may cover background or grips, and a lens darkens the corners of its image. Both are as wide as the image, and an
autocorrelation that holds them is theirs and not that of the speckle.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import maximum_filter, minimum_filter, uniform_filter

MIN_DECADES = 0.5  # of the local contrast: uneven light and soft focus change it by less, a plain place by more
BINS = 64  # of the logarithm of the local contrast
EDGE_PX = 15  # of the image of an edge, to both sides
TREND_DEGREE = 4  # of uneven light: cos^4 of a lens, a lamp at one side; 15 terms, of hundreds of speckles
MIN_PX_PER_DEGREE = 50  # of the shorter side: a higher degree in a small image follows the speckle
FITTED_PIXELS = 20_000  # of a trend: its terms are as smooth as the image is large


def patterned(image: np.ndarray, region: np.ndarray, window: int) -> np.ndarray:
    """The pixels of a region in whose windows the grey value changes as it does in the pattern  # (ny, nx) bool

    The logarithm of the local contrast falls into two classes (Otsu 1979, doi:10.1109/TSMC.1979.4310076); the lower one
    is no pattern where it is lower by `MIN_DECADES`, nor is a window beside it, which sees its edge.
    """
    values = np.where(region, image, image[region].mean())
    mean, square = uniform_filter(values, window), uniform_filter(values**2, window)
    contrast = np.sqrt(np.maximum(square - mean**2, 0.0))
    top = float(contrast[region].max(initial=0.0))
    if not top > 0.0:
        return region
    log = np.log10(np.clip(contrast / top, 1e-4, 1.0))
    level = _two_classes(log[region])
    if level is None:
        return region
    plain = minimum_filter(~region | (log < level), window)  # a gap between speckles is narrower than a window
    rest = region & ~maximum_filter(plain & region, 2 * window + EDGE_PX)
    return rest if np.count_nonzero(rest) > window**2 else region & (log >= level)


def without_trend(image: np.ndarray, region: np.ndarray) -> np.ndarray:
    """The image less a polynomial of uneven light, 0 outside of the region  # (ny, nx)"""
    rows, columns = np.nonzero(region)
    step = max(len(rows) // FITTED_PIXELS, 1)
    fit = np.linalg.lstsq(_terms(rows[::step], columns[::step], region.shape), image[rows, columns][::step], rcond=None)
    detail = np.zeros(region.shape)
    detail[rows, columns] = image[rows, columns] - _terms(rows, columns, region.shape) @ fit[0]
    return detail


def _terms(rows: np.ndarray, columns: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """Products of powers of row and column, -1 … 1 over the image  # (n, 15)"""
    y, x = 2.0 * rows / max(shape[0] - 1, 1) - 1.0, 2.0 * columns / max(shape[1] - 1, 1) - 1.0
    degree = min(TREND_DEGREE, min(shape) // MIN_PX_PER_DEGREE)
    return np.stack([x**i * y**j for i in range(degree + 1) for j in range(degree + 1 - i)], axis=1)


def _two_classes(values: np.ndarray) -> float | None:
    """The value between two classes; None where their means are close."""
    counts, edges = np.histogram(values, BINS)
    centres, weight = 0.5 * (edges[1:] + edges[:-1]), np.cumsum(counts) / counts.sum()
    sums = np.cumsum(counts * centres) / counts.sum()
    with np.errstate(divide="ignore", invalid="ignore"):
        between = np.nan_to_num((sums[-1] * weight - sums) ** 2 / (weight * (1.0 - weight)))
    k = int(np.argmax(between))
    if not 0.0 < weight[k] < 1.0:
        return None
    low, high = sums[k] / weight[k], (sums[-1] - sums[k]) / (1.0 - weight[k])
    return float(edges[k + 1]) if high - low > MIN_DECADES else None
