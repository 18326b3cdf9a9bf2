"""Rivals of a selected cause compared again, once bricks, finite strains or an error of the mesh have joined it.

A cause is selected while the model still lacks the thickness of the body and its strains, if the cause hid them. Of two
candidates with nearly the same chi-square the one that imitates a part of these errors is selected then: plasticity of
a beam of bricks was told as creep with an exponent of ten, whose held-out chi-square was lower by 19 of 2400; bricks
lowered it by another 32. So the nearest rivals get the same errors, computed with their own motion, and all are judged
anew.

A rival is fitted again only where this can matter. With its own error at the end of its last fit, its parameters follow
by one step, and chi-square falls by b^T G^-1 b (`idic.diagnose.discretisation.following`). One that is behind the
winner by more than noise and the error of first order stays behind: creep beside plasticity (3900 of 865 000 behind
before bricks, 5700 after) took 178 CPU s for it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from idic.diagnose.discretisation.following import following
from idic.diagnose.discretisation.known_error import known_error
from idic.diagnose.refits.refit import Refit, identification_at, residual_from_rest
from idic.diagnose.refits.refit_job import ExperimentSource, Refits, refit_of_one
from idic.diagnose.residual.heldout import fit
from idic.diagnose.residual.subspace import Grid
from idic.diagnose.selection.finite_strains import finite
from idic.diagnose.selection.rival import Rival, Round, judge, noise_of_evidence
from idic.diagnose.selection.rivals import FIRST_ORDER_ERROR_SHARE, edits_of
from idic.identification import ORDINARY
from idic.model import MotionError
from idic.simulation_error import thickness_error

MAX_RIVALS = 2  # that are compared again
# of the winner's evidence, in chi-square: what a rival may have lacked before; bricks are counted from 25 on, and may
# help the one and harm the other
NEAR_SHARE, NEAR_CHI2 = 0.05, 50.0



@dataclass(frozen=True, eq=False)
class Foreseen:
    """A model beside the errors that have joined, to first order from where it was fitted without them.

    source : with its own error; moved : of its parameters since that fit; chi2 : of the recording then; gain : the part
    of it that the parameters have taken by following
    """

    source: ExperimentSource
    moved: Mapping[str, float]
    chi2: float
    gain: float


# a rival whose source has the winner's error -> with its own; None where it finds no equilibrium from rest
Foresee = Callable[[ExperimentSource, Rival], Foreseen | None]


def judged_again(rounds: Sequence[Round], near: Sequence[Rival], source: ExperimentSource, null: Refit, is_finite: bool,
                 foresee: Foresee | None, refits: Refits, grid: Grid, seed: int,
                 left: float = -np.inf) -> tuple[list[Round], ExperimentSource, Refit]:
    """The rounds, the last source and its fit, after the nearest rivals of the last cause have been compared with it in
    the present model.

    near : the nearest rivals as they were before (`near_rivals`); source, null : of the model with that cause and the
    errors that have joined; is_finite : finite strains are among them; foresee : None fits all rivals again as they
    are; left : chi-square of the recording beside the winner, after its parameters have followed
    """
    last, present = rounds[-1], (list(rounds), source, null)
    former = last.winner.refitted  # type: ignore[union-attr]
    winner = refitted_again(last.winner, replace(null, name=former.name, label=former.label))  # type: ignore
    sources, again, behind = {}, [], False
    for rival in near if winner is not None else ():
        formed = finite(rival, last.screening) if is_finite else rival
        there = last.source.with_edits(edits_of(formed, last.screening))  # type: ignore[union-attr]
        known = None if foresee is None else foresee(there, formed)
        if known is not None and is_behind(known, rival, winner, left):  # type: ignore[arg-type]
            behind = True
            continue
        there, moved = (there, None) if known is None else (known.source, known.moved)
        near_by = known is not None and not is_finite
        (fitted,) = refits([refit_of_one(there, rival.name, rival.refitted, grid, seed, moved,
                                         estimator=rival.refitted.estimator if near_by else ORDINARY)])
        made = refitted_again(formed, replace(fitted, label=rival.refitted.label)) if fitted.usable else None
        if made is not None:
            sources[made.ranked.key] = there
            again.append(made)
    chosen, equals = judge([winner, *again], last.screening) if again or behind else (None, ())  # type: ignore
    if chosen is None:
        return present
    others = {one.ranked.key: one for one in (winner, *again)}  # type: ignore[union-attr]
    one = replace(last, winner=chosen, equals=equals, rivals=tuple(others.get(r.ranked.key, r) for r in last.rivals))
    if chosen is winner:
        return [*rounds[:-1], one], source, null
    return [*rounds[:-1], replace(one, plain=None)], sources[chosen.ranked.key], chosen.refitted


def is_behind(known: Foreseen, rival: Rival, winner: Rival, left: float) -> bool:
    """Whether a rival is behind the winner by more than noise and an error of first order.

    left : see `judged_again`
    """
    gap = known.chi2 - left + 2.0 * (len(rival.own_unknowns) - len(winner.own_unknowns))
    return gap > noise_of_evidence(winner) + FIRST_ORDER_ERROR_SHARE * known.gain


def foreseen(there: ExperimentSource, rival: Rival, known: MotionError | None, before: MotionError | None,
             grid: Grid) -> Foreseen | None:
    """A rival beside its own error, from the end of its fit without it; None where it finds no equilibrium from rest.

    known, before : error of the winner, and before the last ones joined
    """
    if known is not None:
        there = there.with_motion_error(own_error(there, rival, known, before))
    residual = residual_from_rest(there.load(), rival.refitted)
    if residual is None:
        return None
    moved, gain = following(residual)
    return Foreseen(there, moved, fit(residual, grid).chi2 - gain, gain)


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


def own_error(source: ExperimentSource, rival: Rival, known: MotionError, before: MotionError | None) -> MotionError:
    """The error of a rival's own simulation, of the kind that is known of the winner; that of the winner where it
    cannot be computed. As of the winner, that of the mesh stays where bricks have just joined it.

    before : error of both before
    """
    fitted = rival.refitted
    found = identification_at(source.load(), fitted.values, fitted.local, fitted.steps)
    if known.thickness is not None and (before is None or before.thickness is None):
        return (thickness_error(found.model_point) or known.thickness).on_top_of(known.of_mesh)
    return known_error(found, known) or known
