"""A table of texts, which a terminal lays out as it likes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field


@dataclass
class TextTable:
    """Column titles and rows of equal length; columns of words are aligned to the left, numbers to the right.

    words : titles of the columns that hold words; unbroken : those that are never broken over two lines
    """

    titles: tuple[str, ...]
    words: frozenset[str]
    unbroken: frozenset[str] = frozenset()
    rows: list[Sequence[str]] = field(default_factory=list)

    def add_row(self, *cells: str) -> None:
        """Add a row of as many cells as there are titles."""
        if len(cells) != len(self.titles):
            raise ValueError(f"{len(cells)} cells, {len(self.titles)} columns")
        self.rows.append(cells)


@dataclass(frozen=True)
class Line:
    """A line of text; style : "bold" | "dim" | "" """

    text: str
    style: str = ""
