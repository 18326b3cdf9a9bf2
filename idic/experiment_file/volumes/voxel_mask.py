"""Which voxels are compared: a painted volume, or all that are no air in the reference scan."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy

from idic.errors import InputError
from idic.experiment_file.volumes.scans import size_in_words
from idic.images import VolumeStack
from idic.readers import VolumeEntry, volume_entries

BLUR_PX = 1.5  # of the reference before its grey values tell air: noise of a voxel falls to a tenth
REACH_PX = 6  # voxels around a block that the blur reads: four standard deviations
ReadMask = Callable[[slice, slice, slice], np.ndarray]


@dataclass(frozen=True)
class VoxelMask:
    """painted : above zero where a voxel may be compared, None: everywhere; air_below_gv : a blurred grey value of the
    reference below it is air, None: no grey value is"""

    painted: VolumeEntry | None
    air_below_gv: float | None

    def __call__(self, volumes: VolumeStack, frames: Sequence[int]) -> ReadMask:
        """Reads a block of the mask, True: may be compared; frames : of the reference, which are averaged"""
        def read(z: slice, y: slice, x: slice) -> np.ndarray:
            inside = np.ones([part.stop - part.start for part in (z, y, x)], dtype=bool)
            if self.painted is not None:
                inside &= self.painted.block(z, y, x) > 0
            if self.air_below_gv is not None:
                inside &= _blurred(volumes, frames, (z, y, x)) >= self.air_below_gv
            return inside

        return lambda *at: read(*(slice(*part.indices(n)[:2]) for part, n in zip(at, volumes.shape, strict=True)))


def _blurred(volumes: VolumeStack, frames: Sequence[int], at: tuple[slice, slice, slice]) -> np.ndarray:
    """A block of the mean of the reference scans after a Gaussian  # (slices, rows, columns) float32"""
    around = [slice(max(part.start - REACH_PX, 0), min(part.stop + REACH_PX, n))
              for part, n in zip(at, volumes.shape, strict=True)]
    mean = np.mean([np.asarray(volumes.block(frame, *around), np.float32) for frame in frames], axis=0,
                   dtype=np.float32)
    inner = tuple(slice(part.start - wide.start, part.stop - wide.start) for part, wide in zip(at, around, strict=True))
    return scipy.ndimage.gaussian_filter(mean, BLUR_PX, mode="mirror", radius=REACH_PX)[inner]


def open_mask(folder: Path, name: str | None, air_below_gv: float | None, stack: VolumeStack, file: Path
              ) -> VoxelMask | None:
    """The mask of volumes; None where neither a file nor a grey value names one.

    Raises
    ------
    InputError
        No such file, several, or one of another size than the scans.
    """
    if name is None:
        return None if air_below_gv is None else VoxelMask(None, air_below_gv)
    key = "experiment.mask"
    entries = volume_entries(folder, name, file=file, key=key)
    if len(entries) != 1:
        raise InputError("several masks", file=file, key=key, expected="one volume of the size of a scan",
                         found=f"{len(entries)} volumes", remedy="name one of them")
    if entries[0].shape != stack.shape:
        raise InputError("the size differs from that of the scans", file=file, key=key,
                         expected=size_in_words(stack.shape), found=size_in_words(entries[0].shape),
                         remedy="make it from the reference scan")
    return VoxelMask(entries[0], air_below_gv)


def mask_files(folder: Path, name: str, file: Path) -> list[Path]:
    """The files that a mask of volumes is made of."""
    entries = volume_entries(folder, name, file=file, key="experiment.mask")
    paths = [path for entry in entries for path in (entry.path, getattr(entry.source, "path", entry.path))]
    return list(dict.fromkeys(inner for path in paths
                              for inner in (sorted(path.rglob("*")) if path.is_dir() else [path]) if inner.is_file()))
