"""The scale of a selected cause, where one of the few that are screened leaves something.

A seating is screened with three values of the force under which the grips settle. The selected value differs from the
true one, and the residual of that difference looks like a further cause. So the scale s is found by refits: a parabola
through chi-square over log s on the copy for choosing; the copy without a part in that choice decides. The scale is
held afterwards, and no error bar counts its uncertainty.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from idic.diagnose.refits.refit import Refit
from idic.diagnose.refits.refit_job import ExperimentSource, Refits
from idic.diagnose.residual.subspace import Grid
from idic.diagnose.selection.own_course import leaves_something, refitted_as
from idic.diagnose.selection.rival import MIN_HELDOUT_DROP, Rival

STEP = 0.5  # of log(scale): half the way to the next one that is screened
MAX_REFITS, SETTLED = 6, 0.02  # of log(scale): another step says no more


def with_own_scale(source: ExperimentSource, null: Refit, winner: Rival, refits: Refits, grid: Grid,
                   seed: int) -> Rival | None:
    """The winner of a round with the scale that explains most; None where it has none, or needs no other one."""
    rescaled = winner.ranked.candidate.rescaled
    if rescaled is None or winner.copies > 1 or winner.refitted.choice is None \
            or not leaves_something(winner.refitted.choice):
        return None
    tried: dict[float, Rival] = {0.0: winner}
    while len(tried) <= MAX_REFITS and (place := next_scale({x: _left(one) for x, one in tried.items()})) is not None:
        variant = rescaled(winner.ranked.variant, float(np.exp(place)))
        near = min(tried, key=lambda x: abs(x - place))
        starts = replace(variant, probe={name: tried[near].refitted.values[name] for name in variant.new})
        found = refitted_as(starts, source, null, winner, refits, grid, seed)
        if found is None:
            break
        tried[place] = found
    best = min(tried.values(), key=_left)
    return best if best.heldout - winner.heldout > MIN_HELDOUT_DROP + 1 else None


def next_scale(left: dict[float, float]) -> float | None:
    """Where chi-square is tried next, by that of the places tried; None where the lowest is known to `SETTLED`."""
    best = min(left, key=lambda x: left[x])
    below, above = (max((x for x in left if x < best), default=None), min((x for x in left if x > best), default=None))
    if below is None or above is None:  # no bracket yet: on to the side that falls
        return best - STEP if below is None and (above is not None or len(left) == 1) else best + STEP
    at = np.array([below, best, above])
    a, b, _ = np.polyfit(at - best, [left[x] for x in at], 2)
    place = float(np.clip(best - 0.5 * b / a, 0.5 * (below + best), 0.5 * (best + above))) if a > 0.0 else best
    return place if abs(place - best) > SETTLED else None


def _left(rival: Rival) -> float:
    return rival.refitted.choice.chi2  # type: ignore[union-attr]
