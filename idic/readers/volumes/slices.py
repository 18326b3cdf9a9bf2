"""Scans in folders of slices: one image per plane, in the order of the numbers in their names."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from idic.errors import InputError
from idic.readers.frame_names import FrameNames
from idic.readers.images import PICTURE_SUFFIXES, FileStack, open_stack
from idic.readers.paths import natural_key
from idic.readers.volumes.entry import VolumeEntry, volume_entry
from idic.readers.volumes.voxels import Chunks


def is_slices(folder: Path) -> bool:
    """Whether a folder holds images."""
    return any(path.suffix.lower() in PICTURE_SUFFIXES for path in folder.iterdir())


def slice_entries(folder: Path) -> list[VolumeEntry]:
    """The one scan whose slices are the images of a folder; they say nothing of the size of a voxel.

    Raises
    ------
    InputError
        A slice is missing, damaged, of another size or depth, in colour, or a stack itself.
    """
    paths = sorted((path for path in folder.iterdir()
                    if path.suffix.lower() in PICTURE_SUFFIXES and not path.name.startswith(".")),
                   key=lambda path: natural_key(path.name))
    _check_numbers(paths, folder)
    stack = open_stack(paths, key="volumes")
    if stack.n_frames != len(paths):
        several = next(entry for entry in stack.entries if "[" in entry.label)
        raise InputError("a slice has several pages", file=several.path, key="volumes", expected="one page per slice",
                         found=several.label, remedy="give the pattern of the stacks, such as scans/*.tif, where each "
                                                     "of them is a scan")
    shape, dtype = (stack.n_frames, *stack.shape), np.dtype(stack.entries[0].dtype)
    decode = _Slices(folder, tuple(paths))
    source = Chunks(shape, dtype, (1, *stack.shape), decode, ("slices", str(folder), _newest(paths)))
    return [volume_entry(folder, source, shape, dtype)]


@dataclass(frozen=True)
class _Slices:
    """Reads one slice."""

    folder: Path
    paths: tuple[Path, ...]

    def __call__(self, place: tuple[int, int, int]) -> np.ndarray:
        return _stack(self.paths[place[0]]).frame(0)[None]


@lru_cache(4096)
def _stack(path: Path) -> FileStack:
    """The header of a slice, read once per process."""
    return open_stack([path], key="volumes")


def _newest(paths: list[Path]) -> int:
    return max(path.stat().st_mtime_ns for path in paths)


def _check_numbers(paths: list[Path], folder: Path) -> None:
    """InputError where the numbers in the names have a gap."""
    if not paths:
        raise InputError("no slice in the folder", file=folder, key="volumes", expected="TIFF or PNG images, one per "
                         "plane", found="none", remedy="correct the pattern")
    numbers = FrameNames(tuple(path.name for path in paths)).numbers
    if numbers is None:
        if len(paths) > 1:
            raise InputError("the order of the slices is not certain", file=folder, key="volumes",
                             expected="names that differ in one number, such as slice_0000.tif",
                             found=f"{paths[0].name}, {paths[1].name} …", remedy="rename the slices")
        return
    steps = np.diff(numbers)
    gaps = np.flatnonzero(steps != steps.min()) if len(steps) else []
    if len(gaps):
        raise InputError("a slice is missing", file=folder, key="volumes",
                         expected=f"numbers in steps of {steps.min()}",
                         found=f"{paths[gaps[0] + 1].name} after {paths[gaps[0]].name}",
                         remedy="put the slice back, or export the scan again")
