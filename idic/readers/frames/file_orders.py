"""The orders that the files of images propose: by their names, the times in them or beside them, and when they were
saved."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from idic.readers.frames.name_orders import UncertainOrder, orders_of_names
from idic.readers.frames.written_times import time_beside

WRITTEN, SAVED = "written", "saved"
MIN_SAVED_S = 0.01  # median time between two files: those that were written faster were copied


def orders_of_files(paths: Sequence[Path], written_s: Sequence[float | None], first: int) -> dict[str, list[int]]:
    """Every order as places in `paths`, by the value of the key `order`, or "written" and "saved"; none where files
    hold several of the images.

    written_s : times by the headers of the files; None: none; first : 1 where the first file is the reference by its
    name, else 0
    """
    if len(set(paths)) < len(paths):
        return {}
    parts = 1 if len({path.parent for path in paths}) == 1 else 2
    stems = ["/".join(path.with_suffix("").parts[-parts:]) for path in paths[first:]]
    try:
        orders = orders_of_names(stems)
    except UncertainOrder:
        orders = {}
    times = list(written_s[first:])
    if any(time is None for time in times):
        times = [time_beside(path) for path in paths[first:]]
    saved = [path.stat().st_mtime for path in paths[first:]]
    for name, values in ((WRITTEN, times), (SAVED, saved)):
        if None not in values and len(set(values)) > len(values) // 2 and (
                name == WRITTEN or float(np.median(np.diff(np.sort(values)))) > MIN_SAVED_S):
            orders[name] = [k for _, k in sorted((value, k) for k, value in enumerate(values) if value is not None)]
    return {name: [*range(first), *(first + k for k in order)] for name, order in orders.items()}
