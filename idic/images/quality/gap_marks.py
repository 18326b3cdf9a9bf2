"""Numbers that stand for "no value" in a height image, as profilometers write them: 0, -9999, 1e38."""

from __future__ import annotations

import numpy as np

MIN_MARKED = 3  # pixels of exactly one value


def gap_mark(heights: np.ndarray, region: np.ndarray) -> tuple[float, int] | None:
    """A value that stands for a gap, and how many pixels have it: the lowest or the highest of all, in several pixels,
    and further from the others than these are from each other. None where there is none.

    heights, region : (ny, nx); region True on the specimen
    """
    values, counts = np.unique(heights[region & np.isfinite(heights)].astype(float), return_counts=True)
    if len(values) < 3:
        return None
    for at, inner in ((0, values[1:]), (-1, values[:-1])):
        away = min(abs(values[at] - inner[0]), abs(values[at] - inner[-1]))
        if counts[at] >= MIN_MARKED and away > inner[-1] - inner[0]:
            return float(values[at]), int(counts[at])
    return None
