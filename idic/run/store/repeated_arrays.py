"""Arrays of one record per frame where many frames share a record: each is stored once.

The influence of frame-local unknowns is the largest record of a simulation, and that of an elastic model is the same in
all frames. ``NAME`` holds the records that differ, ``NAME_of_frame`` the number of the record of every frame.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from idic.run.store.arrays import FrameArrays, FrameWriter, read_array, write_array

_SUFFIX = "_of_frame"


class RepeatedWriter:
    """Takes the record of every frame; one that is the same object as that of the frame before is not stored again."""

    def __init__(self, group: Path | str, name: str, n_frames: int, shape, records_per_chunk: int):
        self._group, self._name = group, name
        self._array = FrameArrays.create(group, name, n_frames, shape, records_per_chunk)
        self._writer = FrameWriter(self._array, 0)
        self._last: np.ndarray | None = None
        self._numbers: list[int] = []

    def append(self, record: np.ndarray) -> None:
        """The record of the next frame, which is not changed afterwards."""
        if record is self._last:
            self._numbers.append(self._numbers[-1])
            return
        self._writer.append(record)
        self._numbers.append(self._numbers[-1] + 1 if self._numbers else 0)
        self._last = record

    def flush(self) -> None:
        """Write the last records, and which frame has which."""
        self._array.shorten(self._numbers[-1] + 1)  # before the last chunk is written, which may be a part of one
        self._writer.flush()
        write_array(self._group, self._name + _SUFFIX, np.array(self._numbers, dtype=np.int64))


class RepeatedReader:
    """The record of any frame; the chunk that was read last is kept."""

    def __init__(self, group: Path | str, name: str):
        self._array = FrameArrays.open(group, name)
        self._numbers = read_array(group, name + _SUFFIX)
        self._first, self._block = 0, np.zeros((0, *self._array.shape))
        self._record: tuple[int, np.ndarray] | None = None

    def frame(self, k: int) -> np.ndarray:
        """The record of frame k, counted from the reference; the same object where it is the same as the last."""
        number = int(self._numbers[k])
        if self._record is not None and self._record[0] == number:
            return self._record[1]
        if not self._first <= number < self._first + len(self._block):
            step = self._array.frames_per_chunk
            self._first = step * (number // step)
            self._block = self._array.read(self._first, min(self._first + step, self._array.n_frames))
        self._record = number, self._block[number - self._first]
        return self._record[1]
