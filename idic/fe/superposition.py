"""Long tests of linear bodies: every frame is a sum of the answers to a unit of each drive and dead load.

    u(t) = sum_j w_j(t) U_j,      du/dlam = sum_j w_j dU_j/dlam + sum_j dw_j/dlam U_j

Small-strain laws without memory, loads of fixed direction, no temperature and no path control: the histories w are all
that changes with time. So a test is solved once per drive instead of once per frame, and the influence of local drives
is the answers themselves. The answers and their derivatives are those of `idic.fe.time_march`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from idic.errors import NotConverged
from idic.fe.assembly.assembly import evaluate_system
from idic.fe.assembly.assembly import System, discretise
from idic.fe.body.boundary import drives_at
from idic.fe.equilibrium import Control
from idic.fe.time_march import FrameState, PointValues, StepList, march
from idic.fe.body.body import Constraints, Direction, Body
from idic.fe.sensitivity import check_directions

MAX_BYTES = 3e8  # of the answers and their derivatives
FRAMES_AT_ONCE = 16
UNIT_MOTION = 1e-3  # of the diagonal of the body: motion of a unit answer while it is solved for


@dataclass(frozen=True, eq=False)
class _Answers:
    """To a unit of each of q drives and dead loads.

    columns : (q,) of [drives, dead loads]; u : (n_dof, q); du : (nd, n_dof, q); channels, dchannels :
    (n_channels, q), (nd, n_channels, q); rise, d_rise : (n_nodes, q), (nd, n_nodes, q), None: not wanted
    """

    columns: np.ndarray
    u: np.ndarray
    du: np.ndarray
    channels: np.ndarray
    dchannels: np.ndarray
    rise: np.ndarray | None
    d_rise: np.ndarray | None


@dataclass(frozen=True, eq=False)
class _Points:
    """Stress and strain of the points of one frame, computed when they are asked for."""

    body: _Body
    u: np.ndarray  # (n_nodes, d) mm
    time: float

    def __iter__(self) -> Iterator[PointValues]:
        system = self.body.system
        drives = drives_at(self.body.body, self.body.times, self.time)
        evaluation = evaluate_system(system, self.body.params, self.u, system.rest_states(), 0.0, drives,
                                     stiffness=False)
        for group, g in zip(system.groups, evaluation.groups, strict=True):
            yield PointValues(group.section, group.cell, group.elements, g.F, g.P, g.state)


@dataclass(frozen=True, eq=False)
class _Body:
    """The model at its parameters."""

    body: Body
    params: Mapping[str, np.ndarray]
    times: np.ndarray

    @cached_property
    def system(self) -> System:
        return discretise(self.body)


def superposed(body: Body, params: Mapping[str, np.ndarray], times: np.ndarray, directions: Sequence[Direction] = (),
               steps: StepList | None = None, substeps: int = 1,
               control: Control | None = None) -> Iterator[FrameState] | None:
    """The frames of `idic.fe.time_march.march`; None where the body is not linear or a sum would not be cheaper.

    Their increments are `steps`, or `substeps` of each interval: a linear body does not feel them.

    Raises
    ------
    InputError
        As `idic.fe.time_march.march`.
    """
    if not body.is_linear:
        return None
    body.validate(len(times))
    check_directions(body, directions, len(times))
    histories, slopes = _histories(body), [_slopes(body, direction) for direction in directions]
    n_drives = body.constraints.histories.shape[1]
    local = [*body.local_drives, *(n_drives + load for load in body.local_loads)]
    used = histories.any(axis=0) | np.any([slope.any(axis=0) for slope in slopes], axis=0)
    used[local] = True
    columns, size = np.flatnonzero(used), body.n_dof * (1 + len(directions))
    if not 0 < len(columns) < len(times) - 1 or 8.0 * size * len(columns) > MAX_BYTES:
        return None
    try:
        answers = _answers(body, params, directions, columns, control)
    except NotConverged:
        return None  # the march says where
    place = np.searchsorted(columns, local)
    return _frames(_Body(body, params, times), answers, histories[:, columns], [slope[:, columns] for slope in slopes],
                   place, _increments(times, steps, substeps))


def _histories(body: Body) -> np.ndarray:
    """Of drives and dead loads, zero at the first frame  # (n_frames, n_drives + n_dead)"""
    drives, dead = body.constraints.histories, body.loads.dead_histories
    histories = drives.copy() if dead is None else np.hstack([drives, dead])
    histories[0] = 0.0
    return histories


def _slopes(body: Body, direction: Direction) -> np.ndarray:
    """Derivative of the histories along a direction  # as `_histories`"""
    slopes = np.zeros_like(_histories(body))
    n_drives = body.constraints.histories.shape[1]
    if direction.d_histories is not None:
        slopes[:, :n_drives] = direction.d_histories
    if direction.d_loads is not None:
        slopes[:, n_drives:] = direction.d_loads
    slopes[0] = 0.0
    return slopes


def _answers(body: Body, params: Mapping[str, np.ndarray], directions: Sequence[Direction], columns: np.ndarray,
             control: Control | None) -> _Answers:
    """The answers by a march whose frames are the units, one after the other."""
    units, n_drives = _units(body, columns), body.constraints.histories.shape[1]
    c, loads, n = body.constraints, body.loads, len(columns) + 1
    tables = np.zeros((n, n_drives + (0 if loads.dead is None else loads.dead.shape[1])))
    tables[np.arange(1, n), columns] = units
    dead = None if loads.dead is None else tables[:, n_drives:]
    unit_model = replace(body, constraints=Constraints(c.dofs, c.basis, tables[:, :n_drives]),
                         loads=replace(loads, dead_histories=dead), local_drives=(), local_loads=())
    body_directions = [k for k, direction in enumerate(directions) if _of_the_body(direction)]
    chosen = [replace(directions[k], d_histories=None, d_loads=None) for k in body_directions]
    states = march(unit_model, params, np.arange(n, dtype=float), chosen, control=control)
    next(states)
    sizes = body.n_dof, len(body.channels), body.mesh.n_nodes
    u, channels, rise = (np.zeros((size, n - 1)) for size in sizes)
    du, dchannels, d_rise = (np.zeros((len(directions), size, n - 1)) for size in sizes)
    for j, state in enumerate(states):
        u[:, j], channels[:, j] = state.u.ravel() / units[j], state.channels / units[j]
        du[body_directions, :, j] = state.du.reshape(body.n_dof, len(body_directions)).T / units[j]
        dchannels[body_directions, :, j] = state.dchannels.T / units[j]
        if state.rise is not None:
            rise[:, j], d_rise[body_directions, :,
                               j] = state.rise / units[j], state.d_rise.T / units[j]
    has_surface = bool(body.surface_side)
    return _Answers(columns, u, du, channels, dchannels, rise if has_surface else None, d_rise if has_surface else None)


def _units(body: Body, columns: np.ndarray) -> np.ndarray:
    """Size of each unit: a small motion of the body, or the largest value of a load  # (q,)"""
    basis, n_drives = np.abs(body.constraints.basis), body.constraints.histories.shape[1]
    extent = float(np.linalg.norm(np.ptp(body.mesh.nodes, axis=0)))
    largest = np.abs(_histories(body)).max(axis=0)
    return np.array([UNIT_MOTION * extent / max(basis[:, j].max(initial=0.0), 1e-300) if j < n_drives
                     else largest[j] or 1.0 for j in columns])


def _of_the_body(direction: Direction) -> bool:
    """Whether a direction changes the answers themselves."""
    return direction.material is not None or direction.thickness or direction.variation is not None


def _increments(times: np.ndarray, steps: StepList | None, substeps: int) -> np.ndarray:
    """End times of all increments, s."""
    if steps is not None:
        return np.asarray(steps.times, dtype=float)
    parts = np.arange(1, substeps + 1) / substeps
    between = times[:-1, None] + parts * np.diff(times)[:, None]
    between[:, -1] = times[1:]
    return between.ravel()


def _frames(body: _Body, answers: _Answers, histories: np.ndarray, slopes: Sequence[np.ndarray], local: np.ndarray,
            increments: np.ndarray) -> Iterator[FrameState]:
    """histories, slopes : (n_frames, q); local : (m,) columns of the answers"""
    shape, times = body.body.mesh.nodes.shape, body.times
    local_du = np.ascontiguousarray(answers.u[:, local]).reshape(*shape, len(local))
    local_channels = np.ascontiguousarray(answers.channels[:, local])
    ends = np.searchsorted(increments, times, side="right")
    for first in range(0, len(times), FRAMES_AT_ONCE):
        block = slice(first, first + FRAMES_AT_ONCE)
        w, change = histories[block], [slope[block] for slope in slopes]
        u, channels = w @ answers.u.T, w @ answers.channels.T
        du = _derivatives(answers.u, answers.du, w, change)
        dchannels = _derivatives(answers.channels, answers.dchannels, w, change)
        rise, d_rise, local_rise = None, None, None
        if answers.rise is not None and answers.d_rise is not None:
            rise, d_rise = w @ answers.rise.T, _derivatives(answers.rise, answers.d_rise, w, change)
            local_rise = answers.rise[:, local]
        for k, motion in enumerate(u):
            frame, t, motion = first + k, float(times[first + k]), motion.reshape(shape)
            step_ends = increments[:ends[frame]] if frame else increments[:0]
            yield FrameState(frame, t, motion, channels[k], du[k].reshape(*shape, len(slopes)), dchannels[k],
                             local_du if frame else np.zeros_like(local_du),
                             local_channels if frame else np.zeros_like(local_channels), 0,
                             _Points(body, motion, t), StepList(tuple(step_ends.tolist())),
                             None if rise is None else rise[k], None if d_rise is None else d_rise[k],
                             local_rise if frame or local_rise is None else np.zeros_like(local_rise))


def _derivatives(answers: np.ndarray, changes: np.ndarray, w: np.ndarray, slopes: Sequence[np.ndarray]) -> np.ndarray:
    """Sums along every direction

    answers : (rows, q); changes : (nd, rows, q); w : (n, q); slopes : nd of (n, q)

    Returns
    -------
    (n, rows, nd)
    """
    derivatives = np.empty((len(w), len(answers), len(slopes)))
    for k, slope in enumerate(slopes):
        derivatives[:, :, k] = w @ changes[k].T
        if slope.any():
            derivatives[:, :, k] += slope @ answers.T
    return derivatives
