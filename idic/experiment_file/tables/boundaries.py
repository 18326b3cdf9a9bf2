"""Converts [[boundary]] and [[channel]] into drives, loads and channels: one value per frame, internal units."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from idic.errors import InputError
from idic.experiment_file.schema.experiment_file import ExperimentFile
from idic.experiment_file.schema.boundary import (BoundaryTable, ChannelTable, ControlTable, DriveTable,
                                                  LoadTable)
from idic.experiment_file.tables.corrections import (
    Place, corrections, counted_in_frames, free_course, of_what, times_or_frames,
)
from idic.experiment_file.tables.mesh_sets import with_edge_set, with_node_set
from idic.fe import Mesh
from idic.model import (
    CHANNEL_TERMS, Channel, Column, Constant, Controlled, Drive, Load, Measured, Parametrised, Prescribed,
    corrections_of, knot_name,
)
from idic.readers import MatchedLog, column_factor, factor_between

_CHANNEL_UNITS = {"reaction": "N", "displacement": "", "pressure": "MPa"}  # displacement: the unit of length
_MAX_READING_AT_REST_STD = 4.0  # standard deviations of the noise; a larger reading at the reference is subtracted


@dataclass
class Motion:
    """Prescribed displacements, loads and channels; the mesh with the sets that they use."""

    mesh: Mesh
    prescribed: list[Prescribed] = field(default_factory=list)
    loads: list[Load] = field(default_factory=list)
    channels: list[Channel] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class Context:
    """Log, times, reference frame and units for the conversion of the tables; times : of the frames, by the log or
    [experiment], None where neither has them  # (n_frames,) s"""

    log: MatchedLog | None
    times: np.ndarray | None
    reference: int
    n_frames: int
    length_unit: str
    file: object

    def rates(self, column: str, values: np.ndarray, factor: float) -> np.ndarray | None:
        """Rates of a column of the log per second; None where the frames have no times  # (n_frames,)

        values : (n_frames,) of the column, in the unit that `factor` leads to
        """
        if self.times is None or self.n_frames < 2:
            return None
        if self.log is not None and self.log.is_interpolated:
            return factor * self.log.rates(column)
        return np.gradient(values, self.times)


def motion(config: ExperimentFile, mesh: Mesh, context: Context) -> Motion:
    """All of [[boundary]] and [[channel]].

    Raises
    ------
    InputError
        A set is unknown, a column is missing, a unit is wrong, or a component of a node has two drives.
    """
    motion = Motion(mesh)
    for number, table in enumerate(config.boundary):
        _boundary(motion, table, f"boundary[{number}]", context)
    for number, table in enumerate(config.channel):
        key = f"channel[{number}]"
        if any(channel.column == table.column for channel in motion.channels):
            raise InputError("a channel is given twice", file=context.file, key=f"{key}.column",
                             expected="every column once", found=table.column,
                             remedy="remove one of the [[channel]] tables")
        motion.channels.append(_channel(motion, table, key, context))
    _check_conflicts(motion, context.file)
    return motion


def _channel(motion: Motion, table: ChannelTable, key: str, context: Context) -> Channel:
    simulated = table.simulated
    kind = next(name for name in _CHANNEL_UNITS if getattr(simulated, name) is not None)
    name, unit = getattr(simulated, kind), _CHANNEL_UNITS[kind] or context.length_unit
    if kind == "pressure":
        pressures = [load.edges for load in motion.loads if load.kind == "pressure"]
        if name not in pressures:
            raise InputError("a channel reads a pressure that no [[boundary]] applies", file=context.file,
                             key=f"{key}.simulated.pressure",
                             expected="the edges of a pressure in [[boundary]]: "
                             f"{', '.join(pressures) or 'none given'}",
                             found=name, remedy="correct the name, or add the pressure to a [[boundary]]")
    else:
        for part in filter(None, ("minus" if simulated.minus else None, kind)):
            motion.mesh = with_node_set(motion.mesh, getattr(simulated, part), context.file, f"{key}.simulated.{part}")
        _component(simulated.component, motion.mesh, context, f"{key}.simulated.component")
    values, factor, rates = logged(table.column, unit, table.unit, context, f"{key}.column")
    noise = None if table.noise_std is None else table.noise_std * factor
    if kind == "displacement":
        values = _from_rest(motion, values, table.column, factor, noise or 0.0, key, context)
    starts, courses = {}, {}
    for course in (term.course for term in CHANNEL_TERMS if term.course):
        start, knots = getattr(table, course.start) if course.start else None, getattr(table, course.knots)
        if start is not None:
            motion.notes += counted_in_frames(f"{key}.{course.start}", context)
            starts[course.stem] = _start_of(course.stem, start, f"{key}.{course.start}", context)
        if knots is not None:
            courses |= {knot_name(course.stem, frame): hat
                        for frame, hat in zip(*free_course(knots, context), strict=True)}
    return Channel(table.column, values, noise, name, simulated.component, simulated.factor, rates, unit, kind,
                   simulated.minus, starts, courses, shown_factor=factor,
                   shown_unit=_unit_of(table.column, table.unit, context) or unit)


def _start_of(stem: str, start: float, key: str, context: Context) -> float:
    """Time at which the course of a channel begins, within the test, s."""
    times = times_or_frames(context)
    if not times[0] <= start < times[-1]:
        raise InputError(f"the {stem} begins outside the test", file=context.file, key=key,
                         expected=f"{times[0]:g} <= {key.rpartition('.')[2]} < {times[-1]:g}, {of_what(context)}",
                         found=f"{start:g}", remedy=f"correct {key.rpartition('.')[2]}")
    return start


def _from_rest(motion: Motion, values: np.ndarray, column: str, factor: float, noise: float, key: str,
               context: Context) -> np.ndarray:
    """A logged displacement; relative to the reference frame if its reading there exceeds the noise."""
    start = float(values[context.reference])
    if abs(start) <= _MAX_READING_AT_REST_STD * noise:
        return values
    if start != 0.0:
        motion.notes.append(f"{key}: {column} is taken relative to the reference frame ({start / factor:g})")
    return values - start


def _boundary(motion: Motion, table: BoundaryTable, key: str, context: Context) -> None:
    components = "xyz"[:motion.mesh.n_dim]
    drives = {"x": table.ux, "y": table.uy, "z": table.uz}
    if table.u is not None:
        drives = dict.fromkeys(components, table.u)
    for component, drive in drives.items():
        if drive is None:
            continue
        name = f"{key}.{'u' if table.u is not None else f'u{component}'}"
        _component(component, motion.mesh, context, name)
        motion.mesh = with_node_set(motion.mesh, table.nodes, context.file, f"{key}.nodes")
        record = _drive(motion, drive, name, context)
        if drive.corrections:
            place = Place(motion.mesh, table.nodes, component)
            record = replace(record, corrections=corrections(drive.corrections, record, place, name, context))
            if any(table.start_s is not None for table in drive.corrections):
                motion.notes += counted_in_frames(f"{name}.corrections: start_s", context)
        motion.prescribed.append(Prescribed(table.nodes, component, record))
    for kind, load in (("pressure", table.pressure), ("traction", table.traction), ("force", table.force)):
        if load is not None:
            _load(motion, kind, load, table, f"{key}.{kind}", context)
    if table.temperature is not None:
        nodes = table.temperature.nodes or table.nodes  # the values are read on the final mesh: temperatures.py
        if nodes is not None and not (nodes == "ALL" and "ALL" not in motion.mesh.node_sets):
            motion.mesh = with_node_set(motion.mesh, nodes, context.file, f"{key}.temperature.nodes")


def _component(component: str, mesh: Mesh, context: Context, key: str) -> None:
    if component == "z" and mesh.n_dim == 2:
        raise InputError("a plane model has no component z", file=context.file, key=key, expected="x or y",
                         found="z", remedy='correct the component, or set kind = "solid"')


def _drive(motion: Motion, table: DriveTable, key: str, context: Context) -> Drive:
    if table.controlled_by is not None:
        return _controlled(motion, table.controlled_by, f"{key}.controlled_by", context)
    if table.measured:
        return Measured(table.smoothing)
    if table.virtual is not None:
        return _parametrised(motion, table, key, context)
    if table.value is not None:
        factor = factor_between(table.unit, context.length_unit, file=context.file,
                                key=f"{key}.unit") if table.unit else 1.0
        return Constant(table.value * factor)
    values, factor, rates = logged(table.column, context.length_unit, table.unit, context, f"{key}.column")
    noise = table.noise_std * factor
    values = _from_rest(motion, values, table.column, factor, noise, key, context)
    return Column(table.column, values, noise, table.identify_offset, rates)


def _controlled(motion: Motion, table: ControlTable, key: str, context: Context) -> Controlled:
    drives = (*(entry.drive for entry in motion.prescribed), *(entry.drive for entry in motion.loads))
    if first_controlled := next((drive for drive in drives if isinstance(drive, Controlled)), None):
        raise InputError("two motions or forces that a gauge controls", file=context.file, key=key,
                         expected="one controlled_by", found=f"another, by {first_controlled.column}",
                         remedy="give the other motion or force as a column")
    for part in filter(None, ("minus" if table.minus else None, "displacement")):
        motion.mesh = with_node_set(motion.mesh, getattr(table, part), context.file, f"{key}.{part}")
    _component(table.component, motion.mesh, context, f"{key}.component")
    course, factor, rates = logged(table.column, context.length_unit, table.unit, context, f"{key}.column")
    course = _from_rest(motion, course, table.column, factor, 0.0, key, context)
    return Controlled(table.column, course, table.displacement, table.component, table.minus, rates)


def _parametrised(motion: Motion, table: DriveTable, key: str, context: Context) -> Parametrised:
    later = context.n_frames - 1 - context.reference
    if table.time_modes > later:
        if "time_modes" in table.model_fields_set:
            raise InputError("more modes in time than frames", file=context.file, key=f"{key}.time_modes",
                             expected=f"at most {later}, the frames after the reference", found=str(table.time_modes),
                             remedy="reduce time_modes")
        motion.notes.append(f"{key}: time_modes = {later}, one per frame after the reference")
    return Parametrised(table.virtual, table.modes, min(table.time_modes, later))


def _load(motion: Motion, kind: str, table: LoadTable, boundary: BoundaryTable, key: str, context: Context) -> None:
    edges = table.edges or boundary.edges or boundary.nodes
    if edges is None:
        raise InputError("the edge that carries the load is missing", file=context.file, key=f"{key}.edges",
                         expected="a set of edges (faces in a solid)", found="none",
                         remedy=f'write {kind} = {{ …, edges = "NAME" }}')
    motion.mesh = with_edge_set(motion.mesh, edges, context.file, f"{key}.edges")
    if kind == "pressure" and table.component is not None:
        raise InputError("a pressure acts along the normal", file=context.file, key=f"{key}.component",
                         expected="no component", found=table.component,
                         remedy="leave component out, or use traction")
    if kind != "pressure":
        if table.component is None:
            raise InputError("the direction of the load is missing", file=context.file, key=f"{key}.component",
                             expected="component = x, y or z", found="none",
                             remedy=f'write {kind} = {{ …, component = "y" }}')
        if table.follower:
            raise InputError("only a pressure can be a follower load", file=context.file, key=f"{key}.follower",
                             expected="pressure", found=kind, remedy="leave follower out")
        _component(table.component, motion.mesh, context, f"{key}.component")
    unit = "N" if kind == "force" else "MPa"
    if table.controlled_by is not None:
        gauge_key = f"{key}.controlled_by"
        drive: Constant | Column | Controlled = _controlled(motion, table.controlled_by, gauge_key, context)
        at_rest = 0.0
    elif table.value is not None:
        factor = factor_between(table.unit, unit, file=context.file, key=f"{key}.unit") if table.unit else 1.0
        drive = Constant(table.value * factor)
        at_rest = drive.value
    else:
        values, factor, rates = logged(table.column, unit, table.unit, context, f"{key}.column")
        noise = table.noise_std * factor
        drive = Column(table.column, values, noise, table.identify_offset, rates)
        at_rest = float(values[context.reference])
        at_rest = 0.0 if abs(at_rest) <= _MAX_READING_AT_REST_STD * noise else at_rest
    if at_rest != 0.0:
        motion.notes.append(f"{key}: the load is {at_rest:g} {unit} at the reference; "
                            "displacements are zero there by definition")
    motion.loads.append(Load(edges, kind, drive, table.component, table.follower, table.identify_scale))


def logged(column: str, internal: str, unit: str | None, context: Context,
            key: str) -> tuple[np.ndarray, float, np.ndarray | None]:
    """Values per frame, factor to internal units, and rates per second if the log has times."""
    if context.log is None:
        raise InputError("a column is named, but there is no log", file=context.file, key=key,
                         expected='loads = "loads.csv" in [experiment]', found=f'column "{column}"',
                         remedy="name the log, or give the values without a column")
    raw = context.log.column(column, file=context.file, key=key)
    factor = column_factor(column, internal, _unit_of(column, unit, context), file=context.file, key=key)
    values = raw * factor
    return values, factor, context.rates(column, values, factor)


def _unit_of(column: str, unit: str | None, context: Context) -> str | None:
    """The unit of a column as its table states it, else the log; None where neither does."""
    return unit or (None if context.log is None else context.log.unit(column))


def _check_conflicts(motion: Motion, file) -> None:
    """InputError if a component of a node has two different drives; sets with equal drives may share nodes."""
    owner: dict[tuple[int, str], Prescribed] = {}
    for entry in motion.prescribed:
        for node in motion.mesh.node_sets[entry.nodes]:
            first_entry = owner.setdefault((int(node), entry.component), entry)
            if first_entry is not entry and not _agree(first_entry.drive, entry.drive):
                label = motion.mesh.node_labels[node]
                raise InputError("a node is driven in two ways", file=file,
                                 key=f"boundary, nodes = {entry.nodes!r}, u{entry.component}",
                                 expected="one drive per node and component",
                                 found=f"node {label} is also in {first_entry.nodes}, which is driven differently",
                                 remedy="remove the shared nodes from one of the sets, e.g. with a set by position")


def _agree(a: Drive, b: Drive) -> bool:
    if type(a) is not type(b) or corrections_of(a) or corrections_of(b):
        return False
    if isinstance(a, Column):
        return a.column == b.column
    if isinstance(a, Controlled):
        return a is b
    return a == b if isinstance(a, Constant) else isinstance(a, (Measured, Parametrised))
