"""Converts ``corrections`` of a prescribed displacement into courses in time, internal units."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from idic.errors import InputError
from idic.experiment_file.schema.boundary import CorrectionKeys
from idic.fe import Mesh
from idic.model import (
    CORRECTION_TERMS, Column, Constant, CorrectedMotion, Correction, KNOTS, hats, knot_frames,
)
from idic.readers import column_factor


@dataclass(frozen=True)
class Place:
    """The corrected motion: mesh, node set and component."""

    mesh: Mesh
    nodes: str
    component: str


def corrections(tables: Sequence[CorrectionKeys], drive: Column | Constant, place: Place, key: str,
                context) -> tuple[Correction, ...]:
    """The corrections of one drive; context : `idic.experiment_file.tables.boundaries.Context`.

    Raises
    ------
    InputError
        A course begins outside the test, the log lacks a column, or what a term refuses.
    """
    nodes = np.asarray(place.mesh.node_sets[place.nodes])
    records: list[Correction] = []
    for number, table in enumerate(tables):
        table_key, term = f"{key}.corrections[{number}]", CORRECTION_TERMS[table.kind]
        keys = {entry.name: table.given[entry.name] for entry in term.keys if entry.name in table.given}
        blank = Correction(term.kind, np.zeros(context.n_frames), term.free_unit(context.length_unit),
                          term.reach(place.mesh, nodes, place.component), term.pattern, keys,
                          keys.get(term.number))
        if table.course in ("free", "jumps"):
            courses = _jumps(table, table_key, context) if table.course == "jumps" \
                else free_course(table.knots or KNOTS, context)
            records += [replace(blank, course=term.free_sign(drive) * course, knot=frame, jumps=table.course == "jumps")
                        for frame, course in zip(*courses, strict=True)]
            continue
        motion = CorrectedMotion(drive, times_or_frames(context), context.reference, context.length_unit, table.given,
                                 start=partial(_start, table, table_key, context),
                                 log=partial(_logged, table, table_key, context))
        try:
            course = term.course(motion)
        except InputError as error:
            raise _placed(error, table_key, context) from None
        records.append(replace(blank, course=course - course[context.reference], unit=term.unit(motion)))
    return tuple(records)


def _placed(error: InputError, key: str, context) -> InputError:
    """An error of a term, with the place of its table in the file."""
    if error.file is not None:
        return error
    return InputError(error.what, file=context.file, key=f"{key}.{error.key}", expected=error.expected,
                      found=error.found, remedy=error.remedy)


def _jumps(table: CorrectionKeys, key: str, context) -> tuple[tuple[int, ...], np.ndarray]:
    """Frames of the jumps, and the course of each: it is there from its frame on  # (n_jumps, n_frames)"""
    chosen, frames = sorted(set(table.jump_frames or ())), np.arange(context.n_frames)
    if not context.reference < chosen[0] <= chosen[-1] < context.n_frames:
        raise InputError("a jump outside the test", file=context.file, key=f"{key}.jump_frames",
                         expected=f"frames {context.reference + 1} to {context.n_frames - 1}", found=str(chosen),
                         remedy="correct the frames")
    return tuple(chosen), np.array([frames >= frame for frame in chosen], dtype=float)


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


def _start(table: CorrectionKeys, key: str, context) -> float:
    """When a course begins, s."""
    times = times_or_frames(context)
    start = float(times[context.reference]) if table.start_s is None else table.start_s
    if not times[0] <= start < times[-1]:
        raise InputError(f"the {table.kind} begins outside the test", file=context.file, key=f"{key}.start_s",
                         expected=f"{times[0]:g} <= start_s < {times[-1]:g}, {of_what(context)}",
                         found=f"{start:g}", remedy="correct start_s" if context.times is not None
                         else "give the times: frame_interval_s, image_times or a column time_s in the log")
    return start


def _logged(table: CorrectionKeys, key: str, context, internal: str | None) -> np.ndarray:
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
