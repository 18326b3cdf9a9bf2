"""One increment: Newton's method with the consistent tangent, from a converged state to the next time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from idic.errors import NotConverged
from idic.fe.assembly.assembly import element_matrices, evaluate_system, stiffness_times, stiffness_values
from idic.fe.assembly.assembly import Evaluation, System
from idic.fe.body.boundary import Drives
from idic.fe.solver.krylov import correction as iterated
from idic.fe.solver.linear import Factor, FactorKind, SingularMatrix, factorise


@dataclass(frozen=True)
class Control:
    """Tolerances of an increment, and the measures where they are missed.

    Attributes
    ----------
    tolerance : float
        Largest out-of-balance nodal force, relative to the largest nodal reaction or load met so far.
    max_iterations : int
        Newton iterations per increment.
    clamp : float
        Largest Newton correction of a displacement, relative to the diagonal of the body.
    smallest_cut : float
        Increments are not halved below this part of the interval between two frames.
    most_failures : int
        Between two frames. Where every other increment fails (a body that softens and tears), a thousand small ones
        take minutes and reach no equilibrium.
    most_evaluations : int or None
        Evaluations of the body per frame, on the mean of the whole test, failed increments included; None: any number.
        A simulation that needs more is given up, an increment later.
    """

    tolerance: float = 1e-9
    max_iterations: int = 16
    clamp: float = 0.1
    smallest_cut: float = 1 / 1024
    most_failures: int = 30
    most_evaluations: int | None = None


@dataclass
class Effort:
    """Evaluations of the body in one simulation so far, failed increments included; they grow during the march."""

    evaluations: int = 0


@dataclass(frozen=True)
class Converged:
    """An equilibrium: displacement (n_nodes, d), point states per group, and the evaluation that belongs to them.

    ``force_scale`` (N) is the largest nodal reaction or load so far; ``factor`` is the last factorisation used,
    ``gain`` the part of the error that an iteration with it left in the last correction, inf where none was made;
    ``kind``: the cheapest kind of factors that served;
    ``bend`` of a path that a gauge controls: how far the increment left its tangent, relative to its length.
    """

    drives: Drives
    u: np.ndarray
    states: tuple[np.ndarray, ...]
    force_scale: float = 0.0
    evaluation: Evaluation | None = None
    iterations: int = 0
    factor: Factor | None = None
    factor_matrices: tuple[np.ndarray, ...] = ()
    bend: float = 0.0
    gain: float = np.inf
    kind: FactorKind = FactorKind.SINGLE

    @property
    def time(self) -> float:
        return self.drives.time


def solve_increment(system: System, params: Mapping[str, np.ndarray], start: Converged, drives: Drives,
                    predictor: np.ndarray | None, control: Control, line_search: bool = False,
                    effort: Effort | None = None) -> Converged:
    """The equilibrium under `drives`, reached from `start`.

    Parameters
    ----------
    predictor : (n_nodes, d) mm or None
        First guess of the displacement; prescribed values are set exactly. None: a tangent step from `start`.
    line_search : bool
        Shorten a correction that makes the out-of-balance force grow. Slower where Newton's path must climb first
        (flat membranes), but it stops the oscillation of points between elastic and plastic.
    effort : counts the evaluations

    Raises
    ------
    NotConverged
        With the reason; the caller may try a smaller increment.
    """
    held_dofs = np.asarray(system.body.constraints.dofs)
    limit, dt = control.clamp * system.size, drives.time - start.time

    def evaluate(u, guesses):
        if effort is not None:
            effort.evaluations += 1
        return evaluate_system(system, params, u, start.states, dt, drives, guesses)

    tangent, iterations = _Tangent.of(start), 0
    if predictor is None:
        ev = admissible(evaluate(start.u, start.states))
        move, tangent = _tangent_move(system, ev, drives, held_dofs, tangent)
        move = _clamped(move, held_dofs, limit)
        ev, iterations = admissible(evaluate(start.u + move.reshape(start.u.shape), start.states)), 1
    else:
        u = predictor.copy()
        u.reshape(-1)[held_dofs] = drives.prescribed
        ev = admissible(evaluate(u, start.states))
    first, last_unbalanced = None, 0.0
    while True:
        unbalanced, scale = balance(system, ev, held_dofs, start.force_scale)
        rounding, coarseness = negligible(system, ev)
        if unbalanced <= control.tolerance * scale + rounding or unbalanced <= coarseness:
            states = tuple(g.state for g in ev.groups)
            return Converged(drives, ev.u, states, scale, ev, iterations, tangent.factor, tangent.matrices,
                             gain=tangent.gain, kind=tangent.kind)
        first = unbalanced if first is None else first
        if iterations >= control.max_iterations or not unbalanced < 1e6 * max(first, scale):
            raise NotConverged(where_unbalanced(system, ev, unbalanced, scale, iterations))
        rhs, correction = -ev.residual.ravel()[system.pattern.dofs], np.zeros(ev.u.size)
        # a correction with the same factor is expected to gain as much as the last one
        if unbalanced**2 <= MAX_CHORD_UNBALANCE * control.tolerance * scale * last_unbalanced:
            correction[system.pattern.dofs] = tangent.factor.approximate(rhs)
        else:
            correction[system.pattern.dofs], tangent = _solution(system, ev, rhs, tangent)
        last_unbalanced = unbalanced
        correction = _clamped(correction, held_dofs, limit).reshape(ev.u.shape)
        ev = _corrected(system, evaluate, ev, correction, LINE_SEARCH_PARTS if line_search else (1.0,))
        iterations += 1


def linear_move(system: System, params: Mapping[str, np.ndarray], start: Converged, drives: Drives) -> np.ndarray:
    """The displacement increment to `drives` if stiffness stayed as it is at `start`  # (n_nodes, d) mm"""
    ev = admissible(evaluate_system(system, params, start.u, start.states, drives.time - start.time, drives))
    held_dofs = np.asarray(system.body.constraints.dofs)
    move, _ = _tangent_move(system, ev, drives, held_dofs, _Tangent.of(start))
    return move.reshape(start.u.shape)


MAX_GAIN_KEPT = 0.03  # of the error per iteration: at most eight iterations to the last digit
MAX_GAIN_REUSED = 0.25  # of the error per iteration: beyond, four iterations of a correction, a new factor comes next
MAX_CHORD_UNBALANCE = 0.1  # of the tolerance: an old factor that is expected to bring the forces below this is used
LINE_SEARCH_PARTS = (1.0, 0.5, 0.25, 0.125, 0.0625)  # parts of a Newton correction that a line search tries


@dataclass(frozen=True)
class _Tangent:
    """The last factors of the tangent, and what `Converged` says of them."""

    factor: Factor | None
    matrices: tuple[np.ndarray, ...] = ()
    gain: float = np.inf
    kind: FactorKind = FactorKind.SINGLE

    @classmethod
    def of(cls, start: Converged) -> _Tangent:
        return cls(start.factor, start.factor_matrices, start.gain, start.kind)

    @property
    def is_reused(self) -> bool:
        """Whether the factor is near enough to the present tangent, by its last use."""
        return self.factor is not None and not self.matrices and not MAX_GAIN_REUSED < self.gain < np.inf


def _tangent_move(system: System, ev: Evaluation, drives: Drives, held_dofs: np.ndarray,
                  tangent: _Tangent) -> tuple[np.ndarray, _Tangent]:
    """Displacement increment (n_dof,) linearised about the start of the step, prescribed increments included."""
    move = np.zeros(ev.u.size)
    move[held_dofs] = drives.prescribed - ev.u.ravel()[held_dofs]
    rhs = -(ev.residual.ravel() + stiffness_times(system, ev, move[:, None])[:, 0])
    move[system.pattern.dofs], tangent = _solution(system, ev, rhs[system.pattern.dofs], tangent)
    return move, tangent


def _solution(system: System, ev: Evaluation, rhs: np.ndarray, tangent: _Tangent) -> tuple[np.ndarray, _Tangent]:
    """Solution with the tangent of an evaluation, by an earlier factor where a new one costs much and it still
    serves."""
    if system.pattern.costs_much and tangent.is_reused:
        iterated_solution = iterated(system.pattern.matrix(stiffness_values(system, ev)), tangent.factor, rhs)
        if iterated_solution is not None:
            return iterated_solution.x, replace(tangent, gain=iterated_solution.gain)
    factor, matrices = _factor(system, ev, tangent.factor, tangent.matrices, tangent.kind)
    tangent = _Tangent(factor, matrices, kind=factor.kind)
    if factor.of_symmetric_part and not matrices:
        iterated_solution = iterated(factor.matrix, factor, rhs)
        if iterated_solution is not None:
            return iterated_solution.x, replace(tangent, gain=iterated_solution.gain)
    return factor.solve(rhs), tangent


def _corrected(system: System, evaluate, ev: Evaluation, correction: np.ndarray, parts) -> Evaluation:
    """The evaluation after the first part of the correction that lowers the out-of-balance force, else the best."""
    guesses, free_dofs = [g.state for g in ev.groups], system.pattern.dofs
    start_norm = np.linalg.norm(ev.residual.ravel()[free_dofs])
    best, least = None, np.inf
    for part in parts:
        trial = evaluate(ev.u + part * correction, guesses)
        if len(parts) == 1:
            return admissible(trial)
        norm = np.inf if trial.trouble else np.linalg.norm(trial.residual.ravel()[free_dofs])
        if norm < least or best is None:
            best, least = trial, norm
        if least < (1 - 0.1 * part) * start_norm:
            break
    return admissible(best)


def admissible(ev: Evaluation) -> Evaluation:
    """The evaluation, if it is admissible; else `NotConverged` with the reason."""
    if ev.trouble:
        raise NotConverged(ev.trouble)
    return ev


def balance(system: System, ev: Evaluation, held_dofs: np.ndarray, so_far: float) -> tuple[float, float]:
    """Largest out-of-balance force and the scale (N) it is compared with."""
    residual = ev.residual.ravel()
    unbalanced = float(np.abs(residual[system.pattern.dofs]).max(initial=0.0))
    scale = max(so_far, float(np.abs(residual[held_dofs]).max(initial=0.0)),
                float(np.abs(ev.external).max(initial=0.0)),
                _thermal_force(system, ev))
    if not (np.isfinite(unbalanced) and np.isfinite(scale)):
        raise NotConverged("the nodal forces are not finite")
    return unbalanced, scale


def _thermal_force(system: System, ev: Evaluation) -> float:
    """Nodal force that would hold back the free thermal expansion: a body that is only warmed has no other scale."""
    if all(g.expansion is None for g in ev.groups):
        return 0.0
    return max(float(np.abs(g.expansion).max()) * stiff * group.largest_area
               for group, g, stiff in zip(system.groups, ev.groups, _stiffnesses(ev), strict=True)
               if g.expansion is not None)


def _stiffnesses(ev: Evaluation) -> list[float]:
    """Largest entry of the material tangent of each group, MPa."""
    return [max(float(g.A.max()), -float(g.A.min())) for g in ev.groups]


def negligible(system: System, ev: Evaluation) -> tuple[float, float]:
    """Out-of-balance forces (N) below the rounding of F, and of the last digit of u.

    Rounding: units in the last place times stiffness times area of a node. The last digit of u decides in thin bodies
    that move far under small forces: the strain of an element of height h is only known to ulp(u) / h; forces follow
    with the largest stiffness, from several points and elements at a node (the 4, which is twice what membranes of 2 um
    show).
    """
    stiffest, eps = _stiffnesses(ev), float(np.finfo(float).eps)
    rounding = max(stiff * group.largest_area for stiff, group in zip(stiffest, system.groups, strict=True))
    moved = float(np.abs(ev.u).max(initial=0.0))
    coarse = max(stiff * group.largest_area * group.steepest
                 for stiff, group in zip(stiffest, system.groups, strict=True))
    coarse = max([coarse, *(float(np.abs(K).max()) for K in ev.seam_K)])  # of the last digit of an opening
    return 16 * eps * rounding, 4 * eps * moved * coarse


def _clamped(move: np.ndarray, held_dofs: np.ndarray, limit: float) -> np.ndarray:
    """The correction scaled down to the limit; prescribed values are always reached."""
    free_move = move.copy()
    free_move[held_dofs] = 0.0
    largest = float(np.abs(free_move).max(initial=0.0))
    if not np.isfinite(largest):
        raise NotConverged("the Newton correction is not finite")
    if largest <= limit:
        return move
    free_move *= limit / largest
    free_move[held_dofs] = move[held_dofs]
    return free_move


def _factor(system: System, ev: Evaluation, factor: Factor | None, matrices,
            kind: FactorKind = FactorKind.SINGLE) -> tuple[Factor, tuple]:
    """Factorise the stiffness; small-strain laws without memory keep the factor while nothing changed."""
    constant = all(g.law.small and g.law.spec.n_state == 0 for g in system.groups) and not system.pressures
    if constant:
        for group, g in zip(system.groups, ev.groups, strict=True):
            element_matrices(group, g)
        current_matrices = (*(g.Ke for g in ev.groups), *ev.seam_K)
        if factor is not None and matrices and all(_equal(a, b)
                                                   for a, b in zip(current_matrices, matrices, strict=True)):
            return factor, matrices
    try:
        values = stiffness_values(system, ev)
        return factorise(system.pattern, values, kind), current_matrices if constant else ()
    except SingularMatrix as error:
        raise NotConverged(f"the stiffness is singular ({error}): check material parameters and supports") from None


def _equal(a: np.ndarray, b: np.ndarray) -> bool:
    return a is b or bool(np.abs(a - b).max() <= 1e-12 * np.abs(b).max())  # rounding of the plane-stress condensation


def serves(system: System, at: Converged) -> bool:
    """Whether the factors that found an equilibrium are near its tangent, so that iterations cost less than new
    factors."""
    return system.pattern.costs_much and not at.factor_matrices and at.factor is not None and at.gain <= MAX_GAIN_KEPT


def consistent_factor(system: System, at: Converged) -> Factor:
    """The consistent tangent at a converged increment, factorised or with the factors of before where they serve."""
    if serves(system, at):
        return replace(at.factor, matrix=system.pattern.matrix(stiffness_values(system, at.evaluation)),
                       of_earlier_tangent=True)
    return _factor(system, at.evaluation, at.factor, at.factor_matrices, at.kind)[0]


def factorise_tangent(system: System, evaluation: Evaluation) -> Factor:
    """The factorised tangent of an evaluation with stiffness."""
    return _factor(system, evaluation, None, ())[0]


def kept_factor(system: System, evaluation: Evaluation, factor: Factor | None,
                matrices: tuple) -> tuple[Factor, tuple]:
    """`factorise_tangent`, or the factor of before where it still holds; and what to hand in next time."""
    return _factor(system, evaluation, factor, matrices)


def where_unbalanced(system: System, ev: Evaluation, unbalanced: float, scale: float, iterations: int) -> str:
    """The largest out-of-balance force (N) in words: size, node, component, element, section."""
    worst = int(system.pattern.dofs[np.argmax(np.abs(ev.residual.ravel()[system.pattern.dofs]))])
    node, component = divmod(worst, system.n_dim)
    mesh, place = system.body.mesh, ""
    for group in system.groups:
        hit = np.flatnonzero((group.connectivity == node).any(axis=1))
        if len(hit):
            place = (f", element {mesh.element_labels[group.elements[hit[0]]]} of "
                     f"{system.body.sections[group.section].name}")
            break
    return (f"out of balance by {unbalanced:.3g} N ({unbalanced / max(scale, 1e-300):.1e} of the largest force) after "
            f"{iterations} Newton iterations, worst in {'xyz'[component]} at node {mesh.node_labels[node]}{place}")
