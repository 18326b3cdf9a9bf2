"""Reads XYZ grids: height maps as text, one row ``x y z`` per point, as Gwyddion and confocal microscopes write them.

Gwyddion's export (user guide, "Text Data Export") has no heading and is in metres; other programs put lines that start
with ``#`` above the rows, one of which may state the units. The rows go along x, from line to line of the map. A file
does not say how many columns it has: they are counted until x is back at its first value, and every point must then lie
at its place on the grid. What programs write without their users asking for it is read as well: semicolons or commas
between the numbers, decimal commas, UTF-16.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import lru_cache
from itertools import islice
from pathlib import Path

import numpy as np

from idic.errors import InputError
from idic.readers.delimited.numerals import certain_marks
from idic.readers.delimited.text_files import text_of
from idic.readers.delimited.units import parse_unit

XYZ_SUFFIXES = (".xyz",)
MAX_OFF_GRID = 0.1  # of the pitch, between a point and its place: coordinates are rounded to about six digits
MAX_VALUE = 1e30  # of coordinates and heights: single precision ends at 3.4e38
GAPS = ("***", "No Data", "no data", "NO DATA")  # in the place of a height; NaN is a number
_ABOVE = re.compile(r"(?:[ \t]*(?:#.*)?\n)*")  # empty lines and comments
_UNITS = re.compile(r"#+\s*units?\s*[:=]\s*(.*)", re.IGNORECASE)  # units: um um nm
_NAMED = re.compile(r"\b([xyz])\s*[\[(/]\s*([^\])\s,;]+)", re.IGNORECASE)  # X [um]; x (um); x / um
_UNIT_NAME = re.compile(r"[A-Za-zµμ°%]+")  # no products and powers
_EXPECTED = "rows x y z of a regular grid, row by row, after comment lines that start with #"
_EXPORT = "export the whole map again as XYZ text, all points in rows, or as a 32-bit float TIFF"


@dataclass(frozen=True)
class XyzGrid:
    """What a map holds besides its heights.

    shape : (rows, columns); pitch : distance of neighbours along and across the rows, in `unit`
    unit, height_unit : of the coordinates and of the heights as the file names them; None where it does not
    """

    shape: tuple[int, int]
    pitch: tuple[float, float]
    unit: str | None = None
    height_unit: str | None = None

    @property
    def pitch_mm(self) -> tuple[float, float] | None:
        """Distance of neighbours along and across the rows in mm; None where the file names no unit of length."""
        unit = parse_unit(self.unit) if self.unit is not None else None
        if unit is None or unit.dimension != "length":
            return None
        return self.pitch[0] * unit.factor, self.pitch[1] * unit.factor


def xyz_grid(path: Path) -> XyzGrid:
    """The grid of a file, all of whose points are read.

    Raises
    ------
    InputError
        The file is no text, or not cut at the end of a line; a row is not three numbers; the points are no regular
        grid, or not in its order; a unit is unknown.
    """
    status = path.stat()
    return _known_grid(path, status.st_mtime_ns, status.st_size)


def read_xyz_heights(path: Path) -> np.ndarray:
    """The heights in the unit of the file, NaN where none was measured, in the order of the file  # (ny, nx) float32

    Raises
    ------
    InputError
        As `xyz_grid`.
    """
    grid, points = _read(path)
    return points[:, 2].reshape(grid.shape).astype(np.float32)


def check_alike(grid: XyzGrid | None, first: XyzGrid | None, path: Path, key: str, label: str) -> None:
    """InputError where two maps of one test differ in pitch or unit; label : of the first."""
    if grid is None or first is None:
        return
    if (grid.unit, grid.height_unit) != (first.unit, first.height_unit):
        raise InputError("the height images differ in their units", file=path, key=key, found=_units_of(grid),
                         expected=f"{_units_of(first)}, as {label}", remedy="export all maps with the same units")
    if not np.allclose(grid.pitch, first.pitch, rtol=MAX_OFF_GRID / max(first.shape), atol=0.0):
        raise InputError("the height images differ in pitch", file=path, key=key,
                         found=f"{grid.pitch[0]:g} x {grid.pitch[1]:g}",
                         expected=f"{first.pitch[0]:g} x {first.pitch[1]:g}, as {label}",
                         remedy="take all maps with one objective and resolution, or resample them alike")


def _units_of(grid: XyzGrid) -> str:
    return f"x and y in {grid.unit}, z in {grid.height_unit}" if grid.unit else "no units stated"


@lru_cache(maxsize=4096)  # images of a test
def _known_grid(path: Path, _changed: int, _size: int) -> XyzGrid:
    return _read(path)[0]


def _read(path: Path) -> tuple[XyzGrid, np.ndarray]:
    """The grid, and its points  # (n, 3)"""
    text, _ = text_of(path.read_bytes(), path, "images")
    text = text.replace("\r\n", "\n").replace("\r", "\n")
    n_above = _ABOVE.match(text).end()  # characters
    body, above = text[n_above:], text[:n_above].splitlines()
    if not body.strip():
        raise _refused(path, "no points in the file", "no row of numbers")
    for mark in GAPS:
        body = body.replace(mark, "nan")
    rows = _Rows(_plain(body, path).split("\n"), len(above) + 1)
    try:
        points = np.loadtxt(rows.texts, comments=None, ndmin=2)
    except ValueError:
        points = np.empty((0, 0))
    if points.shape[1:] != (3,):
        raise _refused(path, "a row is not three numbers", rows.bad())
    if not text.endswith("\n"):
        raise _refused(path, "the file is cut within its last row", "a last line without an end",
                       f"{_EXPORT}; if it is complete, end its last line")
    _check_values(points, rows, path)
    shape, pitch = _regular(points, rows, path)
    return XyzGrid(shape, pitch, *_units(above, path)), points


@dataclass(frozen=True)
class _Rows:
    """The lines of the points, empty ones among them, and the number of the first in the file."""

    texts: list[str]
    first: int

    def place(self, point: int) -> str:
        """The line of a point, counted without empty lines, in words."""
        k = next(islice((k for k, text in enumerate(self.texts) if text.strip()), point, None))
        return f"line {self.first + k}: {self.texts[k].strip()[:80]!r}"

    def bad(self) -> str:
        """The first line that is not three numbers, in words."""
        for point, text in enumerate(filter(str.strip, self.texts)):
            try:
                if np.loadtxt([text], comments=None, ndmin=2).shape == (1, 3):
                    continue
            except ValueError:
                pass
            return self.place(point)
        return "rows of different lengths"


def _plain(body: str, path: Path) -> str:
    """The rows with blanks between the numbers, and decimal points."""
    body = body.replace(";", " ")
    if "," not in body:
        return body
    row = body.lstrip().split("\n", 1)[0].strip()
    if len(row.split()) == 1 or ", " in row:
        return body.replace(",", " ")
    if "." in body or not any("," in certain_marks(row.split()) for row in body.splitlines()):
        raise _refused(path, "commas that may be decimal marks or thousands separators", f"the row {row[:80]!r}",
                       "export the map with decimal points and without thousands separators")
    return body.replace(",", ".")


def _check_values(points: np.ndarray, rows: _Rows, path: Path) -> None:
    """InputError where a coordinate is missing, or a number is out of all bounds."""
    heights = points[:, 2]
    bad = ~(np.abs(points[:, :2]) <= MAX_VALUE).all(axis=1) | (np.isfinite(heights) & (np.abs(heights) > MAX_VALUE))
    if bad.any():
        raise _refused(path, "a point without a place, or out of all bounds", rows.place(int(np.argmax(bad))))


def _regular(points: np.ndarray, rows: _Rows, path: Path) -> tuple[tuple[int, int], tuple[float, float]]:
    """(rows, columns) and pitch along and across the rows; InputError where the points are no regular grid."""
    n, (x, y) = len(points), points[:, :2].T
    back = np.flatnonzero(np.abs(x[2:] - x[0]) < 0.5 * abs(x[1] - x[0])) + 2 if n > 2 else np.empty(0, int)
    columns = int(back[0]) if len(back) else n
    n_rows = n // columns
    if n_rows < 2:
        finding = f"{n} points, rows of {columns}" if len(back) else f"{n} points, and x never back at its first value"
        if n > 1 and x[1] == x[0]:
            finding = f"two points with x = {x[0]:g} at the beginning (columns one after the other?)"
        raise _refused(path, "the points are no grid in rows", finding)
    lattice = points[:n_rows * columns].reshape(n_rows, columns, 3)
    step = (lattice[0, -1, 0] - lattice[0, 0, 0]) / (columns - 1), (lattice[-1, 0, 1] - lattice[0, 0, 1]) / (n_rows - 1)
    off = (np.abs(lattice[:, :, 0] - x[0] - step[0] * np.arange(columns)) > MAX_OFF_GRID * abs(step[0])) | (
        np.abs(lattice[:, :, 1] - y[0] - step[1] * np.arange(n_rows)[:, None]) > MAX_OFF_GRID * abs(step[1]))
    if step[1] == 0.0:
        raise _refused(path, "the points are no grid in rows",
                       f"{n_rows} rows of {columns} points, the first and the last at y = {y[0]:g}")
    if off.any():
        raise _refused(path, "the points are no regular grid",
                       f"rows of {columns} points, {abs(step[0]):g} apart, the rows {abs(step[1]):g}; {int(off.sum())} "
                       f"points off their places, the first in {rows.place(int(np.argmax(off)))}")
    if n % columns:
        raise _refused(path, "the last row of the grid is not complete",
                       f"{n} points in rows of {columns}: {n % columns} in the last")
    return (n_rows, columns), (float(abs(step[0])), float(abs(step[1])))


def _units(comments: list[str], path: Path) -> tuple[str | None, str | None]:
    """The units of coordinates and heights that the comments name."""
    for comment in comments:
        listing, named = _UNITS.match(comment.strip()), dict(_NAMED.findall(comment.lower()))
        if listing is None and set(named) != set("xyz"):
            continue
        if listing is None:  # the units as they are written
            names = [unit for _, unit in sorted((axis.lower(), unit) for axis, unit in _NAMED.findall(comment))]
        else:
            names = re.sub(r"[\[\](),;]", " ", listing[1]).split()
            names = 3 * names if len(names) == 1 else names
        units = [parse_unit(name) if _UNIT_NAME.fullmatch(name) else None for name in names]
        if (len(units) != 3 or None in units or units[0] != units[1]
                or units[0].dimension not in ("length", "pixel")):
            raise _refused(path, "units that idic does not understand", repr(comment.strip()[:80]),
                           "name the units of x, y and z, those of x and y alike, e.g.  # units: um um nm")
        return names[0], names[2]
    return None, None


def _refused(path: Path, message: str, finding: str, remedy: str = _EXPORT) -> InputError:
    return InputError(message, file=path, key="images", expected=_EXPECTED, found=finding, remedy=remedy)
