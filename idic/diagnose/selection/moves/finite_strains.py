"""Finite strains of a model that a cause has joined: counted where the recording asks for them.

Every body has them; a law of small strains is a choice of the file. While a cause is unknown it hides what they do: the
reading of a rubbing load train falls behind when the load turns round, ten times as far as finite strains lower it.
Then the cause explains a part of them (a friction that grows more slowly than the load), and the rest is left as motion
without a name. They bring no unknown, so that the drop of chi-square decides, as of bricks
(`idic.diagnose.discretisation.thickness_error`). A course that was freed for their sake goes back to the former one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from idic.diagnose.discretisation.combinations import FINITE_STRAINS as OF_STRAINS, combinations, drop_by
from idic.diagnose.discretisation.thickness_error import MIN_DROP
from idic.diagnose.refits.fitted_model import FittedModel
from idic.diagnose.refits.refit_job import refit_of_one
from idic.diagnose.residual.residual_evidence import ResidualEvidence
from idic.diagnose.residual.score import null_model
from idic.diagnose.selection.move import Move
from idic.diagnose.selection.moves.rivals_again import refitted_again
from idic.diagnose.selection.rival import MIN_HELDOUT_DROP, Rival, Round, judge
from idic.diagnose.selection.rivals import edits_of, finite
from idic.diagnose.selection.state import JoinedCause, State, joined_cause
from idic.identification import Identification
from idic.simulation_error import strain_error


def are_asked_for(cause: JoinedCause) -> bool:
    """Whether the recording asks for finite strains beside the last cause: a course that was freed may hide them."""
    entry = cause.round
    winner = _fitted(entry, cause.winner).identification()
    return is_asked_for(winner, cause.state.model.residual) or (
        entry.plain is not None and _asks(entry, entry.plain))


def with_finite_strains(cause: JoinedCause) -> State | None:
    """The finite form of every law of small strains: its cause, the former course of that, and the rivals that cannot
    be told from it are fitted again; None where the cause finds no equilibrium or passes no more."""
    state, entry = cause.state, cause.round
    materials = _fitted(entry, cause.winner).source.load().model.materials
    models = [rival for rival in (cause.winner, entry.plain) if rival is not None]
    edits = {f"material.{material.element_set}.kinematics": "finite" for material in materials}
    rounds = [replace(former, source=former.source.with_edits(edits)) for former in state.rounds]
    tried = [_again(state, rounds[-1], finite(rival, entry.screening)) for rival in models]
    if not tried[0].refitted.usable:
        return None
    best = plain_if_enough(tried)
    finite_rivals = {rival: _again(state, rounds[-1], finite(rival, entry.screening))
                     for rival in entry.rivals if rival.name in entry.equals and rival.refitted.usable}
    chosen, equals = judge([best, *finite_rivals.values()], entry.screening)
    if chosen is None:
        return None
    finite_rivals |= {cause.winner: best}
    plain = next((rival for rival in tried[1:] if chosen is tried[0] and rival.refitted.usable), None)
    counted = replace(rounds[-1], winner=chosen, equals=equals, plain=plain,
                      rivals=tuple(finite_rivals.get(rival, rival) for rival in entry.rivals))
    joined = replace(cause.joined, is_finite=True)
    return replace(state, rounds=(*rounds[:-1], counted), model=_fitted(counted, chosen), joined=joined)


def explains_more(cause: JoinedCause, tried: State) -> bool:
    """Whether the model explains more of the copy for judging: finite strains bring no unknown."""
    return tried.model.fit.judgement.chi2 < cause.state.model.fit.judgement.chi2


def _fitted(entry: Round, rival: Rival) -> FittedModel:
    """A rival of a round, after its refit."""
    return FittedModel(entry.source.with_edits(edits_of(rival, entry.screening)), rival.refitted)


def _asks(entry: Round, rival: Rival) -> bool:
    """Whether the recording asks for finite strains beside a rival of a round."""
    model = _fitted(entry, rival).simulated()
    return model is not None and is_asked_for(model.identification(), model.residual)


def is_asked_for(identification: Identification, residual: ResidualEvidence) -> bool:
    """Whether finite strains lower the chi-square of the recording by five standard deviations, to first order.

    identification, residual : of the model; False where it has them already, or none can be simulated
    """
    error = strain_error(identification.model_point)
    if error is None:
        return False
    tried = combinations(residual, null_model(residual.evidence, residual.null), {OF_STRAINS: error})
    return drop_by(tried, OF_STRAINS) >= MIN_DROP


def plain_if_enough(tried: Sequence[Rival]) -> Rival:
    """Of a winner and its former course, if any: the former one where the freed one does not bring what each of its
    knots must."""
    winner, former = tried[0], tried[1:]
    for plain in former:
        if not plain.refitted.usable:
            continue
        knots = len(winner.own_unknowns) - len(plain.own_unknowns)
        gain = plain.refitted.judgement.chi2 - winner.refitted.judgement.chi2
        if gain <= MIN_HELDOUT_DROP + knots:
            return plain
    return winner


def _again(state: State, entry: Round, rival: Rival) -> Rival:
    """A rival of a round fitted again with the present source of the round."""
    source, fit = _fitted(entry, rival).source, rival.refitted
    (refit,) = state.setting.refits([refit_of_one(source, "finite", fit, state.setting.grid, state.setting.seed)])
    refit = replace(refit, name=fit.name, label=fit.label)
    return refitted_again(rival, refit) or replace(rival, refitted=refit)


FINITE_STRAINS = Move("finite strains", "mesh_s", joined_cause, with_finite_strains, are_asked_for, explains_more)
