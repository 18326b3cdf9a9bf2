"""A course that the data give, where the course of a selected cause leaves something.

Candidates are screened with a few courses: in proportion to the motion or to time, ramps and jumps from some moments
on. The cause that is selected keeps its pattern. Where its refit leaves more than noise, its course becomes linear
between knots (`records.free_course`) and the model is refitted; the copy without a part in the fit decides whether
that course stays.

A cause with one amplitude per knot follows any function of time. Where the load only grows, that is any function of the
load: a free drift of the load cell and a stress that bends over the strain leave the same record. A rival that explains
nearly as much with a course of few unknowns is then not told from it, however large the drop of chi-square by the
further knots; unless the winner explained more than that rival when its own course had as few.

What another course of a cause would explain may be less than the sum over all free motions shows, and still be what a
further candidate is found for: a sheet that bulges late was told as two shapes. So before a further cause joins the
model, the last one is tried with a course of its own; where the whole loses nothing by that, it is the only cause, and
the round of the further one begins anew (`earlier_course`).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from idic.diagnose.physics.candidate import Variant
from idic.diagnose.physics.enrich import comes_back
from idic.diagnose.refits.fitted_model import FittedModel
from idic.diagnose.refits.refit import Fit
from idic.diagnose.refits.refit_job import RefitJob
from idic.diagnose.screen.courses import course_of
from idic.diagnose.selection.move import Move, itself
from idic.diagnose.selection.moves.shortlist import judged, with_winner
from idic.diagnose.selection.rival import (
    COPIES, MIN_DROP_DIFFERENCE, MIN_HELDOUT_DROP, MIN_TOLD_CHI2, Rival, Round, leaves_something, within_noise,
)
from idic.diagnose.selection.rivals import edits_of
from idic.diagnose.selection.state import Selected, State, improvable, last_cause
from idic.model import without_knot

MIN_IMITATED_SHARE = 0.9  # of the held-out drop of the winner: what the rival leaves would be a flaw of its description


def may_have_own_course(selected: Selected) -> bool:
    """Whether the winner leaves something that another course of its pattern may explain."""
    winner = selected.winner
    if winner.copies > 1 or winner.refitted.choice is None:
        return False
    return leaves_something(winner.refitted.choice) and not winner.ranked.variant.free_course


def with_own_course(selected: Selected) -> State | None:
    """The winner with a course that the data give; None where its pattern has none, or the refit fails."""
    source, winner, screening = selected.state.model.source, selected.winner, selected.round.screening
    variant = winner.ranked.variant
    free_variant = screening.free_course_of(variant)
    if free_variant is None:
        return None
    screened, freed = source.load(edits_of(winner, screening)), source.load(free_variant.edits)
    (name,) = variant.new
    course, size, start = course_of(screened, name), winner.refitted.values[name], {}
    for knot in free_variant.new:
        hat = course_of(freed, knot)
        top = int(np.argmax(np.abs(hat)))
        start[knot] = size * float(course[top] / hat[top])
    label = f"{variant.label}, with an identified time course"
    return refitted_as(selected, replace(free_variant, label=label, probe=start))


def is_worth_its_knots(selected: Selected, tried: State) -> bool:
    """Whether every further knot brings on the copy for judging what an unknown must."""
    if tried.winner is None:
        return False
    knots = len(tried.winner.ranked.variant.new) - 1
    return tried.winner.heldout - selected.winner.heldout > MIN_HELDOUT_DROP + knots


def may_replace_further(selected: Selected) -> bool:
    """Whether the last cause has a course to be freed before a further one joins it."""
    cause = last_cause(selected.state)
    return cause is not None and cause.winner.copies == 1 and not cause.winner.ranked.variant.free_course


def earlier_course(selected: Selected) -> State | None:
    """The round of the last cause, open again, with a course that the data give; None where its pattern has none."""
    state, cause = selected.state, last_cause(selected.state)
    if cause is None:
        return None
    entry, rounds = cause.round, state.rounds[:-1]
    is_doubted = state.doubted is not None and len(state.doubted.rounds) >= len(rounds)
    begun = replace(state, rounds=rounds, model=FittedModel(entry.source, entry.null), round=entry,
                    doubted=None if is_doubted else state.doubted)
    tried = with_own_course(Selected(begun, entry, cause.winner))
    return None if tried is None else judged(tried, tried.round)


def loses_nothing(selected: Selected, tried: State) -> bool:
    """Whether a course of the last cause explains what a further one does, but for noise, and is worth its knots."""
    cause, freed = last_cause(selected.state), tried.winner
    if cause is None or freed is None or not has_own_course(freed) or not is_worth_its_knots(cause, tried):
        return False
    loss = _on_both_copies(freed.refitted) - _on_both_copies(selected.winner.refitted)
    return loss < max(MIN_TOLD_CHI2, COPIES * MIN_DROP_DIFFERENCE * freed.achieved)


def _on_both_copies(fit: Fit) -> float:
    """Chi-square, and twice the number of unknowns (`Rival.evidence`)."""
    if fit.choice is None or fit.judgement is None:
        return float("inf")
    return fit.choice.chi2 + fit.judgement.chi2 + 2.0 * len(fit.stds)


def refitted_as(selected: Selected, variant: Variant) -> State | None:
    """The round whose winner is another variant of its cause, which may give way to the former one in a revised set;
    None where its refit fails."""
    rival = refit_as(selected.state, variant, selected.winner)
    if rival is None:
        return None
    plain = selected.round.plain or selected.winner
    return with_winner(replace(selected, round=replace(selected.round, plain=plain)), rival)


def refit_as(state: State, variant: Variant, rival: Rival) -> Rival | None:
    """A rival refitted as another variant of its cause, from its values and the probe of that variant; None where the
    refit fails."""
    source, null = state.model.source, state.model.fit
    (answer,) = state.refits([RefitJob(rival.name, source, (variant.label,), (variant.edits,),
                                       ({**rival.refitted.values, **variant.probe},), rival.refitted.local,
                                       state.setting.grid, np.inf, state.setting.seed)])
    if not answer.usable:
        return None
    return replace(rival, ranked=replace(rival.ranked, variant=variant, label=variant.label), refitted=answer,
                   achieved=null.choice.chi2 - answer.choice.chi2,
                   heldout=null.judgement.chi2 - answer.judgement.chi2)


def has_own_course(rival: Rival) -> bool:
    """Whether its course is given by the data."""
    return any(without_knot(name) != name for name in rival.ranked.variant.new)


def with_imitated(entry: Round, u: np.ndarray) -> Round:
    """The round with the rivals that the free course of its winner imitates among the indistinguishable ones.

    u : (n_frames, n_nodes, dim) simulated motion of the recording, whose way back tells a course from the load
    """
    winner = entry.winner
    if winner is None or not has_own_course(winner) or comes_back(u):
        return entry
    alike = [rival.name for rival in entry.rivals
             if rival.name not in (winner.name, *entry.equals) and rival.passes and rival.copies == winner.copies
             and len(rival.own_unknowns) < len(winner.own_unknowns) and not _is_behind(rival, entry.plain)
             and rival.heldout > MIN_IMITATED_SHARE * winner.heldout]
    return replace(entry, equals=(*entry.equals, *dict.fromkeys(alike)))


def _is_behind(rival: Rival, plain: Rival | None) -> bool:
    """Whether the winner was better than this rival with as few unknowns, before its course was freed."""
    return (plain is not None and plain.copies == rival.copies and plain.evidence > rival.evidence
            and len(plain.own_unknowns) <= len(rival.own_unknowns) and not within_noise(rival, plain))


def imitated(state: State) -> State:
    """All rounds with the rivals that the free courses of their winners imitate."""
    u = state.model.residual.u
    return replace(state, rounds=tuple(with_imitated(entry, u) for entry in state.rounds))


EARLIER_COURSE = Move("course of the last cause", "refits_s", improvable, earlier_course, may_replace_further,
                      loses_nothing)
OWN_COURSE = Move("own course", "refits_s", improvable, with_own_course, may_have_own_course, is_worth_its_knots)
IMITATED = Move("imitated rivals", "refits_s", itself, imitated)
