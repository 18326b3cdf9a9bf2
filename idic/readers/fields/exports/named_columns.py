"""Columns of a table of points that the user names, [fields.columns]; and which names a table has, for messages."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from idic.readers.delimited.numerals import looks_numeric
from idic.readers.delimited.units import parse_unit, unit_in_name
from idic.readers.fields.stages.failed_points import Flag
from idic.readers.fields.stages.stage import cells_of, separator_of

COMMENT_MARKS = "#%!/ \t"  # before a header
_MIN_NUMBERS = 4  # in a row of points: positions and displacements


@dataclass(frozen=True)
class NamedColumns:
    """Names as in the header, with or without unit and in any case; None: no such column.

    unit : of lengths, None: as the header says; y_axis : direction of y and uy, None: down in px, else up
    flag : 0 where a point failed; quality : between `quality_min` and `quality_max` where it was measured
    """

    x: str
    y: str
    ux: str
    uy: str
    z: str | None = None
    uz: str | None = None
    id: str | None = None
    stage: str | None = None
    time: str | None = None
    flag: str | None = None
    quality: str | None = None
    quality_min: float | None = None
    quality_max: float | None = None
    unit: str | None = None
    y_axis: Literal["up", "down"] | None = None

    @property
    def needs(self) -> tuple[str, ...]:
        """All columns that are named."""
        names = (self.x, self.y, self.ux, self.uy, self.z, self.uz, self.id, self.stage, self.time, self.flag,
                 self.quality)
        return tuple(name for name in names if name is not None)

    @property
    def flags(self) -> tuple[Flag, ...]:
        """What says that a point failed."""
        flags = [] if self.flag is None else [Flag(self.flag, 0.5)]
        if self.quality is not None:
            least = -np.inf if self.quality_min is None else self.quality_min
            most = np.inf if self.quality_max is None else self.quality_max
            flags.append(Flag(self.quality, least, most=most))
        return tuple(flags)


def place_as_written(names: Sequence[str], name: str, plain: Sequence[str]) -> int | None:
    """The column of this name: as it stands, else in any case, else without unit; None where none or several are it.

    plain : the names without unit, in lower case
    """
    for candidates, key in ((names, name), ([column.lower() for column in names], name.lower()),
                            (plain, name.lower())):
        if candidates.count(key) == 1:
            return candidates.index(key)
    return None


def header_names(lines: Sequence[str]) -> tuple[str, ...]:
    """The names above the first row of points; empty without."""
    for k, line in enumerate(lines):
        separator = separator_of(line)
        cells = line.split() if separator == " " else cells_of(line, separator)
        if sum(looks_numeric(cell) for cell in cells) < _MIN_NUMBERS:
            continue
        above = [text for text in lines[:k] if text.strip(COMMENT_MARKS)]
        for text in reversed(above):
            text = text.lstrip(COMMENT_MARKS)
            names = text.split() if separator == " " else cells_of(text, separator)
            if len(names) == len(cells) and not are_units(names):
                return tuple(names)
        return ()
    return ()


def are_units(cells: Sequence[str]) -> bool:
    """Whether a row holds units, in brackets or without, one of them at least with a dimension."""
    units = [parse_unit(text) for cell in cells if (text := cell.strip("[]() ")) and text.lower() not in ("pixel",
                                                                                                        "pixels")]
    return bool(cells) and None not in units and not any(map(looks_numeric, cells)) and (
        any(any(unit.powers) for unit in units) or any("pixel" in cell.lower() for cell in cells))


def with_units(names: Sequence[str], units: Sequence[str]) -> tuple[str, ...]:
    """The names with the units of the row below them."""
    texts = [unit.strip("[]() ") for unit in units]
    return tuple(name if text in ("", "-", "1") or unit_in_name(name) is not None else f"{name} [{text}]"
                 for name, text in zip(names, texts, strict=True))

