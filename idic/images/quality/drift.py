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
    seen = np.ones(first.shape, dtype=bool) if mask is None else np.asarray(mask, dtype=bool)
    step = max(1, int(np.ceil(np.count_nonzero(seen) / MAX_FITTED_PIXELS)))
    rows = np.zeros(first.shape[0], dtype=bool)
    rows[::step] = True
    return np.array([_shift(first, np.asarray(image, dtype=float), seen & rows[:, None]) for image in images])


def _shift(one: np.ndarray, other: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """Shift of `other` against `one`  # (2,) px"""
    mean = (one + other) / 2.0
    down, right = np.gradient(mean)
    known = seen & np.isfinite(mean) & np.isfinite(down) & np.isfinite(right)
    if np.count_nonzero(known) < 100:
        return np.zeros(2)
    grey = mean[known]
    columns = np.stack([right[known], down[known], np.ones(len(grey)), grey - grey.mean()], axis=1)
    fit = np.linalg.lstsq(columns.T @ columns, columns.T @ (one - other)[known], rcond=None)[0]
    return fit[:2]


def drift_note(images: Sequence[np.ndarray], labels: Sequence[str], mask: np.ndarray | None = None) -> str:
    """A note on still frames that have moved; empty where they are at rest."""
    found = shifts(images, mask)
    size = np.hypot(*found.T)
    worst = int(np.argmax(size))
    if size[worst] < MIN_TOLD_SHIFT_PX:
        return ""
    return (f"the still frames are not at rest: {labels[worst]} has moved by {size[worst]:.2g} px "
            f"({found[worst, 0]:+.2g}, {found[worst, 1]:+.2g}) against {labels[0]}. The noise is measured after this "
            "shift; a mean of them is blurred by it. Take them in quicker succession, or on a stiffer stand")
