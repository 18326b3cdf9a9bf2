"""Numbers as text: decimal point or comma, signs, and thousands separators, which are refused and never guessed."""

from __future__ import annotations

import re
from collections.abc import Iterable

_NUMBER = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?|[+-]?(nan|inf)", re.IGNORECASE)
_LIKE_A_NUMBER = re.compile(r"[+-]?([0-9][0-9.,'’ \u00a0\u202f]*|[.,][0-9]+)([eE][+-]?[0-9]+)?|[+-]?(nan|inf)",
                            re.IGNORECASE)
_GROUPED = re.compile(r"[+-]?[0-9]{1,3}([.,'’ \u00a0\u202f])[0-9]{3}(\1[0-9]{3})*([.,][0-9]+)?")
_EITHER = re.compile(r"[+-]?[1-9][0-9]{0,2}[.,][0-9]{3}")  # 1.580: a decimal fraction, or 1580
_MINUS = "\u2212"  # typographic minus of spreadsheets and word processors
OTHER = {".": ",", ",": "."}


def plain(cell: str) -> str:
    """The cell without surrounding blanks, with the minus of the keyboard."""
    return cell.strip().replace(_MINUS, "-")


def looks_numeric(cell: str) -> bool:
    """Whether a cell is meant as a number, whatever its marks."""
    return _LIKE_A_NUMBER.fullmatch(plain(cell)) is not None


def number_in(cell: str, decimal: str) -> float | None:
    """The number with this decimal mark; None if the cell is none.

    Python's float() reads more: 1_0, and the digits of other scripts.
    """
    text = plain(cell)
    if OTHER[decimal] in text:
        return None
    text = text.replace(",", ".")
    return float(text) if _NUMBER.fullmatch(text) else None


def has_thousands(cell: str, decimal: str | None = None) -> bool:
    """Whether the cell holds thousands separators for certain; with `decimal`, also the other mark before 3 digits."""
    text = plain(cell)
    grouped = _GROUPED.fullmatch(text)
    if grouped is None:
        return False
    if decimal is not None:
        return grouped[1] != decimal
    return grouped[1] not in OTHER or len(re.findall(r"[.,]", text)) > 1


def certain_marks(cells: Iterable[str]) -> set[str]:
    """The decimal marks that the cells prove: 0.5, 12.25, 1.5e3 a point; 1.580 proves nothing, 1.580,5 a comma."""
    proved = set()
    for text in map(plain, cells):
        marks = re.findall(r"[.,]", text)
        if not marks or not looks_numeric(text):
            continue
        if len(marks) == 1 and not is_ambiguous(text):
            proved.add(marks[0])
        elif len(marks) > 1 and _GROUPED.fullmatch(text):
            proved.add(OTHER[marks[0]])
    return proved


def is_ambiguous(cell: str) -> bool:
    """Whether the one mark of a cell may be a decimal mark or a thousands separator: 1.580."""
    return _EITHER.fullmatch(plain(cell)) is not None
