"""The part of a region that holds a pattern, and its grey values without uneven light.

A ROI may cover background or grips, and a lens darkens the corners of its image. Both are as wide as the image, and an
autocorrelation that holds them is theirs and not that of the speckle.
"""

from __future__ import annotations

import numpy as np

from idic.windows import window_all, window_any, window_mean

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
    mean, square = window_mean(values, window), window_mean(values**2, window)
    contrast = np.sqrt(np.maximum(square - mean**2, 0.0))
    top = float(contrast[region].max(initial=0.0))
    if not top > 0.0:
        return region
    log = np.log10(np.clip(contrast / top, 1e-4, 1.0))
    level = _two_classes(log[region])
    if level is None:
        return region
    plain = window_all(~region | (log < level), window)  # a gap between speckles is narrower than a window
    patterned_pixels = region & ~window_any(plain & region, 2 * window + EDGE_PX)
    return patterned_pixels if np.count_nonzero(patterned_pixels) > window**2 else region & (log >= level)


def without_trend(image: np.ndarray, region: np.ndarray) -> np.ndarray:
    """The image less a polynomial of uneven light, 0 outside of the region  # (ny, nx)"""
    degree = min(TREND_DEGREE, min(region.shape) // MIN_PX_PER_DEGREE)
    y, x = (np.linspace(-1.0, 1.0, n)[:, None] ** np.arange(degree + 1) for n in region.shape)  # (ny, p), (nx, p)
    i, j = np.nonzero(np.add.outer(np.arange(degree + 1), np.arange(degree + 1)) <= degree)
    rows, columns = np.nonzero(region)
    step = max(len(rows) // FITTED_PIXELS, 1)
    rows, columns = rows[::step], columns[::step]
    coefficients = np.zeros((degree + 1, degree + 1))
    coefficients[i, j] = np.linalg.lstsq(y[rows][:, i] * x[columns][:, j], image[rows, columns], rcond=None)[0]
    return np.where(region, image - y @ coefficients @ x.T, 0.0)


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
