"""What the header of a film of a high-speed camera says; frames are read on demand."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Film:
    """shape : (ny, nx); dtype : of the frames; times_s : (n_frames,) from the first; note : on times and grey values;
    bits : per stored value; shift : bits by which stored values are too far up"""

    n_frames: int
    shape: tuple[int, int]
    dtype: str
    times_s: np.ndarray
    note: str
    bits: int = 16
    shift: int = 0
