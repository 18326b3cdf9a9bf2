"""The table in the text of a log: separator, header, units and rows among the lines that instruments put around them.

Read are ``sep=;`` of Excel, lines before the header (operator, specimen, date), a row of units under the header, empty
columns at the right, empty rows at the end, and comments that start with #; a header may be one.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from idic.errors import InputError
from idic.readers.delimited.clock_times import clock_format, is_clock_time
from idic.readers.delimited.numerals import looks_numeric
from idic.readers.delimited.units import parse_unit

_SEPARATORS = (";", "\t", ",")
_EXCEL = re.compile(r'"?sep=(.)"?[;,]*', re.IGNORECASE)
_MAX_CELL = 100_000  # characters: below the limit of Python's csv
_MAX_LINES_OF_HEADER = 10  # over which its quoted cells are written
_LOOKED_AT = 1000  # lines in which the separator shows


@dataclass(frozen=True)
class Table:
    """Cells of a log as text.

    names : header; units : of the units row, "" where none; head_rows : rows of text above the header; lines : line in
    the file of each row
    """

    separator: str
    header_line: int
    names: tuple[str, ...]
    units: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    lines: tuple[int, ...]
    head_rows: tuple[tuple[int, tuple[str, ...]], ...]

    def cells(self, name: str) -> list[str]:
        """The cells of a column."""
        index = self.names.index(name)
        return [row[index] for row in self.rows]

    def first_cell(self, name: str) -> str:
        """The first cell of a column that is not empty; "" without one."""
        index = self.names.index(name)
        return next((row[index].strip() for row in self.rows if row[index].strip()), "")


def read_table(text: str, path: Path) -> Table:
    """Find header, units and rows.

    Raises
    ------
    InputError
        There is no header or no row, a column name occurs twice, a row has another number of cells, or a cell is
        longer than any number.
    """
    all_lines = [(number, line) for number, line in _whole_lines(text.splitlines()) if line.strip()]
    lines = [(number, line) for number, line in all_lines if not _is_comment(line)]
    separators: tuple[str, ...] = _SEPARATORS
    if lines and (excel := _EXCEL.fullmatch(lines[0][1].strip(" "))):
        separators, lines = (excel[1],), lines[1:]
    if len(lines) < 2 and not (lines and _is_row(lines[0][1])):
        raise InputError("the log is empty", file=path, key="loads", expected="a header row and one row per image",
                         found=f"{len(lines)} rows", remedy="export the log again")
    separator, cells, (header, first) = _split(lines, separators, path)
    if header is None:  # it may be a comment
        separator, cells, (header, first) = _split(_with_comments(all_lines, lines), separators, path)
    if header is None and not any(map(_has_value, (row for _, row in cells))):
        raise InputError("the log has no row of numbers", file=path, key=f"line {cells[1][0]}",
                         expected="a row of numbers for every image below the header", found=", ".join(cells[1][1]),
                         remedy="export the log again")
    if header is None:
        raise InputError("the log has no header row", file=path, key=f"line {cells[0][0]}",
                         expected="column names such as frame,time_s,force_N", found=", ".join(cells[0][1]),
                         remedy="add a first line with the names of the columns")
    names, units = cells[header][1], cells[header + 1][1] if first == header + 2 else ()
    names = (names[0].lstrip("%/ ") or names[0], *names[1:])  # marks of comments in other programs
    rows = cells[first:]
    names = names[:max(_width(names), *(_width(row) for _, row in rows))]  # without columns of nothing at the end
    n = len(names)
    _check_names(names, path)
    _refuse_shifted_row(names, rows, path)
    table_rows = []
    for number, row in rows:
        row = row[:n] if not any(row[n:]) else row
        if len(row) != n:
            raise InputError("a row of the log has another number of cells than its header", file=path,
                             key=f"line {number}", expected=f"{n} cells: {', '.join(names)}", found=f"{len(row)} cells",
                             remedy="correct the row; with a comma as separator, numbers need a decimal point")
        table_rows.append(row)
    units = tuple(cell.strip("[]() ") for cell in units[:n])
    return Table(separator, cells[header][0], names, units + ("",) * (n - len(units)), tuple(table_rows),
                 tuple(k for k, _ in rows),
                 tuple(cells[:header]))


def _width(cells: Sequence[str]) -> int:
    """Cells up to the last one that holds something."""
    return len(cells) - next((k for k, cell in enumerate(reversed(cells)) if cell), len(cells))


def _split(lines: Sequence[tuple[int, str]], separators: Sequence[str],
           path: Path) -> tuple[str, list[tuple[int, tuple[str, ...]]], tuple[int | None, int]]:
    """The separator, the cells of every line, and the places of the header and of the first row of numbers."""
    separator = next((mark for mark in separators[:-1] if _separates(lines[:_LOOKED_AT], mark, path)), separators[-1])
    if separator == "," and "," not in lines[0][1] and all(is_clock_time(line) for _, line in lines[1:]):
        separator = _SEPARATORS[0]  # one column of times, in which a comma separates the decimals
    cells = [(number, _cells(line, separator, number, path)) for number, line in lines]
    while len(cells) > 2 and not any(cells[-1][1]):
        cells.pop()
    return separator, cells, _header(cells)


def _whole_lines(lines: Sequence[str]) -> Iterator[tuple[int, str]]:
    """Numbers and lines; a quoted cell that is written over several lines, as ``"Force`` and ``[N]"``, in one."""
    k = 0
    while k < len(lines):
        last_line = k
        if '"' in lines[k] and not lines[k].lstrip().startswith("#") and _ends_in_quotes(lines[k]):
            joined = lines[k]
            for end in range(k + 1, min(k + 1 + _MAX_LINES_OF_HEADER, len(lines))):
                joined += f" {lines[end].strip()}"
                if not _ends_in_quotes(joined):
                    last_line = end
                    break
        yield k + 1, joined if last_line > k else lines[k]
        k = last_line + 1


def _ends_in_quotes(line: str) -> bool:
    """Whether the last quoted cell of a line goes on in the next one; an inch within a cell quotes nothing."""
    inside, previous = False, ";"
    for letter in line:
        if letter == '"':
            inside = not inside if inside else previous in ',;\t|"'
        previous = letter if letter != " " else previous
    return inside


def _refuse_shifted_row(names: tuple[str, ...], rows: Sequence[tuple[int, tuple[str, ...]]], path: Path) -> None:
    """A number below a last column without a name that is empty in other rows: a cell too many stands to its left."""
    n = len(names)
    below = [row[n - 1] if len(row) >= n else "" for _, row in rows]
    if names[-1:] != ("",) or all(below):
        return
    for (number, _), cell in zip(rows, below, strict=True):
        if looks_numeric(cell):
            raise InputError("a row of the log has another number of cells than its header", file=path,
                             key=f"line {number}",
                             expected=f"{n - 1} cells: {', '.join(names[:-1])}", found=f"{cell} below no name",
                             remedy="correct the row, or give the last column a name")


def _cells(line: str, separator: str, number: int, path: Path) -> tuple[str, ...]:
    try:
        cells = tuple(cell.strip() for cell in next(csv.reader([line], delimiter=separator)))
    except csv.Error as problem:
        raise _too_long(path, number, str(problem)) from None
    if max(map(len, cells)) > _MAX_CELL:
        raise _too_long(path, number, f"{max(map(len, cells))} characters")
    return cells


def _too_long(path: Path, number: int, cell: str) -> InputError:
    return InputError("a cell of the log is longer than any number", file=path, key=f"line {number}",
                      expected=f"cells of up to {_MAX_CELL} characters", found=cell, remedy="export the log again")


def _separates(lines: list[tuple[int, str]], separator: str, path: Path) -> bool:
    """Whether the separator makes a header and a row of two cells or more."""
    cells = [(number, _cells(line, separator, number, path)) for number, line in lines if separator in line]
    header, first = _header(cells) if separator in lines[-1][1] else (None, 0)
    return header is not None and min(len(cells[header][1]), len(cells[first][1])) > 1


def _header(cells: list[tuple[int, tuple[str, ...]]]) -> tuple[int | None, int]:
    """Places of the header and of the first row of numbers: the last row of text that a row with a number follows."""
    numbers = [_has_value(row) for _, row in cells]
    text = [any(row) and not has_number for (_, row), has_number in zip(cells, numbers, strict=True)]
    last_text = next((k for k in reversed(range(len(cells) - 1)) if text[k] and numbers[k + 1]), None)
    if last_text is None:
        return None, 0
    if last_text > 0 and text[last_text
                              - 1] and _are_units(cells[last_text][1]) and not _are_units(cells[last_text - 1][1]):
        return last_text - 1, last_text + 1
    return last_text, last_text + 1


def _has_value(row: tuple[str, ...]) -> bool:
    """Whether a cell of the row is a number or a time of day."""
    return any(looks_numeric(cell) or is_clock_time(cell) for cell in row)


def _are_units(row: tuple[str, ...]) -> bool:
    """Whether most of the cells are units or formats of clocks, at least one of them with a dimension."""
    texts = [cell.strip("[]() ") for cell in row if cell.strip("[]() ")]
    n_clocks = sum(clock_format(text) is not None for text in texts)
    units = [unit for unit in map(parse_unit, texts) if unit is not None]
    return 2 * (len(units) + n_clocks) > len(texts) and (n_clocks > 0 or any(any(unit.powers) for unit in units))


# comments ---------------------------------------------------------------------------------------------
def _is_comment(line: str) -> bool:
    return line.lstrip().startswith("#")


def _is_row(line: str) -> bool:
    """Whether a line begins with a number or a time of day, and so is no header."""
    cell = re.split(r"[;,\t]", line)[0].strip(' "')
    return looks_numeric(cell) or is_clock_time(cell) or is_clock_time(line)


def _with_comments(all_lines: Sequence[tuple[int, str]], lines: Sequence[tuple[int, str]]) -> list[tuple[int, str]]:
    """The lines with the comments above the first of them that have as many cells as it, without their marks."""
    marks = {mark: lines[0][1].count(mark) for mark in _SEPARATORS}
    above = [(number, line.lstrip("# ").rstrip()) for number, line in all_lines
             if number < lines[0][0] and _is_comment(line)]
    names = [(number, line) for number, line in above if line.strip('#=-* "') and not _is_row(line)
             and (not any(marks.values()) or any(n > 0 and line.count(mark) == n for mark, n in marks.items()))]
    return [*names[-2:], *lines]


def _check_names(names: tuple[str, ...], path: Path) -> None:
    twice = sorted({name for name in names if name and names.count(name) > 1})
    if twice:
        raise InputError("a column name occurs twice", file=path, key=twice[0], expected="every name once",
                         found=", ".join(names), remedy="rename one of them")
