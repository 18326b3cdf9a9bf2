"""Whether still frames are still: their shift against the first of them.

    one - other = gain (mean - its average) + offset + d . grad mean,      mean = (one + other) / 2

by least squares over the specimen, gradient by central differences: good to a tenth of shifts up to half a pixel.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

MAX_FITTED_PIXELS = 400_000  # rows are left out above: 10^5 pixels fix a shift to a thousandth of a pixel
MIN_TOLD_SHIFT_PX = 0.05  # a shift adds interpolation to what counts as noise, and moves a mean of frames


def shifts(images: Sequence[np.ndarray], mask: np.ndarray | None = None) -> np.ndarray:
    """Shift of every image against the first, column and row  # (n, 2) px

    mask : (ny, nx) bool, True on the specimen; pixels without a value (gaps of height images) are left out anyway
    """
    first = np.asarray(images[0], dtype=float)
    region = np.ones(first.shape, dtype=bool) if mask is None else np.asarray(mask, dtype=bool)
    step = max(1, int(np.ceil(np.count_nonzero(region) / MAX_FITTED_PIXELS)))
    rows = np.zeros(first.shape[0], dtype=bool)
    rows[::step] = True
    return np.array([_shift(first, np.asarray(image, dtype=float), region & rows[:, None]) for image in images])


def _shift(first: np.ndarray, second: np.ndarray, region: np.ndarray) -> np.ndarray:
    """Shift of `second` against `first`  # (2,) px"""
    mean = (first + second) / 2.0
    down, right = np.gradient(mean)
    usable = region & np.isfinite(mean) & np.isfinite(down) & np.isfinite(right)
    if np.count_nonzero(usable) < 100:
        return np.zeros(2)
    grey = mean[usable]
    columns = np.stack([right[usable], down[usable], np.ones(len(grey)), grey - grey.mean()], axis=1)
    fit = np.linalg.lstsq(columns.T @ columns, columns.T @ (first - second)[usable], rcond=None)[0]
    return fit[:2]


def drift_note(images: Sequence[np.ndarray], labels: Sequence[str], mask: np.ndarray | None = None) -> str:
    """A note on still frames that have moved; empty where they are at rest."""
    shift_px = shifts(images, mask)
    size = np.hypot(*shift_px.T)
    worst = int(np.argmax(size))
    if size[worst] < MIN_TOLD_SHIFT_PX:
        return ""
    return (f"the still frames are not at rest: {labels[worst]} has moved by {size[worst]:.2g} px "
            f"({shift_px[worst, 0]:+.2g}, {shift_px[worst, 1]:+.2g}) against {labels[0]}. The noise is measured after "
            "this shift; a mean of them is blurred by it. Take them in quicker succession, or on a stiffer stand")
