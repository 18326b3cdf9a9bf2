"""The bulk data of a Nastran file as cards: fields of 8 or 16 columns, or between commas, over several lines.

MSC Nastran Quick Reference Guide, "Bulk data entries: formats of bulk data entries".
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from idic.input_decks import fortran_real
from idic.readers.mesh_files.deck_lines import DeckLine, DeckLines, Place, fail

_FIELDS_OF_CARD, _NAME_COLUMNS, _MARK_COLUMN = 8, 8, 72  # of a line: 8 fields, or half of them where they are wide
_BEGIN = re.compile(r"\s*BEGIN\s*(BULK|$)", re.IGNORECASE)
_END = re.compile(r"\s*ENDDATA\b", re.IGNORECASE)
_INCLUDE = re.compile(r"\s*INCLUDE\s*[ ='\"]\s*['\"]?([^'\"$]+)", re.IGNORECASE)


@dataclass
class Card:
    """A bulk data entry: its name in capitals, and the fields after it as text, "" where blank."""

    place: Place
    name: str
    fields: list[str]

    def text(self, k: int) -> str:
        """Field k, counted from 0 behind the name."""
        return self.fields[k] if k < len(self.fields) else ""

    def integer(self, k: int, quantity: str, default: int | None = None) -> int:
        """A whole number; InputError with the line if it is none, or is blank and has no default."""
        if not (text := self.text(k)) and default is not None:
            return default
        if re.fullmatch(r"[+-]?[0-9]{1,9}", text) is None:
            fail(self.place, f"{self.name}: {quantity} is not a whole number", "a number of up to nine digits",
                 repr(text) if text else f"a blank field {k + 2}")
        return int(text)

    def real(self, k: int, quantity: str) -> float:
        """A number, 0 where blank; InputError with the line if it is none."""
        if not (text := self.text(k)):
            return 0.0
        try:
            return fortran_real(text)
        except ValueError:
            return fail(self.place, f"{self.name}: {quantity} is not a number", "a number such as 1.5, 1.5+3 or 1.5E3",
                        repr(text))


@dataclass
class _Line:
    """A line as name, fields and the marks that join it to the line before and behind."""

    place: Place
    name: str
    fields: list[str]
    is_wide: bool
    mark: str

    @property
    def continues(self) -> bool:
        return not self.name or self.name[0] in "+*"


def nastran_lines(path: Path) -> DeckLines:
    """The lines of a Nastran file, those of ``INCLUDE 'FILE'`` among them."""
    return DeckLines(path, _included)


def cards(lines: DeckLines) -> Iterator[Card]:
    """Every entry of the bulk data; a file without BEGIN BULK is bulk data alone.

    Raises
    ------
    InputError
        A line that continues none, lines out of order, or repeated by ``=``; with the line.
    """
    card: Card | None = None
    mark = ""
    for line in _bulk(lines):
        if line.name.startswith("="):
            fail(line.place, "a card that repeats the one before it", "every card with all its fields", line.name,
                 "let the program that wrote the file expand such cards")
        if not line.continues:
            if card is not None:
                yield card
            card = Card(line.place, line.name.rstrip("*").rstrip().upper(), list(line.fields))
        elif card is not None:
            label = line.name.lstrip("+*").strip()
            if mark and label and mark.lstrip("+*").strip() != label:
                fail(line.place, f"{card.name}: its lines are not in order", f"the line that begins with {mark}",
                     line.name, "let the program that wrote the file sort it")
            if not line.is_wide and len(card.fields) % _FIELDS_OF_CARD:
                card.fields += [""] * (-len(card.fields) % _FIELDS_OF_CARD)
            card.fields += line.fields
        else:
            fail(line.place, "a line that continues no card", "the name of a card first", line.name or "a blank name")
        mark = line.mark
    if card is not None:
        yield card


def _bulk(lines: DeckLines) -> Iterator[_Line]:
    listed = list(lines)
    begin = next((k for k, line in enumerate(listed) if _BEGIN.match(line.text)), -1)
    for line in listed[begin + 1:]:
        if _END.match(line.text):
            return
        text = line.text.partition("$")[0].rstrip()
        if text.strip():
            yield _free(line, text) if "," in text else _columns(line, text.expandtabs(_NAME_COLUMNS))


def _free(line: DeckLine, text: str) -> _Line:
    name, *cells = [cell.strip() for cell in text.split(",")]
    is_wide = "*" in name
    number = _FIELDS_OF_CARD // 2 if is_wide else _FIELDS_OF_CARD
    mark, excess = "".join(cells[number:number + 1]), [cell for cell in cells[number + 1:] if cell]
    if excess or (mark and mark[0] not in "+*" and re.fullmatch(r"[+-]?[\d.]+.*", mark)):
        fail(line.place, f"{name}: more fields than a line has",
             f"{number} fields behind the name, then the mark of the next line", text,
             "write the further fields on a line that begins with a comma")
    return _Line(line.place, name, (cells[:number] + [""] * number)[:number], is_wide, mark)


def _columns(line: DeckLine, text: str) -> _Line:
    name = text[:_NAME_COLUMNS].strip()
    is_wide = "*" in name
    width = 2 * _NAME_COLUMNS if is_wide else _NAME_COLUMNS
    fields = [text[k:k + width].strip() for k in range(_NAME_COLUMNS, _MARK_COLUMN, width)]
    return _Line(line.place, name, fields, is_wide, text[_MARK_COLUMN:_MARK_COLUMN + _NAME_COLUMNS].strip())


def _included(text: str) -> str | None:
    match = _INCLUDE.match(text)
    return None if match is None else match.group(1).strip()
