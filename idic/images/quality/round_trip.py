"""What a spline makes of an image: half a pixel there and half a pixel back again, and what is missing then.

An image that the spline represents well comes back as it was. White noise loses a known part (its finest waves), which
is taken out: what is left is the error of the spline on the pattern, a systematic one that no averaging over frames
lessens.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from idic.images.interpolate import evaluate, prefilter

HALF = 0.5  # px: where a spline errs most
SIDE = 512  # px of the middle of an image that are looked at
TO_STD = 1.4826  # of the median of |a normal deviate|
MARGIN = 8  # px at the borders, where splines mirror the image


def spline_error(image: np.ndarray, degree: int, noise_std: float) -> float:
    """Standard deviation of the spline's error on an image with white noise of this standard deviation.

    image : (ny, nx); a median over the pixels, so that single steps between paint and background do not count
    """
    ny, nx = image.shape
    top, left = max((ny - SIDE) // 2, 0), max((nx - SIDE) // 2, 0)
    middle = np.asarray(image[top:top + SIDE, left:left + SIDE], dtype=np.float32)
    return float(np.sqrt(max(_missing(middle, degree) ** 2 - (noise_share(degree) * noise_std) ** 2, 0.0)))


@lru_cache(maxsize=4)
def noise_share(degree: int) -> float:
    """How much of white noise is missing after the way there and back, by its standard deviation."""
    return _missing(np.random.default_rng(0).standard_normal((256, 256)).astype(np.float32), degree)


def _missing(image: np.ndarray, degree: int) -> float:
    there = _moved(image, HALF, degree)
    back = _moved(np.where(np.isfinite(there), there, image), -HALF, degree)
    inner = (back - image)[MARGIN:-MARGIN, MARGIN:-MARGIN]
    return TO_STD * float(np.nanmedian(np.abs(inner))) if inner.size else 0.0


def _moved(image: np.ndarray, by: float, degree: int) -> np.ndarray:
    rows, columns = np.mgrid[:image.shape[0], :image.shape[1]]
    points = np.stack([columns.ravel() + by, rows.ravel() + by], axis=1).astype(float)
    return evaluate(prefilter(image, degree), points).reshape(image.shape).astype(np.float32)
