"""Error of the spline on an image: the image is shifted by half a pixel and back, and compared with itself.

A pattern that the spline represents comes back as it was. White noise loses a known part of its finest waves; that part
is subtracted in quadrature. The rest is the error of the spline on the pattern. It is systematic: averaging over frames
does not reduce it. A shift by half a pixel is the worst case of a symmetric interpolation kernel.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from idic.images.interpolate import prefilter

SHIFT_PX = 0.5  # the error of a spline is largest there
MAX_SIDE_PX = 512  # of the middle of the image, which stands for all of it
STD_PER_MEDIAN = 1.4826  # standard deviation over median absolute value of a normal deviate
BORDER_PX = 8  # left out: splines mirror the image at its border


def spline_error(image: np.ndarray, degree: int, noise_std: float) -> float:
    """Standard deviation of the spline's error on an image with white noise of this standard deviation.

    image : (ny, nx), GV; noise_std : GV. The median over the pixels leaves out single steps between paint and
    background.
    """
    ny, nx = image.shape
    first_row, first_column = max((ny - MAX_SIDE_PX) // 2, 0), max((nx - MAX_SIDE_PX) // 2, 0)
    window = np.s_[first_row:first_row + MAX_SIDE_PX, first_column:first_column + MAX_SIDE_PX]
    middle = np.asarray(image[window], dtype=np.float32)
    return float(np.sqrt(max(_missing(middle, degree) ** 2 - (lost_noise_share(degree) * noise_std) ** 2, 0.0)))


@lru_cache(maxsize=4)
def lost_noise_share(degree: int) -> float:
    """Standard deviation that white noise loses by both shifts, over its own; by simulation, degree in {3, 5}."""
    return _missing(np.random.default_rng(0).standard_normal((256, 256)).astype(np.float32), degree)


def _missing(image: np.ndarray, degree: int) -> float:
    shifted = _moved(image, SHIFT_PX, degree)
    back = _moved(np.where(np.isfinite(shifted), shifted, image), -SHIFT_PX, degree)
    inner = (back - image)[BORDER_PX:-BORDER_PX, BORDER_PX:-BORDER_PX]
    return STD_PER_MEDIAN * float(np.nanmedian(np.abs(inner))) if inner.size else 0.0


def _moved(image: np.ndarray, by: float, degree: int) -> np.ndarray:
    rows, columns = np.mgrid[:image.shape[0], :image.shape[1]]
    points = np.stack([columns.ravel() + by, rows.ravel() + by], axis=1).astype(float)
    return prefilter(image, degree).evaluate(points).reshape(image.shape).astype(np.float32)
