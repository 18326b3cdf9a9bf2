"""Rivals of a selected cause compared again, once bricks, finite strains or an error of the mesh have joined it.

A cause is selected while the model still lacks the thickness of the body and its strains, if the cause hid them. Of two
candidates with nearly the same chi-square, the selected candidate may then be the one that imitates a part of these
errors: creep with an exponent of ten in place of the plasticity of a beam of bricks, with a held-out chi-square lower
by 19 of 2400; bricks lower it by another 32. So the nearest rivals get the same errors, computed with their own motion,
and all are judged anew.

A rival is fitted again only where this can matter. With its own error at the end of its last fit, its parameters follow
by one step, and chi-square falls by b^T G^-1 b (`idic.diagnose.discretisation.following`). One that is behind the
winner by more than noise and the error of first order stays behind: creep beside plasticity (3900 of 865 000 behind
before bricks, 5700 after) took 178 CPU s for it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from idic.diagnose.discretisation.following import following, shortened
from idic.diagnose.discretisation.known_error import known_error
from idic.diagnose.refits.fitted_model import FittedModel
from idic.diagnose.refits.refit import Fit
from idic.diagnose.refits.refit_job import ExperimentSource, refit_of_one
from idic.diagnose.residual.heldout import misfit_of
from idic.diagnose.selection.move import Move
from idic.diagnose.selection.rival import COPIES, Rival, Round, judge, noise_of_evidence
from idic.diagnose.selection.rivals import FIRST_ORDER_ERROR_SHARE, edits_of, finite
from idic.diagnose.selection.state import JoinedCause, State, changed_cause
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

    source : with its own error; moved : of its parameters since that fit, where a fit begins (`shortened`); chi2 : of
    the recording then; gain : the part of it that the parameters have taken by following
    """

    source: ExperimentSource
    moved: Mapping[str, float]
    chi2: float
    gain: float


def with_rivals_again(cause: JoinedCause) -> State | None:
    """The last cause and its nearest rivals, as they were before, compared in the present model; None where no rival
    has an answer there."""
    state, entry, fit = cause.state, cause.round, cause.state.model.fit
    former = cause.winner.refitted
    winner = refitted_again(cause.winner, replace(fit, name=former.name, label=former.label))
    if winner is None:
        return None
    models, refitted_rivals, is_any_behind, remaining = {}, [], False, chi2_of_following(state)
    # refitted with finite strains where these have joined
    rivals_by_key = {rival.ranked.key: rival for rival in entry.rivals}
    for rival in (rivals_by_key.get(former.ranked.key, former) for former in cause.joined.close_rivals):
        formed = finite(rival, entry.screening) if cause.joined.is_finite else rival
        model = FittedModel(entry.source.with_edits(edits_of(formed, entry.screening)), rival.refitted)
        estimate = foreseen(cause, model, formed)
        if estimate is not None and is_far_from_linear(estimate, winner, remaining):
            estimate = None
        if estimate is not None and is_behind(estimate, rival, winner, remaining):
            is_any_behind = True
            continue
        model = fitted_beside(cause, model, estimate)
        later = refitted_again(formed, replace(model.fit, label=rival.refitted.label)) if model.fit.usable else None
        if later is not None:
            models[later.ranked.key] = model
            refitted_rivals.append(later)
    chosen, equals = None, ()
    if refitted_rivals or is_any_behind:
        chosen, equals = judge([winner, *refitted_rivals], entry.screening)
    if chosen is None:
        return None
    by_key = {rival.ranked.key: rival for rival in (winner, *refitted_rivals)}
    entry = replace(entry, winner=chosen, equals=equals,
                    rivals=tuple(by_key.get(rival.ranked.key, rival) for rival in entry.rivals))
    if chosen is winner:
        return state.with_last(entry, state.model)
    return state.with_last(replace(entry, plain=None),
                           FittedModel(models[chosen.ranked.key].source, chosen.refitted))


def fitted_beside(cause: JoinedCause, model: FittedModel, estimate: Foreseen | None) -> FittedModel:
    """A rival fitted beside the errors that have joined, from where first order sees it."""
    setting = cause.state.setting
    source, moved = (model.source, None) if estimate is None else (estimate.source, estimate.moved)
    is_near = estimate is not None and not cause.joined.is_finite
    (fit,) = setting.refits([refit_of_one(source, model.fit.name, model.fit, setting.grid, setting.seed, moved,
                                          estimator=model.fit.estimator if is_near else ORDINARY)])
    return FittedModel(source, fit)


def chi2_of_following(state: State) -> float:
    """Chi-square of the recording beside the winner, after its parameters have followed."""
    residual = state.model.residual
    return misfit_of(residual, state.setting.grid).chi2 - following(residual)[1]


def is_far_from_linear(estimate: Foreseen, winner: Rival, remaining: float) -> bool:
    """Whether first order leaves more beside a rival than there is without any cause: the step that it takes is wrong,
    as from a stiffness of small strains to one of finite strains.

    remaining : chi-square of the recording beside the winner, after its parameters have followed
    """
    return estimate.chi2 > remaining + COPIES * winner.achieved


def is_behind(estimate: Foreseen, rival: Rival, winner: Rival, remaining: float) -> bool:
    """Whether a rival is behind the winner by more than noise and an error of first order.

    remaining : chi-square of the recording beside the winner, after its parameters have followed
    """
    gap = estimate.chi2 - remaining + 2.0 * (len(rival.own_unknowns) - len(winner.own_unknowns))
    return gap > noise_of_evidence(winner) + FIRST_ORDER_ERROR_SHARE * estimate.gain


def foreseen(cause: JoinedCause, model: FittedModel, rival: Rival) -> Foreseen | None:
    """A rival beside its own error, from the end of its fit without it; None where it finds no equilibrium.

    model : of the rival, with the error of the winner
    """
    error, former = cause.state.model.error, cause.joined.error
    if error is not None:
        error = error_of_rival(model, error, former)
        model = replace(model, source=model.source.with_motion_error(error))
    simulation = model.simulated()
    if simulation is None:
        return None
    moved, gain = following(simulation.residual)
    chi2 = misfit_of(simulation.residual, cause.state.setting.grid).chi2 - gain
    return Foreseen(simulation.source, shortened(simulation.residual.context.parameters, moved), chi2, gain)


def near_rivals(entry: Round) -> list[Rival]:
    """Rivals of a round whose evidence comes near that of its winner, the nearest first."""
    winner = entry.winner
    if winner is None:
        return []
    close_rivals = [r for r in entry.rivals if r.ranked.key != winner.ranked.key and r.passes
                    and r.copies == winner.copies == 1 and winner.name not in r.ranked.candidate.limits
                    and winner.evidence - r.evidence < max(NEAR_SHARE * winner.evidence, NEAR_CHI2)]
    return sorted(close_rivals, key=lambda r: -r.evidence)[:MAX_RIVALS]


def refitted_again(rival: Rival, refitted: Fit) -> Rival | None:
    """A rival with a later fit of the same cause; None where a copy is missing."""
    former = rival.refitted
    if None in (former.choice, former.judgement, refitted.choice, refitted.judgement):
        return None
    return replace(rival, refitted=refitted,
                   heldout=rival.heldout + former.judgement.chi2 - refitted.judgement.chi2,
                   achieved=rival.achieved + former.choice.chi2 - refitted.choice.chi2)


def error_of_rival(model: FittedModel, winner_error: MotionError, former: MotionError | None) -> MotionError:
    """The error of a rival's own simulation, of the kind that is known of the winner; that of the winner where it
    cannot be computed. As of the winner, that of the mesh stays where bricks have just joined it.

    former : error of both before
    """
    identified = model.identification()
    if winner_error.thickness is not None and (former is None or former.thickness is None):
        return (thickness_error(identified.model_point) or winner_error.thickness).on_top_of(winner_error.of_mesh)
    return known_error(identified, winner_error) or winner_error


RIVALS_AGAIN = Move("rivals again", "refits_s", changed_cause, with_rivals_again,
                    lambda cause: bool(cause.joined.close_rivals), stage=lambda cause:
                    "rivals of the cause compared again, as the model has changed beside it")
