"""Time integration of the simulation: increments, step cutting, sensitivities; every frame time ends an increment.

Memory does not grow with the number of frames: one `FrameState` is yielded at a time.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from idic.errors import GaveUp, InputError, NotConverged
from idic.fe.assembly.assembly import System, discretise
from idic.fe.body.boundary import drives_at
from idic.fe.controlled import solve_controlled
from idic.fe.equilibrium import Control, Converged, Effort, consistent_factor, serves, solve_increment
from idic.fe.increment_size import IncrementSize
from idic.fe.body.body import Direction, Body, Reaction
from idic.fe.predictor import WarmStart, extrapolated
from idic.fe.thickness_change import surface_rise
from idic.fe.solver.linear import Factor
from idic.fe.solver.threads import looked_ahead, pool_of_threads
from idic.fe.sensitivity import Changes, Influence, at_rest, check_directions, differentiate, influence_at


MAX_BEND = 0.2  # of an increment of a path that a gauge controls: a longer one may end on another path
SMALLEST_BENT_PART = 1.0 / 32.0  # of an interval between frames


@dataclass(frozen=True)
class StepList:
    """End times (s) of all increments taken, frame times included; hand it to `march` to repeat exactly these.

    With extrapolation in time (`idic.fe.extrapolation`) the fine increments come first, then the coarse ones.
    """

    times: tuple[float, ...] = ()

    @property
    def is_extrapolated(self) -> bool:
        """Whether these increments are those of two simulations."""
        return len(self.split()) > 1

    def split(self) -> list[tuple[float, ...]]:
        """The lists of increments in it: one, or the fine and the coarse one."""
        back = [k for k, (a, b) in enumerate(pairwise(self.times), start=1) if b <= a]
        return [self.times[a:b] for a, b in pairwise((0, *back, len(self.times)))]


@dataclass(frozen=True)
class PointValues:
    """What one group of elements holds at its points, for fields on request.

    elements (n_el,) global indices; F, P (n_points, d, d), P (MPa) acting on F; state (n_points, n_state), as the law
    names it.
    """

    section: int
    cell: str
    elements: np.ndarray
    F: np.ndarray
    P: np.ndarray
    state: np.ndarray


@dataclass(frozen=True)
class FrameState:
    """The simulation at one frame.

    Attributes
    ----------
    u : (n_nodes, d) mm
    channels : (n_channels,) N
    du : (n_nodes, d, nd), dchannels : (n_channels, nd)
        Derivatives along the directions.
    local_du : (n_nodes, d, m), local_dchannels : (n_channels, m)
        Same-frame influence of the model's local drives.
    n_newton : int
        Newton iterations since the frame before.
    points : tuple of PointValues
    steps : StepList
        Increments so far; at the last frame the list for frozen steps.
    rise, d_rise, local_rise : (n_nodes,) mm, (n_nodes, nd), (n_nodes, m)
        Plane stress with `Body.surface_side`: motion of the seen surface out of the plane; else None.
    """

    frame: int
    time: float
    u: np.ndarray
    channels: np.ndarray
    du: np.ndarray
    dchannels: np.ndarray
    local_du: np.ndarray
    local_dchannels: np.ndarray
    n_newton: int
    points: tuple[PointValues, ...] = field(repr=False)
    steps: StepList = field(repr=False)
    rise: np.ndarray | None = None
    d_rise: np.ndarray | None = None
    local_rise: np.ndarray | None = None

    @property
    def seen_u(self) -> np.ndarray:
        """Displacement of the seen surface, with its rise as third component  # (n_nodes, d|3) mm"""
        return self.u if self.rise is None else np.column_stack([self.u, self.rise])

    @property
    def seen_du(self) -> np.ndarray:
        """Its derivatives along the directions  # (n_nodes, d|3, nd)"""
        return self.du if self.d_rise is None else np.concatenate([self.du, self.d_rise[:, None]], axis=1)

    @property
    def seen_local_du(self) -> np.ndarray:
        """Same-frame influence of the local drives  # (n_nodes, d|3, m)"""
        if self.local_rise is None:
            return self.local_du
        return np.concatenate([self.local_du, self.local_rise[:, None]], axis=1)


def march(body: Body, params: Mapping[str, np.ndarray], times: np.ndarray, directions: Sequence[Direction] = (),
          steps: StepList | None = None, substeps: int = 1, control: Control | None = None,
          warm_start: Iterable[np.ndarray] | None = None, may_cut: bool = False) -> Iterator[FrameState]:
    """Simulate the whole test and yield one `FrameState` per frame, the undeformed reference first.

    Parameters
    ----------
    params : {section name: (n_params,)}
        Parameter values in the order of the section's law.
    times : (n_frames,) s, increasing
    directions : sequence of Direction
        What to differentiate with respect to (direct differentiation).
    steps : StepList, optional
        Frozen increments (perturbed runs, comparison with a reference). They are followed exactly and never
        cut, unless `may_cut`.
    substeps : int
        Increments per frame before any cutting.
    warm_start : iterable of (n_nodes, d or more) mm, optional
        Displacement at every frame (further components do not count), the reference first, of a solution for other,
        similar parameters. Its increments are the first guesses of Newton's method where they predict better than
        extrapolation in time.
    may_cut : bool
        Frozen increments are halved where no equilibrium is found: a solution that began elsewhere may have needed
        fewer.

    Raises
    ------
    InputError
        At once, if the model cannot be solved as it stands.
    NotConverged
        While iterating, with the time reached, when an increment cannot be cut any further.
    GaveUp
        While iterating, where the test takes more than `Control.most_evaluations`.
    """
    system, increments = solved_increments(body, params, times, directions, steps, substeps, control, warm_start,
                                           may_cut)
    return _frames(system, params, np.asarray(times, dtype=float), tuple(directions), increments)


def solved_increments(body: Body, params: Mapping[str, np.ndarray], times: np.ndarray, directions: Sequence[Direction],
                      steps: StepList | None, substeps: int, control: Control | None,
                      warm_start: Iterable[np.ndarray] | None, may_cut: bool) -> tuple[System, Iterator[Increment]]:
    """The body made ready to be solved, and its increments one after the other; parameters and errors as of `march`."""
    times = np.asarray(times, dtype=float)
    control = Control() if control is None else control
    _check_run(body, params, times, substeps)
    body.validate(len(times))
    check_directions(body, directions, len(times))
    frozen = None if steps is None else _frozen_targets(steps, times)
    warm = None if warm_start is None else WarmStart(u[:, :body.mesh.n_dim] for u in warm_start)
    system = discretise(body)
    return system, _increments(system, params, times, _rest_state(system, times), bool(directions), frozen, substeps,
                               control, warm, may_cut)


def _rest_state(system: System, times: np.ndarray) -> Converged:
    drives = drives_at(system.body, times, times[0])
    return Converged(drives, np.zeros_like(system.body.mesh.nodes), system.rest_states())


def _check_run(body: Body, params, times: np.ndarray, substeps: int) -> None:
    if times.ndim != 1 or len(times) == 0 or not np.isfinite(times).all() or (np.diff(times) <= 0).any():
        raise InputError("frame times must increase", expected="one finite time per frame, in increasing order",
                         found=str(times[:10]), remedy="check the time column of the log")
    if substeps < 1:
        raise InputError("at least one increment per frame is needed", expected="substeps >= 1", found=str(substeps),
                         remedy="set options.substeps to 1 or more")
    for section in body.sections:
        names = section.law.spec.parameter_names
        if section.name not in params:
            raise InputError(f"no parameters for {section.name}", expected=", ".join(names),
                             found=", ".join(params) or "nothing", remedy="give the values of this element set")
        values = np.asarray(params[section.name], dtype=float)
        if values.shape != (len(names),) or not _usable(section, values).all():
            raise InputError(f"parameters of {section.name} do not fit law {section.law.spec.name}",
                             expected=f"{len(names)} finite values: {', '.join(names)}", found=str(values),
                             remedy="give one finite value for every parameter, in this order")


def _usable(section, values: np.ndarray) -> np.ndarray:
    """Whether parameters are finite, or infinite where that means no effect (a yield stress)  # (n_params,) bool"""
    nulls = np.array([np.nan if p.null is None else p.null for p in section.law.spec.parameters])
    return np.isfinite(values) | (values == nulls)


def _frozen_targets(steps: StepList, times: np.ndarray) -> np.ndarray:
    targets = np.asarray(steps.times, dtype=float)
    missing = np.setdiff1d(times[1:], targets)
    if len(missing):
        raise InputError("the fixed increments do not end at every frame time",
                         found=f"no increment ends at {missing[0]:g} s",
                         remedy="use the increments of a run with the same frames")
    return targets


@dataclass(frozen=True)
class Increment:
    """A converged increment, from `start` to `end`.

    factor : of the consistent tangent at `end` where the next increment begins with it, else None
    ends_frame : number of the frame at its end, None inside of an interval; newton : iterations since the frame before
    """

    start: Converged
    end: Converged
    factor: Factor | None
    ends_frame: int | None
    newton: int
    step_ends: tuple[float, ...]


def _frames(system: System, params, times, directions, increments: Iterator[Increment]) -> Iterator[FrameState]:
    """Each increment is differentiated while the next one is solved, where a second thread may do that."""
    yield _reference_frame(system, times, directions, _rest_state(system, times))
    changes, influence = at_rest(system, len(directions)), None
    second = bool(directions) and not system.pattern.costs_much and pool_of_threads() is not None
    with looked_ahead(increments, second) as solved:
        for increment in solved:
            factor = None
            if directions:
                factor = consistent_factor(system, increment.end) if increment.factor is None else increment.factor
                changes = differentiate(system, params, directions, times, increment.start, increment.end, factor,
                                        changes)
            if increment.ends_frame is not None:
                start = replace(increment.start, evaluation=None, factor=None, factor_matrices=())
                influence = influence_at(system, params, start, increment.end, factor, influence)
                yield _frame_state(system, increment.ends_frame, increment.end, changes, influence, increment.newton,
                                   increment.step_ends, directions)
            del increment, factor  # room for those of the next increment


def _increments(system: System, params, times, rest_state: Converged, differentiated: bool, frozen, substeps, control,
                warm, may_cut) -> Iterator[Increment]:
    state, earlier, step_ends, size, effort = rest_state, None, [], IncrementSize(), Effort()
    most = np.inf if control.most_evaluations is None else control.most_evaluations * substeps * (len(times) - 1)
    for frame in range(1, len(times)):
        newton, failures = 0, 0
        if warm is not None:
            warm.advance()
        full_step = (times[frame] - times[frame - 1]) / substeps
        frozen_part = None if frozen is None else (_next_target(state.time, times[frame], full_step,
                                                                frozen) - state.time) / full_step
        size.start_from_rest(system, params, state, drives_at(system.body, times, times[frame]), substeps, frozen_part)
        while state.time < times[frame]:
            target = _next_target(state.time, times[frame], size.part * full_step, frozen)
            drives = drives_at(system.body, times, target)
            guess = extrapolated(state, earlier, drives) if size.extrapolates() else None
            if warm is not None and (state.time, target) == (times[frame - 1], times[frame]):
                guess = warm.better(state.u, guess)
            if effort.evaluations > most:
                raise _too_slow(effort, state, frame)
            try:
                solved = _attempt(system, params, state, guess, drives, control, effort)
            except NotConverged as error:
                size.part, failures = (target - state.time) / full_step / 2, failures + 1
                as_given = frozen is not None and not may_cut
                if (as_given or size.part < control.smallest_cut * substeps * size.smallest
                        or failures > control.most_failures * substeps):
                    raise _gave_up(error, state, frame, target, as_given) from None
                if frozen is not None:
                    frozen = np.sort(np.append(frozen, (state.time + target) / 2.0))
                continue
            if solved.bend > MAX_BEND and frozen is None and size.part > SMALLEST_BENT_PART:
                size.part /= 2.0
                continue
            factor = None
            if differentiated and system.pattern.costs_much:
                # room for one; the next increment begins with it
                if not solved.factor_matrices:
                    state = replace(state, factor=None)
                    solved = solved if serves(system, solved) else replace(solved, factor=None)
                    factor = consistent_factor(system, solved)
                    solved = replace(solved, factor=factor, kind=factor.kind,
                                     gain=solved.gain if factor.of_earlier_tangent else np.inf)
                factor = solved.factor
            if warm is not None:
                warm.judge(solved.u)
            size.converged(solved.iterations)
            newton += solved.iterations
            step_ends.append(target)
            ends = None if solved.time < times[frame] else frame
            previous, earlier, state = state, replace(state, states=(), evaluation=None, factor=None,
                                                      factor_matrices=()), solved
            yield Increment(previous, state, factor, ends, newton, tuple(step_ends) if ends else ())
            del previous, solved


def _next_target(t: float, frame_time: float, interval: float, frozen: np.ndarray | None) -> float:
    """End of the next increment; the last one of a frame ends exactly at the frame's time."""
    if frozen is not None:
        return float(min(frozen[np.searchsorted(frozen, t, side="right")], frame_time))
    remaining = int(np.ceil((frame_time - t) / interval - 1e-6))
    return float(frame_time) if remaining <= 1 else t + (frame_time - t) / remaining


def _attempt(system, params, state: Converged, guess: np.ndarray | None, drives, control, effort: Effort) -> Converged:
    """Solve from a guess; if that fails from a tangent step, at last with a line search."""
    if system.body.control is not None:
        try:
            return solve_controlled(system, params, state, drives, control, effort=effort)
        except NotConverged:
            return solve_controlled(system, params, state, drives, control, line_search=True, effort=effort)
    for predictor in (None,) if guess is None else (guess, None):
        try:
            return solve_increment(system, params, state, drives, predictor, control, effort=effort)
        except NotConverged:
            continue
    return solve_increment(system, params, state, drives, None, control, line_search=True, effort=effort)


def _too_slow(effort: Effort, state: Converged, frame: int) -> GaveUp:
    stop = GaveUp(f"given up at {state.time:.6g} s, before frame {frame}, after {effort.evaluations} evaluations of "
                  "the body: its equilibrium is hard to find")
    stop.time, stop.frame = state.time, frame
    return stop


def _gave_up(error: NotConverged, state: Converged, frame: int, target: float, frozen: bool) -> NotConverged:
    tried = "with fixed increments" if frozen else f"down to increments of {target - state.time:.3g} s"
    stop = NotConverged(f"no equilibrium beyond {state.time:.6g} s, before frame {frame}, {tried}: {error}. "
                        "Check loads and parameters at that time, or use more substeps.")
    stop.time, stop.frame = state.time, frame
    return stop


def channel_values(reactions: Sequence[Reaction], forces: np.ndarray) -> np.ndarray:
    """Sums over the dofs of each channel; forces (n_dof,) or (n_dof, m)."""
    rows = [r.factor * forces[np.asarray(r.dofs, dtype=np.int64)].sum(axis=0) for r in reactions]
    return np.array(rows).reshape(len(reactions), *forces.shape[1:])


def _frame_state(system: System, frame: int, end: Converged, changes: Changes, influence: Influence, newton, step_ends,
                 directions: Sequence[Direction]) -> FrameState:
    body, shape = system.body, end.u.shape
    values = tuple(PointValues(group.section, group.cell, group.elements, g.F, g.P, g.state)
                   for group, g in zip(system.groups, end.evaluation.groups, strict=True))
    rises = surface_rise(system, end, changes.states, directions) if body.surface_side else (None, None)
    return FrameState(frame, end.time, end.u, channel_values(body.channels, end.evaluation.residual.ravel()),
                      changes.du.reshape(*shape, -1), channel_values(body.channels, changes.forces),
                      influence.du, channel_values(body.channels, influence.forces), newton, values,
                      StepList(step_ends), *rises, influence.rise)


def _reference_frame(system: System, times, directions, rest_state: Converged) -> FrameState:
    shape, n, m = rest_state.u.shape, len(system.body.channels), len(system.body.local_drives
                                                                      + system.body.local_loads)
    local, local_forces = np.zeros((*shape, m)), np.zeros((n, m))
    identity = np.eye(shape[1])
    values = tuple(PointValues(g.section, g.cell, g.elements, np.tile(identity, (g.n_points, 1, 1)),
                               np.zeros((g.n_points, *identity.shape)), state)
                   for g, state in zip(system.groups, rest_state.states, strict=True))
    rises = ([np.zeros(shape[0]), np.zeros((shape[0], len(directions))), np.zeros((shape[0], m))]
             if system.body.surface_side else [])
    return FrameState(0, float(times[0]), rest_state.u, np.zeros(n), np.zeros((*shape, len(directions))),
                      np.zeros((n, len(directions))), local, local_forces, 0, values, StepList(), *rises)
