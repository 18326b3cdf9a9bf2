"""What the text headers of raw volumes share: the file of the voxels beside them, and axes by direction."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path, PurePosixPath

import numpy as np

from idic.errors import InputError

MAX_HEADER_BYTES = 2**20
_TURN = 1e-3  # of a direction: an axis that leaves its neighbour by less than a voxel in a thousand is along it


def header_text(path: Path) -> str:
    """The text of a header file; InputError where it is too long or not readable."""
    try:
        with path.open("rb") as stream:
            content = stream.read(MAX_HEADER_BYTES + 1)
    except OSError as error:
        raise no_header(path, str(error.strerror)) from None
    if len(content) > MAX_HEADER_BYTES:
        raise no_header(path, f"a file of {path.stat().st_size} bytes")
    return content.decode("utf-8-sig", errors="replace")


def no_header(path: Path, finding: str) -> InputError:
    """The refusal of a header that lacks something."""
    return InputError("the header of the volume is not complete", file=path, key="volumes",
                      expected="size, kind of the grey values and file of the voxels", found=finding,
                      remedy="export the volume again, or correct the header")


def file_of_voxels(header: Path, name: str) -> Path:
    """The file that a header names, in its folder or below.

    Raises
    ------
    InputError
        The name leads elsewhere, or there is no such file.
    """
    parts = PurePosixPath(name.strip().strip('"').replace("\\", "/")).parts
    if not parts or ".." in parts or parts[0].startswith("/") or ":" in parts[0]:
        raise InputError("the header names a file in another folder", file=header, key="volumes",
                         expected="a file beside the header", found=repr(name),
                         remedy="put the file of the voxels beside the header and correct its name there")
    path = header.parent.joinpath(*parts)
    if not path.is_file():
        raise InputError("the file of the voxels is missing", file=header, key="volumes", expected=str(path),
                         found="no such file", remedy="put it beside the header, or correct its name in the header")
    return path


def axes_of_directions(directions: Sequence[Sequence[float]], path: Path) -> tuple[int, int, int]:
    """For z, y and x, the axis of the voxels (the fastest is 0) that points along it.

    directions : a row per axis of the voxels: its direction in x, y, z

    Raises
    ------
    InputError
        The volume is turned, or an axis points backwards.
    """
    rows = np.asarray(directions, float)
    lengths = np.linalg.norm(rows, axis=1)
    units = rows / np.where(lengths > 0, lengths, 1.0)[:, None]
    places = units.argmax(axis=1)
    if rows.shape != (3, 3) or sorted(places) != [0, 1, 2] or (np.abs(units - np.eye(3)[places]) > _TURN).any():
        raise InputError("the header turns or mirrors the volume", file=path, key="volumes",
                         expected="axes of the voxels along x, y and z",
                         found="; ".join(" ".join(f"{value:g}" for value in row) for row in rows),
                         remedy="resample the volume along its axes, or write the directions 1 0 0, 0 1 0, 0 0 1 where "
                                "the mesh is in the frame of the voxels")
    k, j, i = (int(np.flatnonzero(places == axis)[0]) for axis in (2, 1, 0))
    return k, j, i
