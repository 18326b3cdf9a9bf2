"""Tables of Excel workbooks (.xlsx) as text, by openpyxl: logs, and stages of measured fields."""

from __future__ import annotations

import datetime
from pathlib import Path

from idic.errors import InputError
from idic.readers.formats.format import LOADS, Format

FORMAT = Format(LOADS, "Excel; also stages of fields", (".xlsx",), "openpyxl", "largest table",
                "one large table", "made by openpyxl", is_extra=True)
SEPARATOR = "\t"
_MAX_SECOND_SHARE = 0.5  # of the rows of the largest table: less is a sheet of results beside the record


def sheet_text(path: Path) -> str:
    """The cells of the sheet with the table, separated by tabs, numbers with a decimal point.

    Raises
    ------
    InputError
        openpyxl is missing, the file is damaged, or no sheet or several sheets hold a table.
    """
    sheets: dict[str, tuple[int, str]] = {}
    with FORMAT.decoded(path):
        from openpyxl import load_workbook

        workbook = load_workbook(path, read_only=True, data_only=True)
        for sheet in workbook.worksheets:
            rows = [tuple(map(_text, row)) for row in sheet.iter_rows(values_only=True)]
            n_columns = max((k + 1 for row in rows for k, cell in enumerate(row) if cell), default=0)
            n_numbers = sum(any(isinstance(cell, (int, float)) for cell in row)
                            for row in sheet.iter_rows(values_only=True))
            text = "\n".join(SEPARATOR.join(row[:n_columns]) for row in rows)
            sheets[sheet.title] = n_numbers, text
        workbook.close()
    ordered = sorted(sheets.items(), key=lambda item: -item[1][0])
    counts = [n_numbers for _, (n_numbers, _) in ordered]
    if not counts or not counts[0] or (len(counts) > 1 and counts[1] > _MAX_SECOND_SHARE * counts[0]):
        listing = ", ".join(f"{title} with {n_numbers}" for title, (n_numbers, _) in ordered)
        raise InputError("the workbook holds several tables" if counts and counts[0] else "the workbook is empty",
                         file=path, key="loads", expected="one sheet with rows of numbers", found=listing or "no sheet",
                         remedy="save the sheet with the record in a workbook of its own, or as CSV")
    return ordered[0][1][1]


def _text(cell: object) -> str:
    """A cell as idic reads it in a text file."""
    if cell is None:
        return ""
    if isinstance(cell, bool):
        return str(int(cell))
    if isinstance(cell, (datetime.datetime, datetime.date, datetime.time)):
        return cell.isoformat(sep=" ") if isinstance(cell, datetime.datetime) else cell.isoformat()
    return repr(cell) if isinstance(cell, (int, float)) else " ".join(str(cell).split())
