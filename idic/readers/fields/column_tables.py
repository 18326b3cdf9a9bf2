"""Stages as tables of columns: VIC-2D and VIC-3D, MatchID, DICe, pyvale, al-dic, sun-dic, node maps of ARAMIS, a plain
table of all stages, or any table whose columns the user names.

A dialect names the columns of its system; units stand in brackets behind the names, or are those of the system.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from idic.errors import InputError
from idic.readers.fields.exports.named_columns import (
    COMMENT_MARKS, NamedColumns, are_units, header_names, place_as_written, with_units,
)
from idic.readers.fields.exports.nodemap import signals_of
from idic.readers.formats.format import FIELDS, Format
from idic.readers.fields.stages.failed_points import FLAGS, in_words, names_of, sound_points
from idic.readers.fields.stages.stage import KEY, Stage, cells_of, numbers_of, separator_of, stage_text
from idic.readers.delimited.units import factor_to, unit_in_name, without_unit


@dataclass(frozen=True)
class Dialect:
    """Column names of a system, without units; the third of `points` and `displacement` may be missing in a file.

    unit : of lengths, where the header names none; needs : columns without which a file is of another dialect; named :
    columns that the user names, in the place of those of a system. Flags of failed points:
    `idic.readers.fields.stages.failed_points`
    """

    name: str
    points: tuple[str, str, str]
    displacement: tuple[str, str, str]
    unit: str
    ids: str | None = None
    stage: tuple[str, ...] = ()
    time: tuple[str, ...] = ()
    exact_case: bool = False
    needs: tuple[str, ...] = ()
    v_upwards: bool = False
    named: NamedColumns | None = None

    @classmethod
    def of_user(cls, named: NamedColumns) -> Dialect:
        """The columns that the user names."""
        return cls(NAMED, (named.x, named.y, named.z or "-"), (named.ux, named.uy, named.uz or "-"), named.unit or "mm",
                   named.id, (named.stage,) if named.stage else (), (named.time,) if named.time else (),
                   needs=named.needs, named=named)

    def rows_down(self, unit: str) -> bool:
        """Whether y counts downwards, as the rows of an image do, in this unit."""
        axis = self.named.y_axis if self.named is not None else None
        return unit == "px" if axis is None else axis == "down"


NAMED = "columns"
STAGE_COLUMNS = ("stage", "frame")
DIALECTS = (
    Dialect("vic", ("X", "Y", "Z"), ("U", "V", "W"), "mm", exact_case=True),
    # VIC-2D writes pixels, which VIC-3D writes next to X, Y, Z; sigma is -1 where a subset was not correlated
    Dialect("vic", ("x", "y", "-"), ("u", "v", "-"), "px", exact_case=True, needs=("sigma",)),
    Dialect("matchid", ("coor.x", "coor.y", "coor.z"),
            ("disp.horizontal displacement u", "disp.vertical displacement v", "disp.out-of-plane: w"), "px"),
    Dialect("matchid", ("coordinates.image x", "coordinates.image y", "-"),
            ("disp.horizontal displacement u", "disp.vertical displacement v", "-"), "px"),
    Dialect("dice", ("model_coordinates_x", "model_coordinates_y", "model_coordinates_z"),
            ("model_displacement_x", "model_displacement_y", "model_displacement_z"), "mm", "subset_id"),
    Dialect("dice", ("coordinate_x", "coordinate_y", "-"), ("displacement_x", "displacement_y", "-"), "px",
            "subset_id"),
    Dialect("pyvale", ("stereo_x_mm", "stereo_y_mm", "stereo_z_mm"),
            ("stereo_disp_u_mm", "stereo_disp_v_mm", "stereo_disp_w_mm"), "mm"),
    Dialect("pyvale", ("subset_x", "subset_y", "-"), ("disp_u", "disp_v", "-"), "px"),
    Dialect("pyvale", ("ss_x", "ss_y", "-"), ("displacement_u", "displacement_v", "-"), "px"),
    Dialect("al-dic", ("x", "y", "-"), ("disp_u", "disp_v", "-"), "px", "node_id", needs=("node_id",), v_upwards=True),
    Dialect("sun-dic", ("x coord", "y coord", "-"), ("x disp", "y disp", "-"), "px"),
    Dialect("nodemap", ("x_undef", "y_undef", "z_undef"), ("u", "v", "w"), "mm", "id"),
    Dialect("table", ("x", "y", "z"), ("ux", "uy", "uz"), "mm", "id", stage=STAGE_COLUMNS, time=("time", "t")),
    Dialect("table", ("x", "y", "z"), ("u", "v", "w"), "mm", "id", stage=STAGE_COLUMNS, time=("time", "t")),
)
DIALECT_NAMES = tuple(dict.fromkeys(dialect.name for dialect in DIALECTS))
_TABLES = (".csv", ".txt", ".dat", ".xlsx")
_ASKED, _MADE = "pixel_size_mm if in px", "made"
FORMATS = (
    Format(FIELDS, "VIC-2D, VIC-3D", _TABLES, "", "sigma", _ASKED, "made"),
    Format(FIELDS, "MatchID", _TABLES, "", "units", _ASKED,
           "made: columns of 2023, 2024"),
    Format(FIELDS, "DICe", _TABLES, "", "SIGMA, MATCH, GAMMA, BETA", _ASKED,
           "solutions of its tests; made"),
    Format(FIELDS, "pyvale", _TABLES, "", "convergence, correlation", _ASKED,
           "of pyvale 2026; made"),
    Format(FIELDS, "al-dic", _TABLES, "", "", _ASKED, "of al-dic 1.0; made"),
    Format(FIELDS, "sun-dic, CSV", _TABLES, "", "", _ASKED, _MADE),
    Format(FIELDS, "node maps of ARAMIS", _TABLES, "", "signals, time",
           "units of signals", "made by a laboratory's layout"),
    Format(FIELDS, "plain tables", _TABLES, "", "stage, time, unit",
           "fields_unit if none is named", "made"),
    Format(FIELDS, "any other table", _TABLES, "", "flag, quality, units",
           "[fields.columns]", "made: comments, units, orders"),
)
_NUMBER = re.compile(r"[+-]?[\d.]")
_MAX_LINES_ABOVE = 200  # before the header: title, date, settings, signals
_UPWARDS = np.array([1.0, -1.0, 1.0])
_PIXEL_UNITS = ("pixel", "pixels", "px")


@dataclass(frozen=True)
class Columns:
    """Header of a file and where the dialect's columns are in it."""

    dialect: Dialect
    names: tuple[str, ...]
    separator: str
    first_row: int  # line of the first row of numbers
    unit: str

    def place(self, name: str) -> int | None:
        """The column of this name, without its unit, else as it stands; None if there is none."""
        if self.dialect.named is not None:
            return place_as_written(self.names, name, self.keys)
        columns = self.keys if name in self.keys else [column.lower() for column in self.names]
        return columns.index(name) if name in columns else None

    @cached_property
    def keys(self) -> list[str]:
        """`key_of` of every name; each different name once, since a line may have a hundred thousand empty ones."""
        keys = {name: key_of(name, self.dialect.exact_case) for name in set(self.names)}
        return [keys[name] for name in self.names]

    @property
    def n_components(self) -> int:
        """3 where points and displacements have a third coordinate."""
        third = (self.dialect.points[2], self.dialect.displacement[2])
        return 2 if any(self.place(name) is None for name in third) else 3


def key_of(column: str, exact_case: bool = False) -> str:
    """A column name without unit and blanks: ``coor.X [mm]`` -> ``coor.x``."""
    name = re.sub(r"\s*[\[(][^\])]*[\])]\s*$", "", column.strip().strip('"')).strip()
    name = without_unit(name) if unit_in_name(name) else name
    return name if exact_case else name.lower()


def unit_of(column: str) -> str | None:
    """The unit behind a column name; "px" for pixels, None without."""
    match = re.search(r"[\[(]([^\])]*)[\])]\s*$", column.strip().strip('"'))
    text = match[1].strip() if match else unit_in_name(column.strip())
    return "px" if text and text.lower() in _PIXEL_UNITS else text or None


def find_columns(lines: Sequence[str], dialect_name: str | Dialect | None = None) -> Columns | None:
    """The first line that is the header of a known dialect; None if there is none.

    dialect_name : name of a dialect, None: any; or the columns of the user
    """
    dialects = (dialect_name,) if isinstance(dialect_name, Dialect) else tuple(
        dialect for dialect in DIALECTS if dialect_name in (None, "auto", dialect.name))
    for number, line in enumerate(lines[:_MAX_LINES_ABOVE]):
        if not line.strip() or _NUMBER.match(line.lstrip(' "')):
            continue
        text = line.lstrip(COMMENT_MARKS)
        separator = separator_of(text)
        names = tuple(text.split() if separator == " " else cells_of(text, separator))
        for dialect in dialects:
            if dialect.exact_case and dialect_name != dialect.name and any(key_of(name) in STAGE_COLUMNS
                                                                           for name in set(names)):
                continue  # VIC writes a file per stage: X, Y, U, V of all stages are a plain table
            columns = Columns(dialect, names, separator, number + 2, dialect.unit)
            needed = (*dialect.points[:2], *dialect.displacement[:2], *dialect.needs)
            if all(columns.place(name) is not None for name in needed):
                return _with_unit(columns, lines[number + 1:number + 2])
    return None


def _with_unit(columns: Columns, below: Sequence[str]) -> Columns:
    """The columns with the unit of their header, or of a row of units below it."""
    dialect, names, first_row = columns.dialect, columns.names, columns.first_row
    for line in below:
        text = line.lstrip(COMMENT_MARKS)
        cells = text.split() if columns.separator == " " else cells_of(text, columns.separator)
        if len(cells) == len(names) and are_units(cells):
            names, first_row = with_units(names, cells), first_row + 1
    unit = unit_of(names[columns.place(dialect.points[0])])
    stated_unit = dialect.named.unit if dialect.named is not None else None
    return Columns(dialect, names, columns.separator, first_row, stated_unit or unit or dialect.unit)


def read_columns(path: Path, dialect_name: str | Dialect | None = None) -> list[tuple[float, Stage]]:
    """The stages of a file with their numbers in its stage column, in the order of these; one stage where there is no
    such column.

    Raises
    ------
    InputError
        No dialect has these columns, a row is cut off, units differ between the columns, or a point occurs twice.
    """
    lines = stage_text(path).splitlines()
    columns = find_columns(lines, dialect_name)
    if columns is None and isinstance(dialect_name, Dialect):
        raise missing_columns(dialect_name, lines, path)
    if columns is None:
        raise InputError("no columns of positions and displacements", file=path, key=KEY,
                         expected="columns of " + ", ".join(DIALECT_NAMES) + ", e.g. stage,x_mm,y_mm,ux_mm,uy_mm",
                         found=found_in(lines),
                         remedy="name its columns in [fields.columns], export positions and displacements of the "
                         "points, or name the format in fields_format")
    rows = [line for line in lines[columns.first_row - 1:] if line.strip() and not line.lstrip().startswith("#")]
    columns, rows = _without_last_separator(columns, rows)
    values = numbers_of(rows, len(columns.names), columns.separator, path, columns.first_row)
    if len(values) == 0:
        raise InputError("a stage without points", file=path, key=KEY, expected="one row per point",
                         found="a header only",
                         remedy="export the stage again, or remove the file from the pattern")
    _check_units(columns, path)
    stages = [(number, _stage(columns, part, path)) for number, part in _by_stage(columns, values, path)]
    if columns.dialect.name != "nodemap":
        return stages
    time, signals = signals_of(lines[:columns.first_row - 1], path)
    return [(number, replace(stage, time_s=time, analog=signals)) for number, stage in stages]


def missing_columns(dialect: Dialect, lines: Sequence[str], path: Path) -> InputError:
    """The message where a table lacks a column that the user names."""
    names = header_names(lines[:_MAX_LINES_ABOVE])
    keys = [key_of(name) for name in names]
    missing = [name for name in dialect.needs if names and place_as_written(names, name, keys) is None]
    return InputError(f"no column {', '.join(map(repr, missing))}" if missing else "no header of columns", file=path,
                      key="fields.columns", expected=", ".join(missing or dialect.needs), found=found_in(lines),
                      remedy="write the names as the header has them; a name that several columns share with its unit")


def found_in(lines: Sequence[str]) -> str:
    """The columns of a table, or its first line, for a message."""
    names = header_names(lines[:_MAX_LINES_ABOVE])
    return f"the columns {', '.join(names)}"[:400] if names else next((line for line in lines if line.strip()),
                                                                    "an empty file")[:80]


def _without_last_separator(columns: Columns, rows: list[str]) -> tuple[Columns, list[str]]:
    """Header and rows without a separator at their end that only one of them has."""
    mark = columns.separator
    if mark == " " or not rows:
        return columns, rows
    excess = len(columns.names) - len(cells_of(rows[0], mark))
    if excess == 1 and not columns.names[-1]:
        return replace(columns, names=columns.names[:-1]), rows
    if excess == -1 and all(line.rstrip(" ").endswith(mark) for line in rows):
        return columns, [line.rstrip(" ")[:-1] for line in rows]
    return columns, rows


def _by_stage(columns: Columns, values: np.ndarray, path: Path) -> list[tuple[float, np.ndarray]]:
    place = next((at for name in columns.dialect.stage if (at := columns.place(name)) is not None), None)
    if place is None:
        return [(0.0, values)]
    if (nameless := ~np.isfinite(values[:, place])).any():
        raise InputError("a point of no stage", file=path, key=columns.names[place], expected="a number in every row",
                         found=f"{int(nameless.sum())} rows without one", remedy="export the table again")
    return [(float(number), values[values[:, place] == number]) for number in np.unique(values[:, place])]


def _stage(columns: Columns, values: np.ndarray, path: Path) -> Stage:
    dialect, n = columns.dialect, columns.n_components
    points, displacement = (_in_one_unit(columns, values, names[:n])
                            for names in (dialect.points, dialect.displacement))
    ids = None
    if dialect.ids is not None and (place := columns.place(dialect.ids)) is not None:
        ids = names_of(values[:, place])
    if dialect.rows_down(columns.unit):
        points = points * _UPWARDS[:n]
        displacement = displacement if dialect.v_upwards else displacement * _UPWARDS[:n]
    flags = FLAGS if dialect.named is None else dialect.named.flags
    cells = {key_of(name): values[:, k] for k, name in enumerate(columns.names) if unit_of(name) is None}
    if dialect.named is not None:
        cells = {flag.column: values[:, columns.place(flag.column)] for flag in flags}
    sound = sound_points(points, displacement, ids, dialect.name, cells, flags)
    if sound.n_repeated:
        raise InputError("a point occurs twice in a stage", file=path, key=KEY, expected="every point once",
                         found=f"{sound.n_repeated} points more than once" + (
                             f", of those that did not fail ({in_words(sound.failed)})" if sound.failed else ""),
                         remedy="export one surface only; a table of several stages needs a column `stage`")
    unit_stated = dialect.named is not None and dialect.named.unit is not None
    return Stage(sound.points, sound.displacement, columns.unit, sound.ids, _time_of(columns, values),
                 columns=columns.names,
                 unit_assumed=dialect.name in ("table", NAMED) and not unit_stated and not any(
                     map(unit_of, _lengths(columns))),
                 failed=sound.failed, placeless=sound.placeless)


def _in_one_unit(columns: Columns, values: np.ndarray, names: Sequence[str]) -> np.ndarray:
    """Columns of lengths in the unit of the first position; each may state its own, as µm beside mm  # (n, d)"""
    places = [columns.place(name) for name in names]
    has_unit = columns.dialect.named is not None and columns.dialect.named.unit is not None
    units = [None if has_unit else unit_of(columns.names[place]) for place in places]
    return values[:, places] * [factor_to(columns.unit, unit or columns.unit) or 1.0 for unit in units]


def _time_of(columns: Columns, values: np.ndarray) -> float | None:
    """The time of a stage in s; None without a column of times. A column ``T_C`` is none: its unit is no time."""
    for name in columns.dialect.time:
        place = columns.place(name)
        unit = "s" if place is None else unit_of(columns.names[place]) or "s"
        if place is not None and (factor := factor_to("s", unit)) is not None:
            return factor * float(values[0, place])
    return None


def _check_units(columns: Columns, path: Path) -> None:
    """Refuse positions and displacements in units that do not convert into each other: px and mm."""
    if columns.dialect.named is not None and columns.dialect.named.unit is not None:
        return
    stated_units = [unit_of(name) for name in _lengths(columns)]
    units = {unit or columns.dialect.unit for unit in stated_units}
    if len(units) > 1 and (None in stated_units or any(factor_to(columns.unit, unit) is None for unit in units)):
        raise InputError("positions and displacements are in different units", file=path, key=KEY,
                         expected="one unit of length", found=", ".join(sorted(units)),
                         remedy="export both in mm, or both in px")


def _lengths(columns: Columns) -> list[str]:
    """The columns of positions and displacements, with their units."""
    names = [name for group in (columns.dialect.points, columns.dialect.displacement)
             for name in group[:columns.n_components]]
    return [columns.names[place] for name in names if (place := columns.place(name)) is not None]
