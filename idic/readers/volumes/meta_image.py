"""MetaImage: a header ``.mhd`` beside its voxels, or before them in ``.mha``."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from idic.errors import InputError
from idic.readers.volumes.entry import VolumeEntry, check_length, mm_per, volume_entry
from idic.readers.volumes.headers import MAX_HEADER_BYTES, axes_of_directions, file_of_voxels, no_header
from idic.readers.volumes.voxels import RawPlanes, in_order

_KINDS = {"MET_UCHAR": "u1", "MET_CHAR": "i1", "MET_USHORT": "u2", "MET_SHORT": "i2", "MET_UINT": "u4",
          "MET_INT": "i4", "MET_ULONG": "u4", "MET_LONG": "i4", "MET_FLOAT": "f4", "MET_DOUBLE": "f8"}
_IDENTITY = "1 0 0 0 1 0 0 0 1"
_WITHIN = "local"  # the word for voxels in the file of the header


def meta_image_entries(path: Path) -> list[VolumeEntry]:
    """The one scan of a MetaImage; lengths are mm where the header names no unit, as in ITK.

    Raises
    ------
    InputError
        The header is not complete, the voxels are compressed, in colour, turned, missing or too few.
    """
    fields, end = _fields(path)
    try:
        sides = [int(word) for word in fields["dimsize"].split()]
        kind, name = fields["elementtype"].upper(), fields["elementdatafile"]
        spacing = [float(word) for word in (fields.get("elementspacing") or fields.get("elementsize", "")).split()]
        skipped = int(fields.get("headersize", "0"))
        turn = (fields.get("transformmatrix") or fields.get("orientation") or fields.get("rotation") or _IDENTITY)
        directions = np.array([float(word) for word in turn.split()])
    except (KeyError, ValueError) as error:
        raise no_header(path, f"no usable {error}") from None
    if len(sides) != 3 or len(directions) != 9 or len(spacing) not in (0, 3) or kind not in _KINDS or min(sides) < 1:
        raise no_header(path, f"DimSize {sides}, ElementType {kind}, {len(spacing)} sides of a voxel")
    _check_layout(fields, name, path)
    msb = fields.get("binarydatabyteordermsb") or fields.get("elementbyteordermsb") or "false"
    dtype = np.dtype(_KINDS[kind]).newbyteorder(">" if msb.lower() in ("true", "1") else "<")
    stored = tuple(sides[::-1])
    is_within = name.lower() == _WITHIN
    voxels = path if is_within else file_of_voxels(path, name)
    n_bytes = int(np.prod(stored)) * dtype.itemsize
    offset = end if is_within else voxels.stat().st_size - n_bytes if skipped == -1 else skipped
    source = RawPlanes(voxels, stored, dtype, (max(offset, 0),))
    check_length(source)
    axes = axes_of_directions(directions.reshape(3, 3), path)
    factor = mm_per(fields.get("distanceunits", "mm"), path)
    voxel_mm = [factor * spacing[axis] for axis in axes] if spacing and factor else None
    return [volume_entry(path, in_order(source, [2 - axis for axis in axes]), [sides[axis] for axis in axes], dtype,
                         voxel_mm)]


def _fields(path: Path) -> tuple[dict[str, str], int]:
    """The fields in small letters up to the last, ElementDataFile, and where it ends in the file."""
    fields: dict[str, str] = {}
    with path.open("rb") as stream:
        head = stream.read(MAX_HEADER_BYTES)
    position = 0
    while "elementdatafile" not in fields:
        end = head.find(b"\n", position)
        if end < 0 and position >= len(head):
            break
        end = len(head) if end < 0 else end
        key, sign, value = head[position:end].decode("utf-8", errors="replace").partition("=")
        if not sign and key.strip():
            break
        fields[key.strip().lower()] = value.strip()
        position = end + 1
    if "elementdatafile" not in fields:
        raise no_header(path, "no field ElementDataFile")
    return fields, position


def _check_layout(fields: dict[str, str], name: str, path: Path) -> None:
    """InputError where the voxels are not one raw block of single values."""
    for key, expectation, remedy in (
            ("compresseddata", "false", "save the volume without compression (ITK: useCompression=False)"),
            ("binarydata", "true", "save the volume in binary form"),
            ("elementnumberofchannels", "1", "save one channel")):
        if fields.get(key, expectation).lower() != expectation:
            raise InputError("voxels that idic cannot read in blocks", file=path, key="volumes",
                             expected=f"{key} = {expectation}", found=fields[key], remedy=remedy)
    if name.lower().startswith("list") or "%" in name:
        raise InputError("the header names many files", file=path, key="volumes", expected="one file of voxels",
                         found=name, remedy="give the folder of the slices, or save the volume in one file")
