"""Sums of generalised least squares on disk while they are added: each frame keeps columns of nodal values until all
are known."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np

from idic.correlation import CorrelationSystem, LocalEquations, OpenSums

SPOOLED = ("matrix", "noise", "columns", "product", "kappa")  # of `LocalEquations`: the large ones
MIN_BYTES = 1_000_000  # of a part; less stays in memory


class Spool:
    """An open file that grows; what is kept in it is read back page by page, as memory allows."""

    def __init__(self, file):
        self._file = file

    def kept(self, system: CorrelationSystem) -> CorrelationSystem:
        """The same part of the sums, its large arrays on disk."""
        frames = system.sums.frames if isinstance(system.sums, OpenSums) else ()
        if sum(_size(frame) for frame in frames) * 8 < MIN_BYTES:
            return system
        begin = self._file.seek(0, 2)
        for frame in frames:
            for name in SPOOLED:
                self._file.write(np.ascontiguousarray(getattr(frame, name), dtype=float).tobytes())
        self._file.flush()
        # of the open file: Windows does not open one again that is deleted when it is closed
        stored = np.memmap(self._file, dtype=float, mode="r", offset=begin, shape=(sum(map(_size, frames)),))
        return replace(system, sums=replace(system.sums, frames=tuple(_from_disk(frames, stored))))


@contextmanager
def open_spool(folder: Path) -> Iterator[Spool]:
    """A spool in a folder for the length of a ``with`` block; what it kept must not be used later."""
    with tempfile.NamedTemporaryFile(dir=folder, prefix=".sums-", suffix=".tmp") as file:
        yield Spool(file)


def _size(frame: LocalEquations) -> int:
    return sum(getattr(frame, name).size for name in SPOOLED)


def _from_disk(frames: Sequence[LocalEquations], stored: np.ndarray) -> Iterator[LocalEquations]:
    first = 0
    for frame in frames:
        read = {}
        for name in SPOOLED:
            shape = getattr(frame, name).shape
            read[name] = stored[first:first + int(np.prod(shape))].reshape(shape)
            first += int(np.prod(shape))
        yield replace(frame, **read)
