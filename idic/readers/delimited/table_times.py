"""Which column of a log is its time: seconds by name and unit, else times of day by their cells; and what is not read.
"""

from __future__ import annotations

import re
from itertools import pairwise
from pathlib import Path

from idic.errors import InputError
from idic.readers.delimited.clock_times import (
    ClockError, ClockTimes, clock_format, clock_times, is_clock_time, is_date, is_dated,
)
from idic.readers.delimited.log_table import Table
from idic.readers.delimited.numerals import looks_numeric, number_in
from idic.readers.delimited.units import parse_unit, unit_in_name, without_unit

_TIME_NAMES = ("time", "t", "zeit")
_OF_DAY_NAMES = ("uhrzeit", "clock", "time of day", "timestamp", "time stamp", "datetime", "date time", "date/time",
                 "zeitstempel", "datum/zeit", "temps", "heure", "hora", "tiempo", "ora", "tempo")
_LABVIEW_X, _LABVIEW_TIME = "X_Value", ("X_Dimension", "Time")  # of .lvm: x is the time, in s
_MAX_SHOWN = 20  # characters of a cell in a note


def seconds_column(table: Table) -> str | None:
    """The column of numbers that is named time and has a unit of time: ``time_s``, ``t_ms``; else the only one with a
    unit of time that grows from row to row: ``Prüfzeit [s]``, ``Elapsed Time (Sec)``; None without."""
    columns = [name for name in table.names if name and _has_time_unit(table, name) and not _is_clock(table, name)]
    named_column = next((name for name in columns if without_unit(name).lower() in _TIME_NAMES), None)
    growing_columns = [] if named_column else [name for name in columns if _grows(table, name)]
    return growing_columns[0] if len(growing_columns) == 1 else named_column


def _has_time_unit(table: Table, name: str) -> bool:
    row_unit = table.units[table.names.index(name)]
    unit = parse_unit(row_unit or unit_in_name(name) or "")
    return (unit is not None and unit.dimension == "time") or (name == _LABVIEW_X and any(
        row[:2] == _LABVIEW_TIME for _, row in table.head_rows))


def _grows(table: Table, name: str) -> bool:
    """Whether every number of a column is larger than the one before."""
    numbers = [number_in(cell.replace(",", "."), ".") for cell in table.cells(name)]
    return len(numbers) > 1 and None not in numbers and all(a < b for a, b in pairwise(numbers))


def clock_column(table: Table) -> str | None:
    """The one column of times of day, or the one of them that is named as such; None where its times repeat."""
    columns = [name for name in table.names if _is_clock(table, name)]
    if len(columns) > 1:
        columns = [name for name in columns if _plain_name(name) in (*_TIME_NAMES, *_OF_DAY_NAMES)]
    return columns[0] if len(columns) == 1 and not _repeats(table, columns[0]) else None


def clock_of(table: Table, name: str, file: Path) -> ClockTimes:
    """The times of day in a column, with the dates of the column beside it where they show none.

    Raises
    ------
    InputError
        A cell is no time of day, or the column can be read in two ways.
    """
    unit_texts = (table.units[table.names.index(name)], re.sub(r"[^\[(]*", "", name, count=1))
    of_day = "h" if _plain_name(name) in _OF_DAY_NAMES else None
    try:
        return clock_times(table.cells(name), _dates_beside(table, name),
                           next(filter(None, map(clock_format, unit_texts)), of_day))
    except ClockError as error:
        raise clock_refusal(error, table, name, file) from None


def clock_refusal(error: ClockError, table: Table, name: str, file: Path) -> InputError:
    """The message of a column of times of day that is not certain."""
    return InputError(error.what, file=file, key=f"column {name}, line {table.lines[error.row]}",
                      expected=error.expected, found=error.finding, remedy=error.remedy)


def column_notes(table: Table, file: Path) -> list[str]:
    """How times of day are read, and which columns are not."""
    notes, unread, dates = [], [], None
    time_name = seconds_column(table)
    if time_name is None and (time_name := clock_column(table)) is not None:
        dates = _dates_beside(table, time_name)
        notes.append(f"{file.name}: column {time_name} is read as times of day, the first of them "
                     f"{table.first_cell(time_name)}" + (", with the dates beside it" if dates else ""))
    for k, name in enumerate(table.names):
        cell = table.first_cell(name)
        if not cell or name == time_name or (dates and is_date(cell)):
            continue
        if not name:
            unread.append(f"the {k + 1}. column has no name")
        elif _is_clock(table, name):
            unread.append(f"{name} " + ("shows the same time in rows that follow each other" if _repeats(table, name)
                                        else "holds times of day beside other times"))
        elif not looks_numeric(cell) or is_date(cell):
            unread.append(f"{name} holds no numbers ({cell[:_MAX_SHOWN]})")
        elif time_name is None and without_unit(name).lower() in _TIME_NAMES:
            unread.append(f"{name} has no unit of time (name it time_s if these are seconds)")
    return notes + ([f"{file.name}: not read: {'; '.join(unread)}"] if unread else [])


def _is_clock(table: Table, name: str) -> bool:
    return is_clock_time(table.first_cell(name))


def _repeats(table: Table, name: str) -> bool:
    """Whether a time of day stands in two rows that follow each other, as whole seconds of a log that is faster."""
    cells = table.cells(name)
    rows = list(zip(_dates_beside(table, name) or [""] * len(cells), cells, strict=True))
    return any(row == next_row for row, next_row in pairwise(rows))


def _dates_beside(table: Table, name: str) -> list[str] | None:
    """The cells of the one column of dates, for times that show no date; None without."""
    columns = [title for title in table.names if is_date(table.first_cell(title))]
    if len(columns) != 1 or is_dated(table.first_cell(name)):
        return None
    dates = table.cells(columns[0])
    return dates if all(map(is_date, dates)) else None


def _plain_name(name: str) -> str:
    """The name of a column in small letters, without what stands in brackets behind it and without its unit."""
    return re.sub(r"\s*[\[(].*", "", without_unit(name)).strip().lower()
