"""One increment of a path that a gauge controls: equilibrium and the size of a drive or load, both unknown.

Where a body softens, the force and even the motion of the grips fall while a crack opens. A gauge across the crack only
opens. The size x of the drive or load is an unknown, for which the gauge reads its course:

    R(u, x) = 0,   gauge @ u = reading(t)

Newton's method with two solutions per iteration, K du0 = -R and K du1 = -dR/dx; x moves so that the gauge reads right
(arc-length method with a chosen measure of the path: de Borst, Comput. Struct. 25 (1987) 211,
doi:10.1016/0045-7949(87)90144-0). Only K at a fixed x must be regular.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from idic.errors import NotConverged
from idic.fe.assembly.assembly import evaluate_system, stiffness_times
from idic.fe.assembly.assembly import Evaluation, System
from idic.fe.body.boundary import Drives, with_amplitude
from idic.fe.equilibrium import (LINE_SEARCH_PARTS, Control, Converged, Effort, admissible, balance,
                                 factorise_tangent, negligible, where_unbalanced)
from idic.fe.sensitivity import answer_to_control

MIN_FELT = 1e-9  # of the largest displacement per unit of the controlled drive: the gauge must feel it


def solve_controlled(system: System, params: Mapping[str, np.ndarray], start: Converged, drives: Drives,
                     control: Control, line_search: bool = False, effort: Effort | None = None) -> Converged:
    """The equilibrium in which the gauge reads `drives.reading`, reached along the tangent from `start`.

    No extrapolated start: beyond the peak it would load parts that have to unload, and end on another branch.

    Raises
    ------
    NotConverged
        With the reason; the caller may try a smaller increment.
    """
    body, held_dofs = system.body, np.asarray(system.body.constraints.dofs)
    limit, dt = control.clamp * system.size, drives.time - start.time

    def evaluate(u: np.ndarray, amplitude: float, guesses) -> tuple[Evaluation, Drives]:
        scaled_drives = with_amplitude(body, drives, amplitude)
        if effort is not None:
            effort.evaluations += 1
        return evaluate_system(system, params, u, start.states, dt, scaled_drives, guesses), scaled_drives

    amplitude = start.drives.amplitude
    ev, scaled_drives = evaluate(start.u, amplitude, start.states)
    admissible(ev)
    first, iterations, along = None, 0, np.zeros(start.u.size)
    while True:
        unbalanced, scale = balance(system, ev, held_dofs, start.force_scale)
        rounding, coarseness = negligible(system, ev)
        met = _reads_right(system, ev, scaled_drives, held_dofs)
        if met and (unbalanced <= control.tolerance * scale + rounding or unbalanced <= coarseness):
            moved = ev.u.ravel() - start.u.ravel()
            bend = np.linalg.norm(moved - along) / max(np.linalg.norm(moved), np.finfo(float).tiny)
            return Converged(scaled_drives, ev.u, tuple(g.state for g in ev.groups), scale, ev, iterations, bend=bend)
        if met:
            first = unbalanced if first is None else first
            if not unbalanced < 1e6 * max(first, scale):
                raise NotConverged(where_unbalanced(system, ev, unbalanced, scale, iterations))
        if iterations >= control.max_iterations:
            raise NotConverged(where_unbalanced(system, ev, unbalanced, scale, iterations))
        stiff = start.evaluation if iterations == 0 and start.evaluation is not None else ev
        correction, more = _correction(system, ev, stiff, scaled_drives, held_dofs)
        along = correction if iterations == 0 else along
        largest = float(np.abs(correction).max(initial=0.0))
        if not np.isfinite(largest) or not np.isfinite(more):
            raise NotConverged("the Newton correction is not finite")
        clamp_factor = min(1.0, limit / largest) if largest > 0.0 else 1.0
        guesses = [g.state for g in ev.groups]
        ev, scaled_drives = _best(system, [(ev.u + part * clamp_factor * correction.reshape(ev.u.shape),
                                            scaled_drives.amplitude + part * clamp_factor * more)
                                           for part in (LINE_SEARCH_PARTS if line_search else (1.0,))], evaluate,
                                  guesses, ev)
        iterations += 1


def _best(system: System, trials, evaluate, guesses, start: Evaluation) -> tuple[Evaluation, Drives]:
    """The first trial that lowers the out-of-balance force, else the best."""
    free_dofs, best, least = system.pattern.dofs, None, np.inf
    limit = np.linalg.norm(start.residual.ravel()[free_dofs])
    for u, amplitude in trials:
        ev, scaled_drives = evaluate(u, amplitude, guesses)
        if len(trials) == 1:
            return admissible(ev), scaled_drives
        norm = np.inf if ev.trouble else np.linalg.norm(ev.residual.ravel()[free_dofs])
        if best is None or norm < least:
            best, least = (ev, scaled_drives), norm
        if least < 0.9 * limit:
            break
    return admissible(best[0]), best[1]


def _reads_right(system: System, ev: Evaluation, drives: Drives, held_dofs: np.ndarray) -> bool:
    """Whether held dofs and gauge have what is asked, to rounding."""
    gauge, u = system.body.control.gauge, ev.u.ravel()
    rounding = 64.0 * np.finfo(float).eps * float(np.abs(u).max(initial=0.0))
    off = float(np.abs(u[held_dofs] - drives.prescribed).max(initial=0.0))
    return bool(off <= rounding and abs(gauge @ u - drives.reading) <= rounding * np.abs(gauge).sum())


def _correction(system: System, ev: Evaluation, stiff: Evaluation, drives: Drives,
                held_dofs: np.ndarray) -> tuple[np.ndarray, float]:
    """Newton correction of the displacement (n_dof,) and of the size of the controlled drive or load

    stiff : the evaluation whose tangent is taken: at first that of the last increment, which knows what flows and tears
    """
    factor, gauge, free_dofs = factorise_tangent(system, stiff), system.body.control.gauge, system.pattern.dofs
    move = np.zeros(ev.u.size)
    move[held_dofs] = drives.prescribed - ev.u.ravel()[held_dofs]
    rhs = -ev.residual.ravel()
    if move.any():
        rhs = rhs - stiffness_times(system, stiff, move[:, None])[:, 0]
    move[free_dofs] = factor.solve(rhs[free_dofs])
    with_it = answer_to_control(system, stiff, factor)[0][:, 0]
    felt = float(gauge @ with_it)
    if not abs(felt) > MIN_FELT * float(np.abs(with_it).max(initial=0.0)):
        raise NotConverged("the gauge does not respond to the motion or force that it controls")
    more = (drives.reading - float(gauge @ (ev.u.ravel() + move))) / felt
    return move + more * with_it, more
