"""Stages as ARAMIS and GOM Correlate export them: named blocks of semicolons in one CSV file per stage.

    # Units: length:mm angle:deg time:s force:N
    # Stage: ...            stage;index;relative_time;date         one row
    # Name : ANALOG INPUT   force;untransformed;transformed        one row: the first cell is the transformed value
    # Name : SURFACE        id;x;y;z[;displacement_x;…]            one row per point, where it is in this stage

A point's displacement is its change of position against the reference stage, by `id`. Columns displacement_x, … tell
which points were lost, and are the displacement where x;y;z are those of the reference.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from idic.errors import InputError
from idic.readers.delimited.numerals import number_in
from idic.readers.fields.stages.failed_points import names_of, sound_points
from idic.readers.fields.stages.stage import KEY, Stage, cells_of, numbers_of, stage_text
from idic.readers.delimited.units import factor_between

_HEAD = 4096  # characters: units, stage and analog channels stand before the points


@dataclass(frozen=True)
class _Block:
    """name : after "# Name :", or the word after #; first : line of the header row; lines : header and rows."""

    name: str
    first: int
    lines: list[str]

    @property
    def header(self) -> list[str]:
        return cells_of(self.lines[0], ";")


def is_aramis(text: str) -> bool:
    """Whether a file begins like an ARAMIS export."""
    head = text[:_HEAD]
    return head.lstrip().startswith("#") and "# Stage" in head and "relative_time" in head


def read_aramis(path: Path) -> Stage:
    """One stage with its points.

    Raises
    ------
    InputError
        The file holds no points, is cut off, or names a point twice.
    """
    units, blocks = _blocks(stage_text(path))
    block = next((block for block in blocks if {"id", "x", "y"} <= set(block.header)), None)
    if block is None:
        raise InputError("a stage without points", file=path, key=KEY, expected="a block id;x;y;z",
                         found=", ".join(block.name for block in blocks) or "no block",
                         remedy="export the deformed points of the surface component, or remove the file from the "
                                "pattern")
    names = block.header
    values = numbers_of(block.lines[1:], len(names), ";", path, block.first + 1)
    axes = [name for name in ("x", "y", "z") if name in names]
    shifts = [f"displacement_{axis}" for axis in axes]
    displacement = values[:, [names.index(name) for name in shifts]] if set(shifts) <= set(names) else None
    flags = {name.lower(): values[:, k] for k, name in enumerate(names)}
    ids = names_of(values[:, names.index("id")])
    sound = sound_points(values[:, [names.index(name) for name in axes]], displacement, ids, "aramis", flags)
    labels, count = np.unique(sound.ids, return_counts=True)
    if (count > 1).any():
        raise InputError("a point occurs twice in a stage", file=path, key=f"id {labels[count > 1][0]}",
                         expected="every id once", found=f"{int((count > 1).sum())} ids more than once",
                         remedy="export one surface component only")
    time, analog = _channels(units, blocks, path)
    return Stage(sound.points, sound.displacement, units.get("length", "mm"), sound.ids, time, analog, tuple(names),
                 failed=sound.failed, placeless=sound.placeless)


def read_aramis_head(path: Path) -> tuple[float | None, dict[str, tuple[float, str | None]]]:
    """Time and analog channels of a stage; of its points nothing is read."""
    with path.open("rb") as stream:
        data = stream.read(_HEAD)
    from idic.readers.delimited.text_files import text_of

    text = text_of(data[:data.rfind(b"\n") + 1] or data, path, KEY)[0]
    units, blocks = _blocks(text)
    return _channels(units, blocks, path)


def _blocks(text: str) -> tuple[dict[str, str], list[_Block]]:
    units: dict[str, str] = {}
    blocks: list[_Block] = []
    lines = text.splitlines()
    marks = [k for k, line in enumerate(lines) if line[:1] == "#"]
    for mark, end in zip(marks, [*marks[1:], len(lines)], strict=True):
        key, _, value = lines[mark][1:].partition(":")
        if key.strip().lower() == "units":
            units = dict(_pairs(value))
        else:
            blocks.append(_Block(value.strip(), mark + 2, []))
        if blocks:
            rows = lines[mark + 1:end]
            blocks[-1].lines.extend(rows if all(map(str.strip, rows)) else filter(str.strip, rows))
    return units, [block for block in blocks if block.lines]


def _pairs(text: str) -> Iterator[tuple[str, str]]:
    for word in text.split():
        name, _, unit = word.partition(":")
        if unit:
            yield name, unit


def _channels(units, blocks, path: Path) -> tuple[float | None, dict[str, tuple[float, str | None]]]:
    time, channels = None, []
    for block in blocks:
        header = block.header
        if len(block.lines) < 2:
            continue
        cells = cells_of(block.lines[1], ";")
        cells += [""] * (len(header) - len(cells))
        if "relative_time" in header:
            time = _value(cells[header.index("relative_time")], path, block.first + 1, "relative_time")
            time *= factor_between(units.get("time", "s"), "s", file=path, key="# Units: time")
        elif "untransformed" in header and "transformed" in header:
            value = _value(cells[header.index("transformed")], path, block.first + 1, header[0])
            channels.append((header[0], block.name, value))
    quantities = [quantity for quantity, _, _ in channels]
    return time, {quantity if quantities.count(quantity) == 1 else name: (value, units.get(quantity))
                  for quantity, name, value in channels}


def _value(cell: str, path: Path, line: int, name: str) -> float:
    value = number_in(cell, "," if "," in cell else ".")
    if value is None or not np.isfinite(value):
        raise InputError("a value of a stage is not a number", file=path, key=f"{name}, line {line}",
                         expected="a finite number", found=repr(cell), remedy="export the stage again")
    return value
