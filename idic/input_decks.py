"""What input and output files of finite-element programs share: numbers as Fortran writes them, edges of sheets."""

from __future__ import annotations

import re

_REAL = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+))(?:[EeDdQq]([+-]?\d+)|([+-]\d+))?", re.ASCII)
_SHEET = re.compile(r"(?:M3D|SFM3D|R3D|DS|STRI|S|US)\d")  # shells, membranes and rigid faces; SC8R is a solid
SHEET_SIDES = 2  # faces 1 and 2 of a shell or a membrane of CalculiX are the sides of the sheet


def fortran_real(text: str) -> float:
    """The number that a Fortran program reads: 1.5, .5, 1E-3, 0.1D+02, and 1.425043-118 or 1.5+101 without a letter.

    Raises
    ------
    ValueError
        The text is no number. Python's float() reads more: 1_0, inf, the digits of other scripts.
    """
    match = _REAL.fullmatch(text.strip())
    if match is None:
        raise ValueError(f"not a number: {text!r}")
    mantissa, lettered, bare = match.groups()
    return float(f"{mantissa}e{lettered or bare or 0}")


def is_sheet(element_type: str) -> bool:
    """Whether the elements of a type of Abaqus or CalculiX are sheets in space: shells, membranes, rigid faces."""
    return _SHEET.match(element_type.upper()) is not None


def first_edge(element_type: str) -> int:
    """The face number of the first edge (from corner 1 to corner 2) of a plane element or a sheet.

    Plane elements number their edges from 1. Of shells and membranes faces 1 and 2 are the sides, the edges follow
    (CalculiX user's manual 2.20, *SURFACE).
    """
    return 1 + SHEET_SIDES if is_sheet(element_type) else 1
