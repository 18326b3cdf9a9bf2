"""Reads the log: a CSV of channels with one row per image, or with times and interpolated at the image times."""

from __future__ import annotations

import csv
import math
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from idic.errors import InputError
from idic.readers.units import factor_between, suffix_unit

_NUMBER = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?|[+-]?(nan|inf)", re.IGNORECASE)
_TIME_NAMES = ("time", "t")


@dataclass(frozen=True)
class Log:
    """The cells of a log as text; `column` converts and checks the numbers."""

    file: Path
    names: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    lines: tuple[int, ...]  # line in the file, per row
    decimal_comma: bool = False

    def column(self, name: str, *, file=None, key=None) -> np.ndarray:
        """A column as numbers, in the unit of the file  # (n_rows,)

        Raises
        ------
        InputError
            The column does not exist, or a cell is not a finite number.
        """
        if name not in self.names:
            raise InputError(f'no column "{name}" in {self.file.name}', file=file or self.file, key=key or name,
                             expected=f'a column "{name}"',
                             found=", ".join(self.names),
                             remedy=f"add the column to {self.file.name}, or name one of its columns")
        index = self.names.index(name)
        values = np.empty(len(self.rows))
        for k, (row, line) in enumerate(zip(self.rows, self.lines, strict=True)):
            values[k] = self._value(row[index], name, line)
        return values

    def _value(self, cell: str, name: str, line: int) -> float:
        text = cell.strip().replace(",", ".") if self.decimal_comma else cell.strip()
        value = float(text) if _is_number(text) else math.nan
        if not math.isfinite(value):
            raise InputError("a cell of the log is not a number", file=self.file, key=f"column {name}, line {line}",
                             expected="a finite number",
                             found=repr(cell) if cell.strip() else "an empty cell",
                             remedy="fill in the value, or remove that image from the pattern and its row from the log")
        return value

    @property
    def time_column(self) -> str | None:
        """``time_s``, ``t_ms``, …; None if the log has no such column."""
        for name in self.names:
            unit = suffix_unit(name)
            if unit in ("s", "ms", "us", "min", "h") and name.rpartition("_")[0].lower() in _TIME_NAMES:
                return name
        return None

    def times(self) -> np.ndarray | None:
        """Times in s, strictly increasing; None if the log has none  # (n_rows,)"""
        name = self.time_column
        if name is None:
            return None
        times = self.column(name) * factor_between(suffix_unit(name), "s")
        check_increasing(times, self.file, name, self.lines)
        return times


@dataclass(frozen=True)
class MatchedLog:
    """A log with one value per frame."""

    log: Log
    times: np.ndarray | None  # (n_frames,) s
    frame_rows: np.ndarray | None  # (n_frames,) row of each frame; None: interpolated at `times`

    @property
    def names(self) -> tuple[str, ...]:
        """The columns of the log."""
        return tuple(self.log.names)

    def column(self, name: str, *, file=None, key=None) -> np.ndarray:
        """Values at the frames, in the unit of the file  # (n_frames,)"""
        values = self.log.column(name, file=file, key=key)
        if self.frame_rows is not None:
            return values[self.frame_rows]
        return np.interp(self.times, self.log.times(), values)


def read_log(path: Path) -> Log:
    """A CSV: header row, then numbers; separated by comma, semicolon or tab; lines that start with # are skipped."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError("the log is not text in UTF-8", file=path, key="loads", expected="a CSV file",
                         found=str(error),
                         remedy="export it as CSV (UTF-8)") from None
    lines = [(number, line) for number, line in enumerate(text.splitlines(), 1) if line.strip()
             and not line.lstrip().startswith("#")]
    if len(lines) < 2:
        raise InputError("the log is empty", file=path, key="loads", expected="a header row and one row per image",
                         found=f"{len(lines)} rows",
                         remedy="export the log again")
    separator = next((mark for mark in (";", "\t") if mark in lines[0][1]), ",")
    cells = [tuple(cell.strip() for cell in next(csv.reader([line], delimiter=separator))) for _, line in lines]
    names = cells[0]
    _check_header(names, path)
    for (number, _), row in zip(lines[1:], cells[1:], strict=True):
        if len(row) != len(names):
            raise InputError("a row of the log has another number of cells than its header", file=path,
                             key=f"line {number}",
                             expected=f"{len(names)} cells: {', '.join(names)}", found=f"{len(row)} cells",
                             remedy="correct the row; with a comma as separator, numbers need a decimal point")
    return Log(path, names, tuple(cells[1:]), tuple(number for number, _ in lines[1:]), separator != ",")


def _check_header(names: tuple[str, ...], path: Path) -> None:
    if any(_is_number(name) for name in names):
        raise InputError("the log has no header row", file=path, key="line 1",
                         expected="column names such as frame,time_s,force_N", found=", ".join(names),
                         remedy="add a first line with the names of the columns")
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise InputError("a column name occurs twice", file=path, key=twice[0], expected="every name once",
                         found=", ".join(names), remedy="rename one of them")


def _is_number(text: str) -> bool:
    """Whether text is a decimal number; Python's float() also reads 1_0 and the digits of other scripts."""
    return _NUMBER.fullmatch(text) is not None


def match(log: Log, n_frames: int, numbers: tuple[int, ...] | None, image_times: np.ndarray | None) -> MatchedLog:
    """One value per frame: by time if the images have times, else row by row.

    Parameters
    ----------
    numbers : tuple of int, optional
        The numbers in the file names; a column ``frame`` may hold these or 0, 1, 2, …
    image_times : array (n_frames,) s, optional

    Raises
    ------
    InputError
        The numbers of rows and images differ, the column `frame` disagrees, or an image lies outside the log times.
    """
    if image_times is not None and log.time_column is not None:
        return _by_time(log, image_times)
    if len(log.rows) != n_frames:
        what = "fewer" if len(log.rows) < n_frames else "more"
        raise InputError(f"the log has {what} rows than the test has images", file=log.file, key="loads",
                         expected=f"{n_frames} rows, one per image",
                         found=f"{len(log.rows)} rows",
                         remedy="give one row per image in image order; or match by time: a column time_s in the log, "
                         "and image_times or frame_interval_s in [experiment]")
    if "frame" in log.names:
        _check_frames(log, n_frames, numbers)
    times = image_times if image_times is not None else log.times()
    return MatchedLog(log, times, np.arange(n_frames))


def _check_frames(log: Log, n_frames: int, numbers: tuple[int, ...] | None) -> None:
    given = log.column("frame")
    accepted = [np.arange(n_frames)] + ([np.array(numbers)] if numbers is not None else [])
    if any(np.array_equal(given, wanted) for wanted in accepted):
        return
    k = int(np.argmax(given != accepted[0]))
    raise InputError("the frame column disagrees with the images", file=log.file,
                     key=f"column frame, line {log.lines[k]}",
                     expected=f"{accepted[0][k]}" + (f" (or {accepted[1][k]}, the number in the file name)"
                                                     if len(accepted) > 1 else ""),
                     found=f"{given[k]:g}", remedy="sort the rows like the images and number them from 0")


def _by_time(log: Log, image_times: np.ndarray) -> MatchedLog:
    times = log.times()
    tolerance = 1e-9 * max(1.0, float(np.abs(times).max()))  # rounding of decimal times
    outside = np.flatnonzero((image_times < times[0] - tolerance) | (image_times > times[-1] + tolerance))
    if len(outside):
        raise InputError("an image lies outside the times of the log", file=log.file, key=log.time_column,
                         expected=f"images within {times[0]:g} … {times[-1]:g} s",
                         found=f"image {outside[0]} at {image_times[outside[0]]:g} s",
                         remedy="check first_frame_s and frame_interval_s, or remove such images from the pattern")
    return MatchedLog(log, image_times, None)


def check_increasing(times: np.ndarray, file, key: str, lines=None) -> None:
    """InputError unless every time is later than the one before."""
    bad = np.flatnonzero(np.diff(times) <= 0)
    if len(bad):
        k = int(bad[0]) + 1
        place = f"{key}, line {lines[k]}" if lines is not None else key
        raise InputError("the times are not sorted", file=file, key=place, expected=f"more than {times[k - 1]:g} s",
                         found=f"{times[k]:g} s",
                         remedy="sort the rows by time and remove rows with equal times")
