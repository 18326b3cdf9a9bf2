"""Reads the log: a CSV of channels with one row per image, or with times and interpolated at the image times."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path, PurePath
from typing import Literal

import numpy as np

from idic.errors import InputError
from idic.readers.delimited.clock_times import ClockError, ClockTimes
from idic.readers.delimited.log_table import Table, read_table
from idic.readers.delimited.numerals import certain_marks, has_thousands, is_ambiguous, number_in
from idic.readers.delimited.table_times import (
    clock_column, clock_of, clock_refusal, column_notes, seconds_column,
)
from idic.readers.delimited.text_files import text_of
from idic.readers.delimited.units import factor_between, parse_unit, unit_in_name
from idic.readers.formats.format import LOADS, Format
from idic.readers.instruments.tdms import FORMAT as TDMS
from idic.readers.instruments.tdms import read_tdms
from idic.readers.instruments.workbook import FORMAT as WORKBOOK
from idic.readers.instruments.workbook import sheet_text
from idic.readers.instruments.zwick import FORMAT as ZWICK
from idic.readers.instruments.zwick import read_zs2

FORMATS = (Format(LOADS, "tables of text", (".csv", ".txt", ".dat", ".asc", ".tsv", ".lvm", ".tra"), "",
                  "names, units, times",
                  "units that it lacks", "made: spellings of machines"),
           TDMS, ZWICK, WORKBOOK)
_BY_SUFFIX = {**dict.fromkeys(TDMS.suffixes, read_tdms), **dict.fromkeys(ZWICK.suffixes, read_zs2)}
_MAX_VALUE = 1e60  # absolute; squares of squares stay floats
_MAX_SHOWN_ROWS = 10  # in a note
_MAX_BEYOND_SHARE = 1e-6  # of the test: an image that is further outside the log is told
_CLOCK = re.compile(r"[0-9]:[0-9]{2}|[0-9]{4}-[0-9]{2}-[0-9]{2}|[0-9]{1,2}\.[0-9]{1,2}\.[0-9]{4}")
Decimal = Literal[".", ","]


@dataclass(frozen=True)
class Log:
    """The cells of a log as text; `column` converts and checks the numbers.

    decimal : mark that the user states; None: as the cells show
    notes : how the file was read where that is not obvious
    of_stages : whether these are the analog channels of measured fields
    start : clock times of the images, from whose first row the times of day of this log count; None: from its own
    """

    file: Path
    table: Table
    decimal: Decimal | None = None
    notes: tuple[str, ...] = ()
    of_stages: bool = False
    start: ClockTimes | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """The columns."""
        return self.table.names

    @property
    def rows(self) -> tuple[tuple[str, ...], ...]:
        """The cells, row by row."""
        return self.table.rows

    @property
    def lines(self) -> tuple[int, ...]:
        """The line in the file of each row."""
        return self.table.lines

    def unit(self, name: str) -> str | None:
        """The unit of a column: from the units row, else from its name (``force_N``, ``Force [N]``); None without."""
        row_unit = self.table.units[self.names.index(name)] if name in self.names else ""
        name_unit = unit_in_name(name)
        if row_unit and name_unit and parse_unit(row_unit) != parse_unit(name_unit):
            raise InputError("the units row contradicts the name of a column", file=self.file, key=f"column {name}",
                             expected=name_unit, found=row_unit, remedy="correct the name or the unit below it")
        return row_unit or name_unit

    @property
    def unread(self) -> tuple[str, ...]:
        """The notes on columns that are not read."""
        return tuple(column_notes(self.table, self.file)[self._clock_column is not None:])

    def column(self, name: str, *, file=None, key=None) -> np.ndarray:
        """A column as numbers, in the unit of the file  # (n_rows,)

        Raises
        ------
        InputError
            The column does not exist, a cell is not a finite number, or its decimal mark is not certain.
        """
        if name not in self.names:
            raise self._no_column(name, file, key)
        cells = self.table.cells(name)
        marks = self._decimal_marks(name, cells)
        values = np.empty(len(cells))
        for k, (cell, mark) in enumerate(zip(cells, marks, strict=True)):
            value = number_in(cell, mark)
            if value is None or not abs(value) <= _MAX_VALUE:
                raise self._no_number(cell, name, self.lines[k])
            values[k] = value
        return values

    def _decimal_marks(self, name: str, cells: list[str]) -> list[str]:
        """The decimal mark of every cell of a column; InputError where 1.580 may be 1580."""
        for line, cell in zip(self.lines, cells, strict=True):
            if has_thousands(cell, self.decimal):
                raise self._thousands(cell, name, line)
        if self.decimal is not None:
            return [self.decimal] * len(cells)
        proved = certain_marks(cells)
        open_cells = [(line, cell) for line, cell in zip(self.lines, cells, strict=True) if is_ambiguous(cell)]
        if open_cells and not proved:
            proved = self._proved_elsewhere
            if not proved and self.table.separator == ",":
                proved = {"."}
        if open_cells and len(proved) != 1:
            raise self._ambiguous(open_cells[0][1], name, open_cells[0][0])
        for line, cell in open_cells:
            if not proved & set(cell):
                raise self._thousands(cell, name, line)
        return ["," if "," in cell else "." for cell in cells]

    @cached_property
    def _proved_elsewhere(self) -> set[str]:
        """The decimal marks that some cell of the log proves."""
        return certain_marks(cell for row in self.rows for cell in row)

    def _no_column(self, name: str, file, key) -> InputError:
        above = next((line for line, row in self.table.head_rows if name in row), None)
        if above is not None:
            return InputError("a row of the log holds no number", file=self.file, key=f"line {self.table.header_line}",
                              expected=f"rows of numbers below the header in line {above}",
                              found=", ".join(self.names), remedy="correct the row")
        if self.of_stages:
            return InputError(f'no analog channel "{name}" in the stages', file=file or self.file, key=key or name,
                              expected=f'"{name}" in every stage', found=", ".join(self.names),
                              remedy="export it with the stages, name a channel that they have, or give the log of the "
                                     'machine: loads = "log.csv"')
        return InputError(f'no column "{name}" in {self.file.name}', file=file or self.file, key=key or name,
                          expected=f'a column "{name}"', found=", ".join(self.names),
                          remedy=f"add the column to {self.file.name}, or name one of its columns")

    def _no_number(self, cell: str, name: str, line: int) -> InputError:
        if _CLOCK.search(cell):
            return InputError("a time of day or a date in place of a number", file=self.file,
                              key=f"column {name}, line {line}", expected="a number, of times the seconds since the "
                              "first row", found=repr(cell), remedy="write the seconds since the first row in their "
                              "place; a column of dates that no key names may stay")
        return InputError("a cell of the log is not a number", file=self.file, key=f"column {name}, line {line}",
                          expected="a finite number" + (f' with the decimal mark "{self.decimal}"' if self.decimal
                                                        else ""),
                          found=repr(cell) if cell.strip() else "an empty cell",
                          remedy="fill in the value, or the mean of its neighbours with the image in exclude_frames")

    def _thousands(self, cell: str, name: str, line: int) -> InputError:
        return InputError("a number with thousands separators", file=self.file, key=f"column {name}, line {line}",
                          expected="numbers without separators between the thousands, such as 1580 or 1580,5",
                          found=repr(cell), remedy="export the log without thousands separators")

    def _ambiguous(self, cell: str, name: str, line: int) -> InputError:
        mark = "." if "." in cell else ","
        return InputError("the decimal mark of the log is ambiguous", file=self.file,
                          key=f"column {name}, line {line}",
                          expected='decimal = "," or decimal = "." in [experiment]',
                          found=f"{cell!r}, a decimal fraction or a number of thousands",
                          remedy=f'if "{mark}" separates the decimals, write decimal = "{mark}" in [experiment]; else '
                                 "export the log without thousands separators")

    def check_rows_of(self, labels: Sequence[str], key: str) -> None:
        """InputError where a column names the frames in another order than theirs.

        labels : file names of the frames
        """
        stems = [PurePath(label).stem for label in labels]
        for name in self.names if len(self.rows) == len(labels) else ():
            cells = [PurePath(cell.strip().replace("\\", "/")).name for cell in self.table.cells(name)]
            for row_names, frame_names in ((cells, list(labels)), (cells, stems)):
                if row_names == frame_names or sorted(row_names) != sorted(frame_names):
                    continue
                k = next(k for k, label in enumerate(frame_names) if row_names[k] != label)
                raise InputError("two orders of the images", file=self.file, key=f"column {name}, line {self.lines[k]}",
                                 expected=", ".join([*labels[k:k + 2], "… as the images are sorted by their names"]),
                                 found=", ".join([*row_names[k:k + 2], "…"]),
                                 remedy='if the rows are in the order of time, write order = "listed" and list the '
                                        f"files so in images; else sort the rows of {key}")

    @property
    def time_column(self) -> str | None:
        """``time_s``, ``t_ms``, …, or the column of times of day; None if the log has no such column."""
        return self._seconds_column or self._clock_column

    @cached_property
    def _seconds_column(self) -> str | None:
        return seconds_column(self.table)

    @cached_property
    def _clock_column(self) -> str | None:
        return None if self._seconds_column else clock_column(self.table)

    @cached_property
    def clock(self) -> ClockTimes | None:
        """The times of day of the rows, where these are the times of the log; InputError where they are not certain."""
        return None if self._clock_column is None else clock_of(self.table, self._clock_column, self.file)

    def times(self) -> np.ndarray | None:
        """Times in s, strictly increasing, times of day from the first row (or that of `start`); None if the log has
        none  # (n_rows,)"""
        name = self.time_column
        if name is None:
            return None
        if self.clock is None:
            times = self.column(name) * factor_between(self.unit(name) or "s", "s", file=self.file, key=name)
        else:
            try:
                times = self.clock.seconds_since(self.start or self.clock)
            except ClockError as error:
                raise clock_refusal(error, self.table, name, self.file) from None
        check_increasing(times, self.file, name, self.lines)
        return times

    def on_the_clock_of(self, image_times: Log) -> Log:
        """The same log with its times of day counted from the first of the images.

        Raises
        ------
        InputError
            One of the two has times of day, the other seconds.
        """
        clocks = [self.clock is not None, image_times.clock is not None]
        if self.time_column is not None and clocks[0] != clocks[1]:
            kinds = [f"{log.time_column} of {log.file.name} in {'times of day' if clock else 'seconds'}"
                     for log, clock in zip((self, image_times), clocks, strict=True)]
            raise InputError("the log and the images have times of different kinds", file=self.file,
                             key=f"column {self.time_column}", expected="both in times of day, or both in seconds from "
                             "one start", found=" and ".join(kinds), remedy="write both alike")
        return replace(self, start=image_times.clock) if all(clocks) else self

    def match(self, n_frames: int, numbers: tuple[int, ...] | None, image_times: np.ndarray | None) -> MatchedLog:
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
        if image_times is not None and self.time_column is not None:
            return _by_time(self, image_times)
        if len(self.rows) > n_frames and (numbered := _by_number(self, numbers, image_times)) is not None:
            return numbered
        if len(self.rows) != n_frames:
            difference = "fewer" if len(self.rows) < n_frames else "more"
            raise InputError(f"the log has {difference} rows than the test has images", file=self.file, key="loads",
                             expected=f"{n_frames} rows, one per image",
                             found="; ".join([f"{len(self.rows)} rows", *self.unread]),
                             remedy="give one row per image in image order; or match by time: a column time_s in the "
                             "log, and image_times or frame_interval_s in [experiment]")
        if "frame" in self.names:
            _check_frames(self, n_frames, numbers)
        times = image_times if image_times is not None else self.times()
        return MatchedLog(self, times, np.arange(n_frames))

    @classmethod
    def read(cls, path: Path, decimal: Decimal | None = None) -> Log:
        """A CSV file: header row, perhaps a row of units, then numbers; or a record of a measuring device.

        Separated by comma, semicolon or tab, or as ``sep=;`` says; UTF-8, UTF-16 or Windows-1252.

        Raises
        ------
        InputError
            The file is no text, or no table of numbers.
        """
        if (read_channels := _BY_SUFFIX.get(path.suffix.lower())) is not None:
            table, device_notes = read_channels(path)
            return cls(path, table, ".", (*device_notes, *column_notes(table, path)))
        is_workbook = path.suffix.lower() in WORKBOOK.suffixes
        text, note = (sheet_text(path), None) if is_workbook else text_of(path.read_bytes(), path, "loads")
        table = read_table(text, path)
        decimal = "." if is_workbook else decimal
        notes = [note] if note else []
        if table.head_rows:
            notes.append(f"{path.name}: the header is line {table.header_line}; {len(table.head_rows)} lines above it "
                         "are skipped")
        if any(table.units):
            notes.append(f"{path.name}: the row below the header gives the units")
        return cls(path, table, decimal, (*notes, *column_notes(table, path)))


@dataclass(frozen=True)
class MatchedLog:
    """A log with one value per frame."""

    log: Log
    times: np.ndarray | None  # (n_frames,) s
    frame_rows: np.ndarray | None  # (n_frames,) row of each frame; None: interpolated at `times`
    late: float = 0.0  # s, how much later an interpolated log is read

    @property
    def names(self) -> tuple[str, ...]:
        """The columns of the log."""
        return tuple(self.log.names)

    @property
    def notes(self) -> tuple[str, ...]:
        """How the file was read, and where it does not reach to."""
        if self.frame_rows is not None:
            return self.log.notes
        beyond = np.abs(self._beyond())
        n = int(np.count_nonzero(beyond > _MAX_BEYOND_SHARE * np.ptp(self.times)))
        return self.log.notes if not n else (*self.log.notes, (
            f"{self.log.file.name}: read at the start value of time.offset, {self.late:.4g} s, {n} of {len(beyond)} "
            f"images lie up to {beyond.max():.3g} s outside its times, and its columns are continued straight there: "
            "give a longer log, or leave these images out"))

    def unit(self, name: str) -> str | None:
        """The unit of a column, by the units row or its name; None without."""
        return self.log.unit(name)

    def column(self, name: str, *, file=None, key=None) -> np.ndarray:
        """Values at the frames, in the unit of the file  # (n_frames,)"""
        values = self.log.column(name, file=file, key=key)
        if self.frame_rows is not None:
            return values[self.frame_rows]
        times, at = self._read_at()
        interpolated = np.interp(at, times, values)
        beyond = self._beyond()
        return interpolated + beyond * self._slopes(values) if beyond.any() else interpolated

    @property
    def is_interpolated(self) -> bool:
        """Whether its rows have times of their own."""
        return self.frame_rows is None

    def rates(self, name: str) -> np.ndarray:
        """Change of a column of an interpolated log per second, over the time between two frames  # (n_frames,)"""
        return self._slopes(self.log.column(name))

    def _read_at(self) -> tuple[np.ndarray, np.ndarray]:
        """Times of the rows, and of the frames within them (s)"""
        times = self.log.times()
        return times, np.clip(self.times + self.late, times[0], times[-1])

    def _beyond(self) -> np.ndarray:
        """How far the frames lie outside the times of the rows; negative before them  # (n_frames,) s"""
        return self.times + self.late - self._read_at()[1]

    def _slopes(self, values: np.ndarray) -> np.ndarray:
        times, at = self._read_at()
        half = 0.5 * float(np.median(np.diff(self.times))) if len(self.times) > 1 else np.inf
        low, high = np.maximum(at - half, times[0]), np.minimum(at + half, times[-1])
        return (np.interp(high, times, values) - np.interp(low, times, values)) / (high - low)

    def of_frames(self, frames: Sequence[int]) -> MatchedLog:
        """The same of some of the frames."""
        chosen = list(frames)
        return replace(self, times=None if self.times is None else self.times[chosen],
                       frame_rows=None if self.frame_rows is None else self.frame_rows[chosen])


def _by_number(log: Log, numbers: tuple[int, ...] | None, image_times: np.ndarray | None) -> MatchedLog | None:
    """The rows whose column `frame` holds the numbers of the images, where others were lost; None where one of them has
    no row, or two."""
    if "frame" not in log.names or numbers is None or None in numbers:
        return None
    column = log.column("frame")
    rows = [np.flatnonzero(column == number) for number in numbers]
    if any(len(places) != 1 for places in rows):
        return None
    row_numbers = np.concatenate(rows)
    lost_frames = [f"{number:g}" for number in np.delete(column, row_numbers)]
    note = (f"{log.file.name}: {len(lost_frames)} rows have no image of their number and are left out: frame "
            f"{', '.join(lost_frames[:_MAX_SHOWN_ROWS])}{' …' if len(lost_frames) > _MAX_SHOWN_ROWS else ''}")
    times = log.times() if image_times is None else None
    times = image_times if times is None else times[row_numbers]
    return MatchedLog(replace(log, notes=(*log.notes, note)), times, row_numbers)


def _check_frames(log: Log, n_frames: int, numbers: tuple[int, ...] | None) -> None:
    column = log.column("frame")
    accepted = [np.arange(n_frames)] + ([np.array(numbers)] if numbers is not None and None not in numbers else [])
    if any(np.array_equal(column, expected) for expected in accepted):
        return
    k = int(np.argmax(column != accepted[0]))
    raise InputError("the frame column disagrees with the images", file=log.file,
                     key=f"column frame, line {log.lines[k]}",
                     expected=f"{accepted[0][k]}" + (f" (or {accepted[1][k]}, the number in the file name)"
                                                     if len(accepted) > 1 else ""),
                     found=f"{column[k]:g}", remedy=_order_remedy(column, accepted))


def _order_remedy(column: np.ndarray, accepted: Sequence[np.ndarray]) -> str:
    if len(accepted) > 1 and np.array_equal(np.sort(column), np.sort(accepted[1])) and np.all(np.diff(column) > 0):
        return ("the log counts the same frames in another order than their names: look at the images, then write "
                'order = "listed" with images = ["first.tif", …] under [experiment], or sort the rows like the images')
    if np.all(column < 0) and len(accepted) > 1 and np.array_equal(np.sort(-column), np.sort(accepted[1])):
        return 'write order = "signed" under [experiment] if the numbers in the names are below zero'
    return "sort the rows like the images and number them from 0"


def _by_time(log: Log, image_times: np.ndarray) -> MatchedLog:
    times = log.times()
    tolerance = 1e-9 * max(1.0, float(np.ptp(times))) + 4.0 * np.spacing(float(np.abs(times).max()))  # rounding
    outside = np.flatnonzero((image_times < times[0] - tolerance) | (image_times > times[-1] + tolerance))
    if len(outside):
        raise InputError("an image lies outside the times of the log", file=log.file, key=log.time_column,
                         expected=f"images within {times[0]:.12g} … {times[-1]:.12g} s",
                         found=f"image {outside[0]} at {image_times[outside[0]]:.12g} s",
                         remedy="check first_frame_s (time of the first image of the pattern) and frame_interval_s; "
                                "images beyond the ends of the log can be left out of the pattern")
    return MatchedLog(log, image_times, None)


def check_increasing(times: np.ndarray, file, key: str, lines=None) -> None:
    """InputError unless every time is later than the one before."""
    bad = np.flatnonzero(np.diff(times) <= 0)
    if len(bad):
        k = int(bad[0]) + 1
        place = f"{key}, line {lines[k]}" if lines is not None else key
        raise InputError("the times are not sorted", file=file, key=place,
                         expected=f"more than {times[k - 1]:.12g} s", found=f"{times[k]:.12g} s",
                         remedy="sort the rows by time and remove rows with equal times")
