"""NRRD volumes, with the header before the voxels or beside them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from idic.errors import InputError
from idic.readers.volumes.entry import VolumeEntry, damaged, mm_per, volume_entry
from idic.readers.volumes.headers import axes_of_directions, file_of_voxels, no_header
from idic.readers.volumes.voxels import RawPlanes, in_order

_KINDS = {"u1": ("uchar", "unsigned char", "uint8", "uint8_t"), "i1": ("signed char", "int8", "int8_t"),
          "u2": ("ushort", "unsigned short", "unsigned short int", "uint16", "uint16_t"),
          "i2": ("short", "short int", "signed short", "signed short int", "int16", "int16_t"),
          "u4": ("uint", "unsigned int", "uint32", "uint32_t"), "i4": ("int", "signed int", "int32", "int32_t"),
          "f4": ("float",), "f8": ("double",)}
_DTYPES = {name: code for code, names in _KINDS.items() for name in names}


def nrrd_entries(path: Path) -> list[VolumeEntry]:
    """The one scan of an NRRD file; lengths without a unit are mm where the header names an anatomical space.

    Raises
    ------
    InputError
        The header is not complete, or the voxels are compressed, turned, missing or too few.
    """
    import nrrd  # here: few experiments have such files

    try:
        with path.open("rb") as stream:
            header = nrrd.read_header(stream)
            end = stream.tell()
    except Exception as error:  # damaged headers raise many types
        raise damaged(path, error) from error
    encoding, kind = str(header.get("encoding", "raw")).lower(), str(header.get("type", ""))
    sides = [int(n) for n in header.get("sizes", ())]
    if encoding != "raw":
        raise InputError("voxels that idic cannot read in blocks", file=path, key="volumes",
                         expected="encoding: raw", found=f"encoding: {encoding}",
                         remedy="save the volume without compression (Slicer: Save, Compress off; "
                                'pynrrd: header = {"encoding": "raw"})')
    if len(sides) != 3 or min(sides) < 1 or kind not in _DTYPES:
        raise no_header(path, f"sizes {sides}, type {kind!r}")
    dtype = np.dtype(_DTYPES[kind]).newbyteorder(">" if header.get("endian") == "big" else "<")
    stored = tuple(sides[::-1])
    name = header.get("data file") or header.get("datafile")
    voxels = path if name is None else file_of_voxels(path, str(name))
    source = RawPlanes(voxels, stored, dtype, (_offset(header, voxels, end if name is None else 0, source_bytes=
                                                       int(np.prod(stored)) * dtype.itemsize, path=path),))
    axes, voxel_mm = _geometry(header, path)
    return [volume_entry(path, in_order(source, [2 - axis for axis in axes]), [sides[axis] for axis in axes], dtype,
                         voxel_mm)]


def _offset(header, voxels: Path, start: int, source_bytes: int, path: Path) -> int:
    """Where the voxels begin, in bytes."""
    skip = int(header.get("byte skip", header.get("byteskip", 0)))
    lines = int(header.get("line skip", header.get("lineskip", 0)))
    if lines or skip < -1:
        raise no_header(path, f"line skip {lines}, byte skip {skip}, which idic does not follow")
    return max(voxels.stat().st_size - source_bytes, 0) if skip == -1 else start + skip


def _geometry(header, path: Path) -> tuple[tuple[int, int, int], list[float] | None]:
    """For z, y and x the axis of the file (the fastest is 0), and the sides of a voxel."""
    directions = header.get("space directions")
    if directions is not None:
        rows = np.array([np.full(3, np.nan) if row is None else row for row in directions], float)
        if rows.shape != (3, 3) or not np.isfinite(rows).all():
            raise no_header(path, f"space directions {directions}")
        axes = axes_of_directions(rows, path)
        units = [str(unit) for unit in header.get("space units", ())]
        factors = [mm_per(unit, path) for unit in units] or [1.0 if header.get("space") else None] * 3
        lengths = np.linalg.norm(rows, axis=1)
        sides = [factor and factor * float(lengths[axis]) for axis, factor in zip(axes, factors[::-1], strict=True)]
    else:
        axes = (2, 1, 0)
        spacings = [float(value) for value in header.get("spacings", ())]
        factors = [mm_per(str(unit), path) for unit in header.get("units", ())]
        complete = len(spacings) == len(factors) == 3 and np.isfinite(spacings).all()
        sides = [factors[axis] and factors[axis] * spacings[axis] for axis in axes] if complete else [None]
    return axes, [side for side in sides if side is not None] if None not in sides else None
