"""The stages of a test in order: one file per stage, or one table; their points matched to those of the reference."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import scipy

from idic.errors import InputError
from idic.readers.delimited.log_table import Table
from idic.readers.fields.aramis import is_aramis, read_aramis, read_aramis_head
from idic.readers.fields.column_tables import DIALECT_NAMES
from idic.readers.fields.column_tables import FORMATS as COLUMN_FORMATS
from idic.readers.fields.column_tables import Dialect, find_columns, found_in, read_columns
from idic.readers.fields.exports.named_columns import NamedColumns
from idic.readers.fields.exports.py3dic import SUFFIXES as PY3DIC_SUFFIXES
from idic.readers.fields.exports.py3dic import read_py3dic
from idic.readers.fields.exports.sundic import SUFFIXES as SUNDIC_SUFFIXES
from idic.readers.fields.exports.sundic import read_sundic
from idic.readers.fields.stages.failed_points import MAX_LENGTH, in_words
from idic.readers.fields.flattened import Flattening
from idic.readers.fields.mudic import SUFFIXES as MUDIC_SUFFIXES
from idic.readers.fields.mudic import read_mudic
from idic.readers.fields.ncorr import SUFFIXES as NCORR_SUFFIXES
from idic.readers.fields.ncorr import read_ncorr
from idic.readers.fields.plane import Plane, mean_plane
from idic.readers.fields.stages.stage import KEY, Stage, stage_text
from idic.readers.fields.stages.state_of_positions import DEFORMED, REFERENCE, at_rest, state_of_positions
from idic.readers.fields.vtu import SUFFIXES as VTU_SUFFIXES
from idic.readers.fields.vtu import read_vtu
from idic.readers.formats.format import FIELDS, Format
from idic.readers.logs import Log
from idic.readers.delimited.units import factor_between

ARAMIS, VTU, NCORR, MUDIC, PY3DIC, SUNDIC = "aramis", "vtu", "ncorr", "mudic", "py3dic", "sun-dic"
NAMES = ("auto", ARAMIS, *DIALECT_NAMES, NCORR, MUDIC, PY3DIC, VTU)
_BY_SUFFIX = {**dict.fromkeys(VTU_SUFFIXES, VTU), **dict.fromkeys(NCORR_SUFFIXES, NCORR),
              **dict.fromkeys(MUDIC_SUFFIXES, MUDIC), **dict.fromkeys(PY3DIC_SUFFIXES, PY3DIC),
              **dict.fromkeys(SUNDIC_SUFFIXES, SUNDIC)}
FORMATS = (
    Format(FIELDS, "ARAMIS, GOM Correlate", (".csv", ".txt"), "", "channels, time, units",
           "", "real, 170 stages; made"),
    *COLUMN_FORMATS,
    Format(FIELDS, "Ncorr", NCORR_SUFFIXES, "SciPy, h5py", "region, unit",
           "pixel_size_mm if in px", "made, MATLAB 5 and 7.3"),
    Format(FIELDS, "µDIC", MUDIC_SUFFIXES, "NumPy", "positions", "pixel_size_mm", "of µDIC 0.2"),
    Format(FIELDS, "py3dic, pydic", PY3DIC_SUFFIXES, "", "positions", "pixel_size_mm",
           "made by layout"),
    Format(FIELDS, "sun-dic", SUNDIC_SUFFIXES, "msgpack", "the reference", "pixel_size_mm",
           "made by layout"),
    Format(FIELDS, "VTU, VTK: pyxel and others", VTU_SUFFIXES, "meshio", "", "fields_unit",
           "of pyxel 2026; made"),
)
_READERS = {NCORR: read_ncorr, MUDIC: read_mudic, PY3DIC: read_py3dic}
MIN_SHARED_PART = 0.1  # of the reference's points in every stage; fewer are those of another specimen
MIN_POINTS = 12
_MAX_MATCH_DISTANCE = 0.05  # of the distance of neighbours: the same point in two stages without names
_MIN_WIDTH = 0.1  # of the distance of neighbours, rms, across the points
UM_PER_MM = 1e3
_ROWS_DOWN = np.array([1.0, -1.0, 1.0])


@dataclass(frozen=True)
class FieldEntry:
    """The place of one stage: a file, and the number in its stage column.

    analog : name -> (value, unit)
    """

    path: Path
    label: str
    number: float | None
    time_s: float | None
    analog: tuple[tuple[str, float, str | None], ...]


@dataclass(frozen=True)
class FieldSeries:
    """All stages of a test.

    format : one of `NAMES` without "auto"; mm_per_unit : of lengths in the files; unit, columns : of lengths and
    names of the columns of points, as the first file states them; unit_assumed : neither it nor the user states a unit;
    rows_down : the user, not the file, says that lengths are in px, whose rows count downwards; positions : of which
    state those in the files are (`idic.readers.fields.stages.state_of_positions`); dialect : columns that the
    user names
    """

    entries: tuple[FieldEntry, ...]
    format: str
    mm_per_unit: float
    unit: str
    columns: tuple[str, ...] = ()
    unit_assumed: bool = False
    rows_down: bool = False
    positions: str = REFERENCE
    dialect: Dialect | None = None

    @property
    def labels(self) -> tuple[str, ...]:
        return tuple(entry.label for entry in self.entries)

    def only(self, numbers: Sequence[int]) -> FieldSeries:
        """Some of the stages."""
        return replace(self, entries=tuple(self.entries[k] for k in numbers))

    def stage(self, k: int) -> Stage:
        """The points of a stage, lengths in mm.

        Raises
        ------
        InputError
            The file cannot be read, or is in another unit or has other columns than the first one.
        """
        entry = self.entries[k]
        stage = _read(entry.path, self.dialect or self.format)[entry.number]
        if stage.unit != self.unit:
            raise InputError("a stage in another unit than the first", file=entry.path, key=KEY, expected=self.unit,
                             found=stage.unit, remedy="export all stages in one unit")
        if stage.columns != self.columns:
            raise InputError("a stage with other columns than the first", file=entry.path, key=KEY,
                             expected=", ".join(self.columns), found=", ".join(stage.columns),
                             remedy="export all stages in the same way, or remove this one from the pattern")
        if self.positions == DEFORMED and stage.displacement is not None:
            stage = at_rest(stage)
        n = stage.points.shape[1]
        factor = self.mm_per_unit * (_ROWS_DOWN if self.rows_down else np.ones(3))[:n]
        displacement = None if stage.displacement is None else factor * stage.displacement
        return replace(stage, points=factor * stage.points, displacement=displacement, unit="mm")

    def log(self) -> Log | None:
        """Times and analog channels of the stages as a log, one row per stage; None where they have none.

        Raises
        ------
        InputError
            A channel, or the time, is missing in some of the stages.
        """
        names = dict.fromkeys(name for entry in self.entries for name, _, _ in entry.analog)
        columns: dict[str, tuple[str, list[float]]] = {}
        timed = [entry.time_s is not None for entry in self.entries]
        if any(timed):
            self._complete(timed, "time")
            columns["time_s"] = "", [float(entry.time_s) for entry in self.entries]
        for name in names:
            readings = [{n: (value, unit) for n, value, unit in entry.analog}.get(name) for entry in self.entries]
            self._complete([value is not None for value in readings], name)
            self._one_unit([value[1] for value in readings], name)
            columns[name] = readings[0][1] or "", [value[0] for value in readings]
        if not columns:
            return None
        rows = tuple(tuple(repr(values[k]) for _, values in columns.values()) for k in range(len(self.entries)))
        table = Table(";", 1, tuple(columns), tuple(unit for unit, _ in columns.values()), rows,
                      tuple(range(1, len(rows) + 1)), ())
        return Log(self.entries[0].path.parent, table, ".", of_stages=True)

    def _complete(self, has_value: Sequence[bool], name: str) -> None:
        if not all(has_value):
            entry = self.entries[has_value.index(False)]
            raise InputError("a channel is missing in some stages", file=entry.path, key=name,
                             expected=f"{name} in all {len(has_value)} stages",
                             found=f"{has_value.count(False)} without it",
                             remedy="export it with every stage, or remove these stages from the pattern")

    def _one_unit(self, units: Sequence[str | None], name: str) -> None:
        odd_stage = next((k for k, unit in enumerate(units) if unit != units[0]), None)
        if odd_stage is not None:
            raise InputError("a channel changes its unit between stages", file=self.entries[odd_stage].path, key=name,
                             expected=units[0] or "no unit, as in the first stage", found=units[odd_stage] or "no unit",
                             remedy="export all stages with the same units")

    def measured_points(self, references: Sequence[int]) -> MeasuredPoints:
        """The points that all reference stages show, and where they are.

        references : stages whose mean is the reference

        Raises
        ------
        InputError
            Hardly any point is in all of them.
        """
        stages = [self.stage(k) for k in references]
        first = stages[-1]
        n = len(first.points)
        if n < MIN_POINTS:
            raise InputError("the reference stage has too few points", file=self.entries[references[-1]].path, key=KEY,
                             expected=f"{MIN_POINTS} points or more",
                             found=f"{n} ({in_words(first.failed)})" if first.failed else str(n),
                             remedy="choose another reference")
        pitch = float(np.median(scipy.spatial.cKDTree(first.points).query(first.points, k=2)[0][:, 1]))
        if not pitch > 0.0:
            raise InputError("the points of the reference stage lie at one place",
                             file=self.entries[references[-1]].path, key=KEY,
                             expected="a place for every point",
                             found=f"{n} points, most of them at the place of another", remedy="export the stage again")
        raw = MeasuredPoints(first.points, pitch, first.ids, first.points, None, np.zeros_like(first.points))
        start = np.mean([raw.moved(stage) for stage in stages], axis=0)
        measured = np.isfinite(start).all(axis=1)
        if measured.sum() < max(MIN_POINTS, 0.5 * n):
            raise InputError("the reference stages show different points", file=self.entries[references[0]].path,
                             key="experiment.reference", expected="stages of one specimen at rest",
                             found=f"{int(measured.sum())} of {n} points in all of them"
                             + (f" ({in_words(first.failed)})" if first.failed else ""),
                             remedy="name fewer reference stages, or others")
        points, start = first.points[measured], start[measured]
        positions = start if first.displacement is None else points + start
        spread = np.linalg.svd(positions - positions.mean(axis=0), compute_uv=False) / np.sqrt(len(points))
        if spread[1] < _MIN_WIDTH * pitch:
            raise InputError("the points of the reference stage lie on one line",
                             file=self.entries[references[-1]].path, key=KEY, expected="points over a surface",
                             found=f"{len(points)} points on a line",
                             remedy="export the points of the whole surface")
        plane = mean_plane(positions) if positions.shape[1] == 3 else None
        middle = positions.mean(axis=0)  # a turn about the origin of the cameras would shift a drawn outline
        flat = positions if plane is None else middle + (positions - middle) @ plane.axes.T
        return MeasuredPoints(flat[:, :2], pitch, None if first.ids is None else first.ids[measured], points, plane,
                              start, None if plane is None else flat[:, 2] - flat[:, 2].mean())

    @classmethod
    def open(cls, paths: Sequence[Path], format: str = "auto", unit: str | None = None,
             pixel_size_mm: float | None = None, columns: NamedColumns | None = None) -> FieldSeries:
        """The stages in these files, in order. Of stages with a file each, only the first is read whole.

        Parameters
        ----------
        unit : of lengths in the files, where they do not state it or state a wrong one
        pixel_size_mm : for fields in px; columns : of a table, as the user names them

        Raises
        ------
        InputError
            A file is none of the formats or lacks one of the columns, the fields are in px and no pixel size is given,
            or a pixel size is given and nothing says whether the lengths are in px.
        """
        dialect = None if columns is None else Dialect.of_user(columns)
        file_format = dialect.name if dialect is not None else detected(paths[0]) if format == "auto" else format
        source = dialect or file_format
        entries = [entry for path in paths for entry in _entries(path, source)]
        first = _read(entries[0].path, source)[entries[0].number]
        positions = state_of_positions(lambda k: _read(entries[k].path, source)[entries[k].number],
                                       [entry.path for entry in entries],
                                       DEFORMED if file_format == ARAMIS else REFERENCE)
        assumed = first.unit_assumed and unit is None
        if assumed and pixel_size_mm is not None:
            raise InputError("the unit of the fields is not known", file=paths[0], key="experiment.fields_unit",
                             expected='fields_unit = "px" or "mm" next to pixel_size_mm',
                             found="a file that names no unit of length",
                             remedy='write fields_unit = "px" if its lengths are pixels, else fields_unit = "mm" and '
                             'no pixel_size_mm')
        file_unit, unit = first.unit, unit or first.unit
        if unit == "px":
            if pixel_size_mm is None:
                raise InputError("fields in px without a scale", file=paths[0], key="camera.pixel_size_mm",
                                 expected="the size of a pixel in mm", found="no pixel_size_mm",
                                 remedy='give it, or fields_unit = "mm" if the file is in mm')
            factor = pixel_size_mm
        else:
            factor = factor_between(unit, "mm", file=paths[0], key="experiment.fields_unit")
        return cls(tuple(entries), file_format, factor, file_unit, first.columns, assumed,
                   first.unit_assumed and unit == "px" and file_format != VTU, positions, dialect)


def shared_part(moved: np.ndarray) -> float:
    """Part of the points that a stage shows  # moved (n_points, d), NaN where not measured"""
    return float(np.isfinite(moved).all(axis=1).mean())


def detected(path: Path) -> str:
    """The format of a file, by its content.

    Raises
    ------
    InputError
        It is none of them.
    """
    if (format_name := _BY_SUFFIX.get(path.suffix.lower())) is not None:
        _read(path, format_name)
        return format_name
    if is_aramis(stage_text(path)):
        return ARAMIS
    columns = find_columns(stage_text(path).splitlines())
    if columns is None:
        raise InputError("not a field format that idic reads", file=path, key=KEY,
                         expected="an export of " + ", ".join(name for name in NAMES if name != "auto"),
                         found=found_in(stage_text(path).splitlines()),
                         remedy="name its columns in [fields.columns], or export a table with the columns "
                         "stage,x_mm,y_mm,ux_mm,uy_mm")
    return columns.dialect.name


def _entries(path: Path, format: str | Dialect) -> list[FieldEntry]:
    if path.stat().st_size == 0:
        raise InputError("a stage is empty", file=path, key=KEY, expected="the points of a stage",
                         found="a file of 0 bytes",
                         remedy="export the stage again, or remove the file from the pattern")
    if format == ARAMIS:
        time, analog = read_aramis_head(path)
        return [FieldEntry(path, path.name, None, time, tuple((name, *value) for name, value in analog.items()))]
    if format == VTU:
        return [FieldEntry(path, path.name, None, None, ())]
    stages = _read(path, format)
    is_single = len(stages) == 1
    return [FieldEntry(path, path.name if is_single else f"{path.name}[{number:g}]", number, stage.time_s,
                       tuple((name, *value) for name, value in stage.analog.items()))
            for number, stage in stages.items()]


@lru_cache(maxsize=2)
def _read_cached(path: Path, format: str | Dialect, changed_ns: int) -> dict[float | None, Stage]:
    if format == ARAMIS:
        return {None: read_aramis(path)}
    if format == VTU:
        return {None: read_vtu(path)}
    if format == SUNDIC and path.suffix.lower() in SUNDIC_SUFFIXES:
        return read_sundic(path)
    if (read := _READERS.get(format)) is not None:
        return {number: _of_places(stage) for number, stage in read(path).items()}
    return dict(read_columns(path, format))


def _of_places(stage: Stage) -> Stage:
    """The points of a stage that have a place."""
    has_place = (np.abs(stage.points) < MAX_LENGTH).all(axis=1)
    if has_place.all() or stage.displacement is None:
        return stage
    return stage.with_points(stage.points[has_place], stage.displacement[has_place],
                             None if stage.ids is None else stage.ids[has_place], int((~has_place).sum()))


def _read(path: Path, format: str | Dialect) -> dict[float | None, Stage]:
    return _read_cached(path, format, path.stat().st_mtime_ns)


@dataclass(frozen=True, eq=False)
class MeasuredPoints:
    """The points of the reference stage, in the plane of the specimen.

    Attributes
    ----------
    positions : array (n, 2), mm
    pitch : float, mm
        Distance of neighbours (median).
    ids : array (n,), or None; keys : array (n, d), mm
        How they are found in another stage: by name, or by their place in the system's reference.
    plane : Plane or None
        None for fields of two coordinates.
    start : array (n, d), mm
        What displacements, or positions, are counted from.
    heights : array (n,), mm, or None
        Over that plane.
    """

    positions: np.ndarray
    pitch: float
    ids: np.ndarray | None
    keys: np.ndarray
    plane: Plane | None
    start: np.ndarray
    heights: np.ndarray | None = None

    def __len__(self) -> int:
        return len(self.positions)

    def found_in(self, stage: Stage) -> np.ndarray:
        """The row of every point in a stage, -1 where it is missing  # (n,)"""
        if not len(stage.points):
            return np.full(len(self), -1)
        if self.ids is not None and stage.ids is not None:
            order = np.argsort(stage.ids)
            at = np.minimum(np.searchsorted(stage.ids, self.ids, sorter=order), len(order) - 1)
            return np.where(stage.ids[order[at]] == self.ids, order[at], -1)
        distance, at = scipy.spatial.cKDTree(stage.points).query(self.keys)
        return np.where(distance < _MAX_MATCH_DISTANCE * self.pitch, at, -1)

    def moved(self, stage: Stage) -> np.ndarray:
        """Displacement along the axes of the plane since the reference, NaN where not measured  # (n, 2 | 3) mm"""
        place = self.found_in(stage)
        values = stage.points if stage.displacement is None else stage.displacement
        if not len(values):
            values = np.full((1, values.shape[1]), np.nan)
        moved = np.where((place >= 0)[:, None], values[place], np.nan) - self.start
        return moved if self.plane is None else moved @ self.plane.axes.T


class FieldStack:
    """The displacements of a test, frame by frame, as rows of an image: follows the `Stack` protocol.

    `frame` gives (n_points, 2 or 3) in µm, along the columns and the rows of the points' grid (rows count downwards,
    against y) and along the normal of three coordinates; NaN where a point was not measured. flattening : lays a sheet
    flat.
    """

    def __init__(self, series: FieldSeries, points: MeasuredPoints, n_components: int = 2,
                 flattening: Flattening | None = None):
        self.series, self.points, self.n_components, self.flattening = series, points, n_components, flattening

    def with_components(self, n: int) -> FieldStack:
        """The same frames with the first n components."""
        return self if n == self.n_components else FieldStack(self.series, self.points, n, self.flattening)

    @property
    def entries(self) -> tuple[FieldEntry, ...]:
        return self.series.entries

    @property
    def labels(self) -> tuple[str, ...]:
        return self.series.labels

    @property
    def n_frames(self) -> int:
        return len(self.series.entries)

    @property
    def shape(self) -> tuple[int, int]:
        return len(self.points), self.n_components

    def frame(self, k: int) -> np.ndarray:
        """Displacements of a frame  # (n_points, n_components) float32, µm

        Raises
        ------
        InputError
            The stage shows other points, or points that have moved by more than the specimen is long.
        """
        moved = self.points.moved(self.series.stage(k))
        measured = np.isfinite(moved).all(axis=1)
        path = self.entries[k].path
        if shared_part(moved) < MIN_SHARED_PART:
            raise InputError("a stage shows other points than the reference", file=path, key=KEY,
                             expected=f"the {len(moved)} points of the reference stage, or most of them",
                             found=f"{int(measured.sum())} of them",
                             remedy="remove stages of other specimens, and those after the break, from the pattern")
        size = float(np.ptp(self.points.positions, axis=0).max())
        if np.abs(np.median(moved[measured], axis=0)).max() > size:
            raise InputError("the points of a stage are far from those of the reference", file=path, key=KEY,
                             expected=f"displacements below the length of the specimen, {size:.3g} mm",
                             found=f"{np.abs(np.median(moved[measured], axis=0)).max():.3g} mm",
                             remedy="remove stages of other specimens from the pattern")
        c = self.n_components
        if self.flattening is not None:
            moved = self.flattening(moved)
        return np.ascontiguousarray(UM_PER_MM * moved[:, :c] * _ROWS_DOWN[:c], dtype=np.float32)
