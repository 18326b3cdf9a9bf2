"""The load train between specimen and load cell: which way it moves, for friction that opposes it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from idic.model.records.parts import Column, Prescribed

DEAD_BAND_SHARE = 0.01  # of the range of the motion: a way back that is shorter turns nothing


def directions(motion: np.ndarray, dead_band: float) -> np.ndarray:
    """+1 while a motion grows, -1 while it falls, the last one while it rests; 0 before it has moved  # (n_frames,)

    dead_band : way back from an extreme that counts as a turn
    """
    signs = np.zeros(len(motion))
    extreme, way = float(motion[0]), 0.0
    for k, value in enumerate(motion):
        if way == 0.0 and abs(value - extreme) > dead_band:
            way = float(np.sign(value - extreme))
        elif way * (extreme - value) > dead_band:
            way = -way
        if way == 0.0 or way * (value - extreme) > 0.0:
            extreme = float(value) if way else extreme
        signs[k] = way
    return signs


def way_of(prescribed: Sequence[Prescribed]) -> np.ndarray | None:
    """Direction of the logged motion that moves most  # (n_frames,); None where no motion is logged"""
    logged = [entry.drive.values for entry in prescribed if isinstance(entry.drive, Column)]
    motion = max(logged, key=np.ptp, default=None)
    if motion is None or not np.ptp(motion) > 0.0:
        return None
    return directions(motion, DEAD_BAND_SHARE * float(np.ptp(motion)))
