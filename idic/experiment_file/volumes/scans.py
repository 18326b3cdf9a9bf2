"""The scans of an experiment as a stack: their files are read block by block."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from idic.errors import InputError
from idic.readers import VolumeEntry, volume_entries


class ScanFiles:
    """Volumes in files. It follows the `VolumeStack` protocol; another process receives its entries."""

    def __init__(self, entries: Sequence[VolumeEntry]):
        self.entries = tuple(entries)

    @property
    def n_frames(self) -> int:
        return len(self.entries)

    def repeated(self, n_frames: int) -> ScanFiles:
        """The first scan in the place of every scan of a test to come."""
        return ScanFiles([self.entries[0]] * n_frames)

    @property
    def shape(self) -> tuple[int, int, int]:
        """(nz, ny, nx)"""
        return self.entries[0].shape

    @property
    def labels(self) -> tuple[str, ...]:
        """File names."""
        return tuple(entry.name for entry in self.entries)

    @property
    def voxel_mm(self) -> tuple[float, float, float] | None:
        """Sides of a voxel along column, row and slice, where the files state them."""
        sides = self.entries[0].voxel_mm
        return None if sides is None else sides[::-1]

    @property
    def times(self) -> np.ndarray | None:
        """Times of the scans in s, where every file states its own  # (n_frames,)"""
        times = [entry.time_s for entry in self.entries]
        return None if any(time is None for time in times) else np.array(times, float)

    def block(self, k: int, z: slice, y: slice, x: slice) -> np.ndarray:
        """A block of scan `k`  # (slices, rows, columns)"""
        return self.entries[k].block(z, y, x)


def open_scans(folder: Path, patterns: Sequence[str], *, file: Path, key: str) -> ScanFiles:
    """The scans that the patterns name, in the order of the names; of files only the headers are read.

    Raises
    ------
    InputError
        No such file, a damaged one, or scans of different size.
    """
    entries = volume_entries(folder, list(patterns), file=file, key=key)
    first = entries[0]
    for entry in entries[1:]:
        if entry.shape != first.shape:
            raise InputError("the volumes differ in size", file=file, key=key,
                             expected=f"{size_in_words(first.shape)}, as {first.name}",
                             found=f"{entry.name}: {size_in_words(entry.shape)}",
                             remedy="crop all scans alike, or leave this one out")
    return ScanFiles(entries)


def size_in_words(shape: tuple[int, int, int]) -> str:
    """The size of a volume (nz, ny, nx): ``400 columns, 300 rows, 200 slices``."""
    nz, ny, nx = shape
    return f"{nx} columns, {ny} rows, {nz} slices"
