"""Rivals of a selected cause compared again, once bricks, finite strains or an error of the mesh have joined it.

A cause is selected while the model still lacks the thickness of the body and its strains, if the cause hid them. Of two
candidates with nearly the same chi-square the one that imitates a part of these errors is selected then: plasticity of
a beam of bricks was told as creep with an exponent of ten, whose held-out chi-square was lower by 19 of 2400; bricks
lowered it by another 32. So the nearest rivals get the same errors, computed with their own motion, and all are judged
anew.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from idic.diagnose.discretisation.known_error import known_error
from idic.diagnose.refit import Refit, identification_at
from idic.diagnose.refit_job import ExperimentSource, Refits, refit_of_one
from idic.diagnose.residual.subspace import Grid
from idic.diagnose.selection.finite_strains import finite
from idic.diagnose.selection.rival import Rival, Round, judge
from idic.diagnose.selection.rivals import edits_of
from idic.model.motion_error import MotionError

MAX_RIVALS = 2  # that are compared again
# of the winner's evidence, in chi-square: what a rival may have lacked before; bricks are counted from 25 on, and may
# help the one and harm the other
NEAR_SHARE, NEAR_CHI2 = 0.05, 50.0

ErrorOf = Callable[[ExperimentSource, Rival], MotionError]


def judged_again(rounds: Sequence[Round], near: Sequence[Rival], source: ExperimentSource, null: Refit, is_finite: bool,
                 error_of: ErrorOf | None, refits: Refits, grid: Grid,
                 seed: int) -> tuple[list[Round], ExperimentSource, Refit]:
    """The rounds, the last source and its fit, after the nearest rivals of the last cause have been compared with it in
    the present model.

    near : the nearest rivals as they were before (`near_rivals`); source, null : of the model with that cause and the
    errors that have joined; is_finite : finite strains are among them; error_of : of a rival's own simulation, None
    where no other error is known
    """
    last, present = rounds[-1], (list(rounds), source, null)
    winner = refitted_again(last.winner, replace(null, label=last.winner.refitted.label))  # type: ignore
    sources, again = {}, []
    for rival in near if winner is not None else ():
        formed = finite(rival, last.screening) if is_finite else rival
        there = last.source.with_edits(edits_of(formed, last.screening))  # type: ignore[union-attr]
        if error_of is not None:
            there = there.with_motion_error(error_of(there, formed))
        (fitted,) = refits([refit_of_one(there, rival.name, rival.refitted, grid, seed)])
        made = refitted_again(formed, replace(fitted, label=rival.refitted.label)) if fitted.usable else None
        if made is not None:
            sources[made.ranked.key] = there
            again.append(made)
    chosen, equals = judge([winner, *again], last.screening) if again else (None, ())  # type: ignore[list-item]
    if chosen is None:
        return present
    others = {one.ranked.key: one for one in (winner, *again)}  # type: ignore[union-attr]
    one = replace(last, winner=chosen, equals=equals, rivals=tuple(others.get(r.ranked.key, r) for r in last.rivals))
    if chosen is winner:
        return [*rounds[:-1], one], source, null
    return [*rounds[:-1], replace(one, plain=None)], sources[chosen.ranked.key], chosen.refitted


def near_rivals(one: Round) -> list[Rival]:
    """Rivals of a round whose evidence comes near that of its winner, the nearest first."""
    winner = one.winner
    near = [r for r in one.rivals if r.ranked.key != winner.ranked.key and r.passes  # type: ignore[union-attr]
            and r.copies == winner.copies == 1 and winner.name not in r.ranked.candidate.limits  # type: ignore[union-attr]
            and winner.evidence - r.evidence < max(NEAR_SHARE * winner.evidence, NEAR_CHI2)]  # type: ignore[union-attr]
    return sorted(near, key=lambda r: -r.evidence)[:MAX_RIVALS]


def refitted_again(rival: Rival, refitted: Refit) -> Rival | None:
    """A rival with a later fit of the same cause; None where a copy is missing."""
    before = rival.refitted
    if None in (before.choice, before.judgement, refitted.choice, refitted.judgement):
        return None
    return replace(rival, refitted=refitted,
                   heldout=rival.heldout + before.judgement.chi2 - refitted.judgement.chi2,  # type: ignore[union-attr]
                   achieved=rival.achieved + before.choice.chi2 - refitted.choice.chi2)  # type: ignore[union-attr]


def own_error(source: ExperimentSource, rival: Rival, known: MotionError) -> MotionError:
    """The error of a rival's own simulation, of the kind that is known of the winner; that of the winner where it
    cannot be computed."""
    fitted = rival.refitted
    found = identification_at(source.load(), fitted.values, fitted.local, fitted.steps)
    return known_error(found, known) or known
