"""A stack of volumes: a number of scans of one size, read block by block."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

import numpy as np


@runtime_checkable
class VolumeStack(Protocol):
    """Scans of equal size; `block` may be called from several threads at once."""

    @property
    def n_frames(self) -> int: ...

    @property
    def shape(self) -> tuple[int, int, int]:
        """(nz, ny, nx): slices, rows, columns."""
        ...

    def block(self, k: int, z: slice, y: slice, x: slice) -> np.ndarray:
        """A block of scan `k` in grey values  # (slices, rows, columns)"""
        ...


class ArrayVolumes:
    """Scans in memory.

    Parameters
    ----------
    scans : sequence of arrays (nz, ny, nx)
        Grey values; no copy is made.
    """

    def __init__(self, scans: Sequence[np.ndarray]):
        self._scans = scans

    @property
    def n_frames(self) -> int:
        return len(self._scans)

    @property
    def shape(self) -> tuple[int, int, int]:
        nz, ny, nx = np.shape(self._scans[0])
        return int(nz), int(ny), int(nx)

    def block(self, k: int, z: slice, y: slice, x: slice) -> np.ndarray:
        return self._scans[k][z, y, x]
