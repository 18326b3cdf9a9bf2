"""Numbers that stand for "no value" in a height image, as profilometers write them: 0, -9999, 1e38."""

from __future__ import annotations

import numpy as np

MIN_MARKED = 3  # pixels of exactly one value
MIN_LEVELS_AWAY = 10.0  # of the usual distance between neighbouring values: heights in whole steps may skip one


def gap_mark(heights: np.ndarray, region: np.ndarray) -> tuple[float, int] | None:
    """A value that stands for a gap, and how many pixels have it: the lowest or the highest of all, in several pixels,
    further from the others than these are from each other, and many of their steps. None where there is none.

    heights, region : (ny, nx); region True on the specimen
    """
    values = heights[region & np.isfinite(heights)].astype(float)
    for mark in (values.min(), values.max()) if len(values) else ():
        unmarked_values = values[values != mark]
        marked = len(values) - len(unmarked_values)
        if marked < MIN_MARKED or not len(unmarked_values) or np.ptp(unmarked_values) == 0.0:
            continue
        away = np.abs(unmarked_values - mark).min()
        if away > np.ptp(unmarked_values) and away > MIN_LEVELS_AWAY * np.median(np.diff(np.unique(unmarked_values))):
            return float(mark), marked
    return None
