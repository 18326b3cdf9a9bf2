"""Converts ``corrections`` of a prescribed displacement into courses in time, internal units."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from idic.errors import InputError
from idic.experiment_file.schema.boundary import CorrectionTable
from idic.fe import Mesh
from idic.model import (
    Column, Constant, Correction, KNOTS, along_the_motion, end_sign, hats, knot_frames, reach, slip_course,
)
from idic.readers import column_factor


@dataclass(frozen=True)
class Place:
    """The corrected motion: mesh, node set and component."""

    mesh: Mesh
    nodes: str
    component: str


def corrections(tables: Sequence[CorrectionTable], drive: Column | Constant, place: Place, key: str,
                context) -> tuple[Correction, ...]:
    """The corrections of one drive; context : `idic.experiment_file.tables.boundaries.Context`.

    Raises
    ------
    InputError
        A slip begins outside the test, the log lacks a column, or a fixed set has a rotation or misalignment without
        a column.
    """
    nodes = np.asarray(place.mesh.node_sets[place.nodes])
    records = []
    for number, table in enumerate(tables):
        table_key = f"{key}.corrections[{number}]"
        if table.course in ("free", "jumps"):
            most = reach(table.kind, place.mesh, nodes, place.component)
            records += (_jumps(table, drive, most, table_key, context) if table.course == "jumps"
                        else _knot_corrections(table, drive, most, context))
            continue
        if table.kind == "slip":
            course, unit = _slip(table, drive, table_key, context), context.length_unit
        elif table.kind == "compliance":
            course, unit = _compliance(table, drive, table_key, context), f"{context.length_unit}/N"
        elif table.kind == "seating":
            course, unit = _seating(table, drive, table_key, context), context.length_unit
        else:
            course, unit = _in_proportion(table, drive, table_key, context)
        records.append(Correction(table.kind, course - course[context.reference], unit,
                                  reach(table.kind, place.mesh, nodes, place.component), table.towards,
                                  degree=table.degree))
    return tuple(records)


def _knot_corrections(table: CorrectionTable, drive: Column | Constant, most: float, context) -> list[Correction]:
    """One correction per knot of a course that the data give; most : largest value of the pattern."""
    sign, unit = _sign_and_unit(table, drive, context)
    return [Correction(table.kind, sign * course, unit, most, table.towards, frame, degree=table.degree)
            for frame, course in zip(*free_course(table.knots or KNOTS, context), strict=True)]


def _jumps(table: CorrectionTable, drive: Column | Constant, most: float, key: str, context) -> list[Correction]:
    """One correction per jump, which is there from its frame on."""
    sign, unit = _sign_and_unit(table, drive, context)
    chosen, frames = sorted(set(table.jump_frames or ())), np.arange(context.n_frames)
    if not context.reference < chosen[0] <= chosen[-1] < context.n_frames:
        raise InputError("a jump outside the test", file=context.file, key=f"{key}.jump_frames",
                         expected=f"frames {context.reference + 1} to {context.n_frames - 1}", found=str(chosen),
                         remedy="correct the frames")
    return [Correction(table.kind, sign * (frames >= frame), unit, most, table.towards, frame, True, table.degree)
            for frame in chosen]


def _sign_and_unit(table: CorrectionTable, drive: Column | Constant, context) -> tuple[float, str]:
    """Of the amplitude of a slip, rotation or misalignment with a course of its own."""
    sign = -end_sign(drive) if table.kind == "slip" and isinstance(drive, Column) else 1.0
    return sign, "rad" if table.kind == "rotation" else context.length_unit


def free_course(knots: int, context) -> tuple[tuple[int, ...], np.ndarray]:
    """Frames of the knots of a course that the data give, and the course of each  # (n_knots, n_frames)"""
    frames = knot_frames(context.n_frames, context.reference, knots)
    return frames, hats(times_or_frames(context), context.reference, frames)


def times_or_frames(context) -> np.ndarray:
    """Times of all frames, their numbers where none are known  # (n_frames,) s"""
    return np.arange(context.n_frames, dtype=float) if context.times is None else context.times


def of_what(context) -> str:
    """What `times_or_frames` are, for messages."""
    return "the times of the test" if context.times is not None else "the numbers of the frames: the test has no times"


def counted_in_frames(key: str, context) -> list[str]:
    """A note that a time in seconds is read as the number of a frame; [] where times are known."""
    return [] if context.times is not None else [
        f"{key} counts frames, as the test has no times (frame_interval_s, image_times or a column time_s)"]


def _slip(table: CorrectionTable, drive: Column | Constant, key: str, context) -> np.ndarray:
    """The course of the slip: at a fixed set positive, at a logged motion negative (the specimen lags behind)."""
    start, times = _start(table, key, context)
    if not isinstance(drive, Column):
        return slip_course(times, start, table.course or "ramp", times)
    return -end_sign(drive) * slip_course(times, start, table.course or "ramp", drive.values)


def _start(table: CorrectionTable, key: str, context) -> tuple[float, np.ndarray]:
    """When a course begins, and the times of all frames  # s, (n_frames,) s"""
    times = times_or_frames(context)
    start = float(times[context.reference]) if table.start_s is None else table.start_s
    if not times[0] <= start < times[-1]:
        raise InputError(f"the {table.kind} begins outside the test", file=context.file, key=f"{key}.start_s",
                         expected=f"{times[0]:g} <= start_s < {times[-1]:g}, {of_what(context)}",
                         found=f"{start:g}", remedy="correct start_s" if context.times is not None
                         else "give the times: frame_interval_s, image_times or a column time_s in the log")
    return start, times


def _compliance(table: CorrectionTable, drive: Column | Constant, key: str, context) -> np.ndarray:
    force = _logged(table, "N", key, context)
    return -along_the_motion(drive, force) * force if isinstance(drive, Column) else force


def _seating(table: CorrectionTable, drive: Column | Constant, key: str, context) -> np.ndarray:
    """Grips and couplings settle under the first load: all but a 1/e of the way at `seated_at`."""
    force = _logged(table, None, key, context)
    settled = 1.0 - np.exp(-np.abs(force) / table.seated_at)
    return -end_sign(drive) * settled if isinstance(drive, Column) else settled


def _in_proportion(table: CorrectionTable, drive: Column | Constant, key: str, context) -> tuple[np.ndarray, str]:
    """Course and unit of a rotation, misalignment or shape: the motion, or a column of the log over its largest."""
    unit = "rad" if table.kind == "rotation" else context.length_unit
    if table.start_s is not None or table.course is not None:
        start, times = _start(table, key, context)
        motion = drive.values if isinstance(drive, Column) else times
        return slip_course(times, start, table.course or "ramp", motion), unit
    if table.column is not None:
        values = _logged(table, None, key, context)
        return values / (np.abs(values).max() or 1.0), unit
    if not isinstance(drive, Column):
        raise InputError(f"a {table.kind} of a fixed set without a column", file=context.file, key=f"{key}.column",
                         expected="the column of the log for its course", found="no column",
                         remedy='name the column, e.g. column = "force_N"')
    if table.kind == "shape":
        motion = drive.values - drive.values[context.reference]
        return motion / (np.abs(motion).max() or 1.0), context.length_unit
    return drive.values, f"rad/{context.length_unit}" if table.kind == "rotation" else ""


def _logged(table: CorrectionTable, internal: str | None, key: str, context) -> np.ndarray:
    """A column of the log, in `internal` units if given  # (n_frames,)"""
    if context.log is None:
        raise InputError("a column is named, but there is no log", file=context.file, key=f"{key}.column",
                         expected='loads = "loads.csv" in [experiment]', found=f'column "{table.column}"',
                         remedy="name the log")
    raw = context.log.column(table.column, file=context.file, key=f"{key}.column")
    if internal is None:
        return np.asarray(raw, float)
    unit = table.unit or context.log.unit(table.column)
    return raw * column_factor(table.column, internal, unit, file=context.file, key=f"{key}.column")
