"""Volumes as stacks of their slices, and back: what stores images slice by slice stores volumes too."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass, field
from threading import Lock

import numpy as np

from idic.images import Stack, VolumeStack

# of slices that are kept: blocks side by side share theirs, and those of the reference come in between
KEPT_BYTES = 256 * 2**20


@dataclass(frozen=True, eq=False)
class Slices:
    """The slices of all scans one after the other, as images."""

    volumes: VolumeStack

    @property
    def n_frames(self) -> int:
        return self.volumes.n_frames * self.volumes.shape[0]

    @property
    def shape(self) -> tuple[int, int]:
        return self.volumes.shape[1:]

    @property
    def entries(self) -> list | None:
        """The file of every slice; None of volumes in memory."""
        entries = getattr(self.volumes, "entries", None)
        return None if entries is None else [entry for entry in entries for _ in range(self.volumes.shape[0])]

    def frame(self, k: int) -> np.ndarray:
        """Slice `k` of all  # (ny, nx)"""
        scan, plane = divmod(k, self.volumes.shape[0])
        everything = slice(None)
        return np.asarray(self.volumes.block(scan, slice(plane, plane + 1), everything, everything))[0]


@dataclass(frozen=True, eq=False)
class SlicedVolumes:
    """Volumes out of a stack of their slices; n_slices : of each.

    The slices read last are kept, up to `KEPT_BYTES`: a block takes a part of each, and its neighbours the others.
    """

    slices: Stack
    n_slices: int
    recent: OrderedDict[int, np.ndarray] = field(default_factory=OrderedDict, repr=False)
    lock: Lock = field(default_factory=Lock, repr=False)

    def __reduce__(self):
        return SlicedVolumes, (self.slices, self.n_slices)

    @property
    def n_frames(self) -> int:
        return self.slices.n_frames // self.n_slices

    @property
    def shape(self) -> tuple[int, int, int]:
        return self.n_slices, *self.slices.shape

    def block(self, k: int, z: slice, y: slice, x: slice) -> np.ndarray:
        """A block of scan `k`  # (slices, rows, columns)"""
        return np.stack([self._slice(k * self.n_slices + plane)[y, x] for plane in range(self.n_slices)[z]])

    def release(self) -> None:
        """Give back the slices that are kept."""
        with self.lock:
            self.recent.clear()

    def _slice(self, number: int) -> np.ndarray:
        """A slice of all scans  # (ny, nx)"""
        with self.lock:
            values = self.recent.pop(number, None)
            if values is None:
                values = self.slices.frame(number)
            self.recent[number] = values
            while len(self.recent) * values.nbytes > KEPT_BYTES:
                self.recent.popitem(last=False)
            return values
