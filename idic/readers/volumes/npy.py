"""Volumes in NPY files, one array each."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from idic.readers.volumes.entry import VolumeEntry, damaged, no_axes, volume_entry
from idic.readers.volumes.voxels import RawPlanes, in_order


def npy_entries(path: Path) -> list[VolumeEntry]:
    """The one scan of an array with axes z, y, x; its file says nothing of the size of a voxel.

    Raises
    ------
    InputError
        The array has other axes or no plain numbers, or the file is too short.
    """
    try:
        with path.open("rb") as stream:
            version = np.lib.format.read_magic(stream)
            read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
            shape, is_fortran, dtype = read(stream)
            offset = stream.tell()
    except Exception as error:  # damaged headers raise many types
        raise damaged(path, error) from error
    if len(shape) != 3:
        raise no_axes(path, f"an array with {len(shape)} axes {shape}", "save one scan per file")
    stored = shape[::-1] if is_fortran else shape
    source = in_order(RawPlanes(path, stored, dtype, (offset,)), (2, 1, 0) if is_fortran else (0, 1, 2))
    return [volume_entry(path, source, shape, dtype)]
