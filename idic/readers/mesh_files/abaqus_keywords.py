"""The keyword lines of an Abaqus or CalculiX input file with their options and data lines."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from idic.readers.mesh_files.deck_lines import DeckLine, DeckLines, Place

_CELLS = re.compile(r'(?:[^,"]|"[^"]*"?)+|(?<=,)(?=,)|^(?=,)|(?<=,)$')  # between commas; quotes hold names with commas
_INCLUDE = re.compile(r"\*\s*include\s*,(.*)", re.IGNORECASE)


@dataclass
class Row:
    """A data line: its cells, and whether it ends in a comma."""

    place: Place
    cells: list[str]
    goes_on: bool


@dataclass
class Keyword:
    """A keyword line, e.g. ``*NSET, NSET=LEFT, GENERATE``, with its data lines; name and options in capitals."""

    place: Place
    name: str
    options: dict[str, str]
    rows: list[Row] = field(default_factory=list)


def keyword_lines(path: Path) -> DeckLines:
    """The lines of an input file, those of ``*INCLUDE, INPUT=FILE`` among them."""
    return DeckLines(path, _included)


def keywords(lines: DeckLines) -> Iterator[Keyword]:
    """Every keyword of a file; ``INPUT=FILE`` in *NODE, *ELEMENT and sets gives the data lines of another file."""
    keyword: Keyword | None = None
    pending = ""
    for line in lines:
        text, pending = pending + line.text.strip(), ""
        if not text or text.startswith("**"):
            continue
        if text.startswith("*"):
            if text.endswith(","):
                pending = text
                continue
            if keyword is not None:
                yield keyword
            keyword = _keyword(line.place, text)
            if "INPUT" in keyword.options:
                keyword.rows += [_row(inner) for inner in lines.include(keyword.options["INPUT"], line.place)
                                 if inner.text.strip() and not inner.text.lstrip().startswith("*")]
        elif keyword is not None:
            keyword.rows.append(_row(DeckLine(line.place, text)))
    if keyword is not None:
        yield keyword


def _keyword(place: Place, text: str) -> Keyword:
    name, *parts = split(text[1:])
    pairs = [part.partition("=") for part in parts if part]
    options = {key.strip().upper(): unquoted(value) for key, _, value in pairs}
    return Keyword(place, " ".join(name.upper().split()), options)


def _row(line: DeckLine) -> Row:
    return Row(line.place, [unquoted(cell) for cell in split(line.text.strip())], line.text.rstrip().endswith(","))


def split(text: str) -> list[str]:
    """The cells between the commas of a line, without surrounding blanks."""
    if '"' not in text:
        return [cell.strip() for cell in text.split(",")]
    return [cell.strip() for cell in _CELLS.findall(text)]


def unquoted(text: str) -> str:
    """A name without the quotation marks around it."""
    return text.strip().strip('"')


def _included(text: str) -> str | None:
    """The file of an *INCLUDE line."""
    match = _INCLUDE.match(text.strip())
    if match is None:
        return None
    for part in split(match.group(1)):
        key, _, value = part.partition("=")
        if key.strip().upper() == "INPUT":
            return unquoted(value)
    return None
