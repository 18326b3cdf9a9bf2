"""Raw volumes with a VGStudio header: ``.vgi`` beside ``.vol``."""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path

import numpy as np

from idic.readers.volumes.entry import VolumeEntry, mm_per, volume_entry
from idic.readers.volumes.headers import file_of_voxels, header_text, no_header
from idic.readers.volumes.voxels import RawPlanes

_KINDS = {("unsigned integer", 8): "u1", ("unsigned integer", 16): "<u2", ("unsigned integer", 32): "<u4",
          ("signed integer", 16): "<i2", ("integer", 16): "<i2", ("signed integer", 32): "<i4",
          ("integer", 32): "<i4", ("float", 32): "<f4", ("float", 64): "<f8"}


def vgi_entries(path: Path) -> list[VolumeEntry]:
    """The one scan of a ``.vgi`` header; voxels of 16 and more bit are little-endian.

    Raises
    ------
    InputError
        The header is not complete, its file is missing or too short, or of a kind that idic does not read.
    """
    sections = _sections(header_text(path))
    place = sections["file1"]
    try:
        sides = [int(word) for word in (place.get("size") or sections["representation"]["size"]).split()]
        name = place["name"]
        kind = (place.get("datatype") or sections["representation"]["datatype"]).lower()
        bits = int(place.get("bitsperelement") or sections["representation"]["bitsperelement"])
        skipped = int(place.get("skipheader", "0"))
        resolution = [float(word) for word in sections["geometry"].get("resolution", "").split()]
    except (KeyError, ValueError) as error:
        raise no_header(path, f"no usable {error}") from None
    if len(sides) != 3 or skipped < 0 or len(resolution) not in (0, 3):
        raise no_header(path, f"size {sides}, resolution {resolution}, {skipped} bytes before the voxels")
    if place.get("fileformat", "raw").lower() != "raw" or (kind, bits) not in _KINDS:
        raise no_header(path, f"{kind} of {bits} bit in a file of format {place.get('fileformat', 'raw')}")
    shape, dtype = tuple(sides[::-1]), np.dtype(_KINDS[kind, bits])
    source = RawPlanes(file_of_voxels(path, name), shape, dtype, (skipped,))
    factor = mm_per(sections["geometry"].get("unit", ""), path)
    voxel_mm = [factor * side for side in resolution[::-1]] if resolution and factor else None
    return [volume_entry(path, source, shape, dtype, voxel_mm)]


def _sections(text: str) -> dict[str, dict[str, str]]:
    """{section: {key in small letters: text}} of the first volume."""
    sections: dict[str, dict[str, str]] = defaultdict(dict)
    name = ""
    for line in text.splitlines():
        stripped = line.strip()
        if stripped.startswith("[") and stripped.endswith("]"):
            name = stripped[1:-1].strip().lower()
        elif "=" in stripped:
            key, _, value = stripped.partition("=")
            sections[name].setdefault(key.strip().lower(), value.strip())
    return sections
