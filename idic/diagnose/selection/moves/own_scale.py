"""The scale of a selected cause, where one of the few that are screened leaves something.

A seating is screened with three values of the force under which the grips settle. The selected value differs from the
true one, and the residual of that difference looks like a further cause. So the scale s is found by refits: a parabola
through chi-square over log s on the copy for choosing; the copy without a part in that choice decides. The scale is
held afterwards, and no error bar counts its uncertainty.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from idic.diagnose.selection.move import Move
from idic.diagnose.selection.moves.own_course import refit_as
from idic.diagnose.selection.moves.shortlist import with_winner
from idic.diagnose.selection.rival import MIN_HELDOUT_DROP, Rival, leaves_something
from idic.diagnose.selection.state import Selected, State, improvable

STEP = 0.5  # of log(scale): half the way to the next one that is screened
MAX_REFITS, SETTLED = 6, 0.02  # of log(scale): another step says no more


def may_have_own_scale(selected: Selected) -> bool:
    """Whether the winner may have another scale: it leaves something."""
    choice = selected.winner.refitted.choice
    return selected.winner.copies == 1 and choice is not None and leaves_something(choice)


def with_own_scale(selected: Selected) -> State | None:
    """The winner with the scale that explains most on the copy for choosing; None where it has no scale, or its own one
    does."""
    winner = selected.winner
    rescaled = winner.ranked.candidate.rescaled
    if rescaled is None:
        return None
    tried: dict[float, Rival] = {0.0: winner}
    while len(tried) <= MAX_REFITS:
        place = next_scale({x: _chi2(rival) for x, rival in tried.items()})
        if place is None:
            break
        variant = rescaled(winner.ranked.variant, float(np.exp(place)))
        nearest = tried[min(tried, key=lambda x: abs(x - place))]
        probe = {name: nearest.refitted.values[name] for name in variant.new}
        rival = refit_as(selected.state, replace(variant, probe=probe), winner)
        if rival is None:
            break
        tried[place] = rival
    best = min(tried.values(), key=_chi2)
    return None if best is winner else with_winner(selected, best)


def is_worth_its_scale(selected: Selected, tried: State) -> bool:
    """Whether the scale brings on the copy for judging what an unknown must."""
    return tried.winner is not None and tried.winner.heldout - selected.winner.heldout > MIN_HELDOUT_DROP + 1


def next_scale(losses: dict[float, float]) -> float | None:
    """Where chi-square is tried next, by that of the places tried; None where the lowest is known to `SETTLED`."""
    best = min(losses, key=lambda x: losses[x])
    below, above = (max((x for x in losses if x < best), default=None),
                    min((x for x in losses if x > best), default=None))
    if below is None or above is None:  # no bracket yet: on to the side that falls
        return best - STEP if below is None and (above is not None or len(losses) == 1) else best + STEP
    at = np.array([below, best, above])
    a, b, _ = np.polyfit(at - best, [losses[x] for x in at], 2)
    place = float(np.clip(best - 0.5 * b / a, 0.5 * (below + best), 0.5 * (best + above))) if a > 0.0 else best
    return place if abs(place - best) > SETTLED else None


def _chi2(rival: Rival) -> float:
    return rival.refitted.choice.chi2


OWN_SCALE = Move("own scale", "refits_s", improvable, with_own_scale, may_have_own_scale, is_worth_its_scale)
