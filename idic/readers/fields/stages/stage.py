"""One stage of an exported field, whatever system wrote it, and the numbers of its text tables."""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from idic.errors import InputError
from idic.readers.delimited.text_files import text_of
from idic.readers.instruments.workbook import FORMAT as WORKBOOK
from idic.readers.instruments.workbook import sheet_text

KEY = "experiment.fields"
_SEPARATORS = (";", "\t", ",")
_DECIMAL_COMMA = re.compile(r"\d,\d")
_DECIMAL_POINT = re.compile(r"\d\.\d")
_WORDS = {**dict.fromkeys(("", "-", "--", "---", "na", "n/a", "#n/a", "null", "none"), np.nan), "true": 1.0,
          "false": 0.0}  # in cells of numbers; `float` knows nan and inf


@dataclass(frozen=True, eq=False)
class Stage:
    """The points of one stage.

    Attributes
    ----------
    points : array (n, 2 | 3)
        Where the points were in the system's own reference; where `displacement` is None, where they are now. In a
        file with both they may be either (`idic.readers.fields.stages.state_of_positions`).
    displacement : array (n, 2 | 3) or None
        NaN where a point was not measured.
    unit : str
        Of both: "mm", "px", ...
    ids : array (n,), int64, or None
        Names of the points, alike in all stages.
    time_s : float or None
    analog : mapping
        Analog channels that the system has recorded with the stage: name -> (value, unit or None).
    columns : tuple
        Names of the columns of the points, of text files.
    unit_assumed : bool
        Neither the file nor its format states a unit.
    failed : mapping
        Why points are not measured, and how many (`idic.readers.fields.stages.failed_points`).
    placeless : int
        Rows without a place, which are left out.
    """

    points: np.ndarray
    displacement: np.ndarray | None
    unit: str
    ids: np.ndarray | None = None
    time_s: float | None = None
    analog: Mapping[str, tuple[float, str | None]] = field(default_factory=dict)
    columns: tuple[str, ...] = ()
    unit_assumed: bool = False
    failed: Mapping[str, int] = field(default_factory=dict)
    placeless: int = 0

    def with_points(self, points: np.ndarray, displacement: np.ndarray | None, ids: np.ndarray | None,
                    placeless: int) -> Stage:
        """The same stage with other points."""
        return replace(self, points=points, displacement=displacement, ids=ids, placeless=placeless)


def stage_text(path: Path) -> str:
    """The text of a stage.

    Raises
    ------
    InputError
        The file is no text.
    """
    return sheet_text(path) if path.suffix.lower() in WORKBOOK.suffixes else text_of(path.read_bytes(), path, KEY)[0]


def cells_of(line: str, separator: str) -> list[str]:
    """The cells of a line, without blanks and quotes."""
    return [cell.strip().strip('"').strip() for cell in next(csv.reader([line], delimiter=separator), [])]


def separator_of(header: str) -> str:
    """The separator of a header line: semicolon, tab or comma, else blanks."""
    return next((mark for mark in _SEPARATORS if mark in header), " ")


def numbers_of(lines: Sequence[str], n_columns: int, separator: str, path: Path, first_line: int) -> np.ndarray:
    """A block of numbers; an empty cell and a dash are NaN  # (n, n_columns)

    Raises
    ------
    InputError
        A row has another number of cells, as in a file that was cut off, a cell is no number, or numbers have both
        marks.
    """
    if not lines:
        return np.empty((0, n_columns))
    if separator != "," and (comma := next(filter(_DECIMAL_COMMA.search, lines[:20]), None)) is not None:
        if (point := next(filter(_DECIMAL_POINT.search, lines[:20]), None)) is not None:
            raise InputError("decimal commas and decimal points in one stage", file=path,
                             key=f"line {first_line + lines.index(comma)}",
                             expected="one decimal mark, no thousands separators",
                             found=comma[:60] if comma == point else f"{comma[:60]} and {point[:60]}",
                             remedy="export the stage again without thousands separators")
        lines = [line.replace(",", ".") for line in lines]
    delimiter = None if separator == " " else separator
    try:
        values = np.loadtxt(lines, delimiter=delimiter, ndmin=2, comments=None, quotechar='"')
    except ValueError:
        values = np.array([_row(line, n_columns, separator, path, first_line + k) for k, line in enumerate(lines)])
    if values.shape != (len(lines), n_columns):
        raise _cut_off(path, first_line, n_columns, values.shape[1])
    return values


def _row(line: str, n_columns: int, separator: str, path: Path, number: int) -> list[float]:
    cells = line.split() if separator == " " else cells_of(line, separator)
    if len(cells) != n_columns:
        raise _cut_off(path, number, n_columns, len(cells))
    try:
        return [_WORDS[word] if (word := cell.strip('"').lower()) in _WORDS else float(cell) for cell in cells]
    except ValueError:
        raise InputError("a cell of a stage is not a number", file=path, key=f"line {number}",
                         expected=f"{n_columns} numbers", found=line[:80], remedy="export the stage again") from None


def _cut_off(path: Path, number: int, expected: int, n_cells: int) -> InputError:
    return InputError("a row of a stage has another number of cells than its header", file=path,
                      key=f"line {number}", expected=f"{expected} cells", found=f"{n_cells}",
                      remedy="the file may be half written: export the stage again, or remove it from the pattern")
