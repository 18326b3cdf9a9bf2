"""Stages of py3dic (and pydic): `result.dic`, a text of the positions of the points in every image, in px.

Two lines of the grid (first, last, number, window) along columns and rows, then a line per image: its name and
``column,row`` of every point, separated by tabs. Rows count downwards, a stage has them upwards.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from idic.errors import InputError
from idic.readers.fields.stages.stage import KEY, Stage, stage_text

SUFFIXES = (".dic",)
_UPWARDS = np.array([1.0, -1.0])


def read_py3dic(path: Path) -> dict[float | None, Stage]:
    """All stages of a file by the number of the image.

    Raises
    ------
    InputError
        The file is cut off, or no result of py3dic.
    """
    lines = [line.rstrip("\t\n ") for line in stage_text(path).splitlines() if line.strip()]
    try:
        n = int(np.prod([int(line.split("\t")[2]) for line in lines[:2]]))
        rows = [np.array([cell.split(",") for cell in line.split("\t")[1:]], dtype=float) for line in lines[2:]]
    except (ValueError, IndexError) as problem:
        raise _refused(path, str(problem)) from None
    if len(rows) < 2 or n < 1:
        raise _refused(path, f"{len(rows)} images")
    odd_row = next((k for k, row in enumerate(rows) if row.shape != (n, 2)), None)
    if odd_row is not None:
        raise _refused(path, f"{len(rows[odd_row])} points in line {odd_row + 3}, {n} in the grid")
    at, ids = [row * _UPWARDS for row in rows], np.arange(n, dtype=np.int64)
    return {float(k): Stage(at[0].copy(), row - at[0], "px", ids) for k, row in enumerate(at)}


def _refused(path: Path, finding: str) -> InputError:
    return InputError("not a result of py3dic", file=path, key=KEY,
                      expected="two lines of the grid, then a line per image with column,row of every point",
                      found=finding, remedy="write result.dic again: the file may be half written")
