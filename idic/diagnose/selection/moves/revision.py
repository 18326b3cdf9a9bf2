"""Selection goes both ways: every selected cause is tested again for removal and for exchange once others have joined
it.

The first cause is chosen while nothing else is in the model. What comes after may make it idle, or show that one of its
rivals fits the whole better. A revised set keeps the causes before the one in question, leaves that one out or puts a
rival in its place, and adds the later causes again; the whole is refitted and judged on the copy that had no part in
it.

    removal    accepted where the whole loses less than a further cause would have to bring
    exchange   accepted where the whole gains more than two models differ by noise; with the former course in place of
               one that the data give, where the whole loses less than that course had to bring
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from idic.diagnose.refits.fitted_model import FittedModel
from idic.diagnose.refits.refit import Fit
from idic.diagnose.refits.refit_job import refit_of_one
from idic.diagnose.residual.channel_left import explains_a_channel
from idic.diagnose.residual.heldout import Misfit
from idic.diagnose.screen.select import MIN_SEPARATION_CHI2, Ranked, Screening
from idic.diagnose.selection.move import Move, moved
from idic.diagnose.selection.moves.few_jumps import FEW_JUMPS
from idic.diagnose.selection.moves.own_course import OWN_COURSE, has_own_course
from idic.diagnose.selection.moves.own_scale import OWN_SCALE
from idic.diagnose.selection.rival import (
    MIN_DROP_DIFFERENCE, MIN_FURTHER_SHARE, MIN_HELDOUT_DROP, MIN_SHARE_BEYOND, Rival, Round, causes_of, judge,
    winners, with_winners,
)
from idic.diagnose.selection.rivals import edits_of, refit_of_candidate
from idic.diagnose.selection.state import Clock, Selected, State, changed_cause, last_cause, leading
from idic.model import jump_frame

MAX_EXCHANGES = 2  # rivals that are tried in the place of one cause
MIN_EXCHANGE_SHARE = 0.3  # of the winner's drop of chi-square: a rival that may overtake it in the company of others


def min_further_drop(rival: Rival, whole_drop: float) -> float:
    """Held-out drop of chi-square that makes a cause one of several; whole_drop : of all causes together.

    A drop below a share of what all explain is a flaw of their description: a course or a mesh that differs a little.
    """
    return max(MIN_HELDOUT_DROP + len(rival.ranked.variant.new), MIN_FURTHER_SHARE * whole_drop)


def earns_its_place(rival: Rival, first: Misfit, without: Misfit, together: Misfit) -> bool:
    """Whether a cause is one of several.

    first, without, together : models without any cause, and without and with this one, held out

    A channel has one reading per frame, where the images have thousands of motions: next to an inclusion friction of
    0.5 % of the largest force brings a hundredth of the whole, and is all that is wrong with the force. So a cause that
    acts on a channel, without a free course that would follow anything, needs no share of the whole where it explains
    what the verdict would call unexplained.
    """
    drop, variant = without.chi2 - together.chi2, rival.ranked.variant
    if drop >= min_further_drop(rival, first.chi2 - together.chi2):
        return True
    return (rival.ranked.candidate.side == "force" and not variant.free_course
            and drop >= MIN_HELDOUT_DROP + len(variant.new)
            and explains_a_channel(first.channels, without.channels, together.channels))


def earning_alone(selected: Selected) -> State | None:
    """The round with a winner among the rivals that earn a place beside the causes before; None where its winner does.

    One of a size that no such cause has is a formal fit of what the causes before it leave, and would make a formal fit
    of them, too: a woven laminate whose fibres stiffen had a load cell beside it that is 11 % off. The winner that is
    passed over is kept for the record.
    """
    state, entry, null = selected.state, selected.round, selected.state.model.fit.judgement
    first = causes_of(state.rounds)[0].null.judgement
    earning = [rival for rival in entry.rivals if rival.passes and rival.share_beyond >= MIN_SHARE_BEYOND
               and earns_its_place(rival, first, null, rival.refitted.judgement)]
    if selected.winner in earning:
        return None
    winner, equals = judge(earning, entry.screening)
    return replace(state, round=replace(entry, winner=winner, equals=equals, plain=None,
                                        passed_over=selected.winner))


def with_revised_rounds(cause: Selected) -> State:
    """The state after removals and exchanges, and the model of the revised set."""
    state, rounds = cause.state, revised(cause.state)
    if winners(rounds) == winners(state.rounds):
        return state
    revision = replace(state, rounds=tuple(rounds), model=model_of(*with_winners(rounds)[-1]))
    residual = (revision.simulated() or state).model.residual
    return replace(revision, model=replace(revision.model, residual=residual))


def model_of(entry: Round, winner: Rival) -> FittedModel:
    """The model that the winner of a round has joined."""
    return FittedModel(entry.source.with_edits(edits_of(winner, entry.screening)), winner.refitted)


def revised(state: State) -> list[Round]:
    """The rounds after removals and exchanges; as they are where every cause earns its place."""
    rounds = list(state.rounds)
    for _ in range(len(rounds)):
        better = _better(state, rounds)
        if better is None:
            break
        rounds = better
    return rounds


def _better(state: State, rounds: list[Round]) -> list[Round] | None:
    """The first removal or exchange that is accepted, of all causes but the last, which has just earned its place."""
    won = with_winners(rounds)
    last_fit = won[-1][1].refitted
    first = rounds[0].null.judgement
    whole_drop = first.chi2 - last_fit.judgement.chi2
    for number, (entry, winner) in enumerate(won[:-1]):
        allowed = min_further_drop(winner, whole_drop)
        if not is_needed(winner.ranked, last_fit, allowed):
            without = _rebuilt(state, rounds, number, None)
            if without is not None and not earns_its_place(winner, first, _judged(without), last_fit.judgement):
                return without
        gap = max(MIN_SEPARATION_CHI2, MIN_DROP_DIFFERENCE * whole_drop)
        for rival in exchangeable(entry):
            exchanged = _rebuilt(state, rounds, number, rival)
            fewer = len(winner.ranked.variant.new) - len(rival.ranked.variant.new)
            least = -(MIN_HELDOUT_DROP + fewer) if rival is entry.plain else gap
            if (exchanged is not None and last_fit.judgement.chi2 - _judged(exchanged).chi2 > least
                    and all(member.is_practical for member in winners(exchanged))):
                return exchanged
    return None


def is_needed(ranked: Ranked, last_fit: Fit, allowed: float) -> bool:
    """Whether a parameter of a cause stands so far from its null in the whole that no refit without it need be made."""
    variant = ranked.variant
    for name in variant.new:
        std, null = last_fit.stds.get(name), variant.null.get(name, 0.0)
        if std and np.isfinite(null) and ((last_fit.values[name] - null) / std) ** 2 > 2.0 * allowed:
            return True
    return False


def exchangeable(entry: Round) -> list[Rival]:
    """The winner of a round with the course it was screened with, then rivals that come near it, or cannot be told from
    it, the best first.
    """
    winner = entry.winner
    if winner is None:
        return []
    close_rivals = [r for r in entry.rivals if r is not winner and r.refitted.usable and r.determined
                    and (r.name in entry.equals or r.achieved > MIN_EXCHANGE_SHARE * winner.achieved)]
    plain = [] if entry.plain is None else [entry.plain]
    return plain + sorted(close_rivals, key=lambda r: -r.achieved)[:MAX_EXCHANGES]


def _judged(rounds: Sequence[Round]) -> Misfit:
    return winners(rounds)[-1].refitted.judgement


def _rebuilt(state: State, rounds: Sequence[Round], number: int, instead: Rival | None) -> list[Round] | None:
    """The rounds with another cause, or none, in one place; None where a refit fails or a later cause does not
    apply."""
    revised_rounds, entry = list(rounds[:number]), rounds[number]
    model = FittedModel(entry.source, entry.null)
    values: Mapping[str, float] = winners(rounds)[-1].refitted.values
    names: tuple[str, ...] = ()
    if instead is not None:
        equals = entry.equals if instead is entry.plain else ()  # the same cause with its former course
        revised_rounds.append(replace(entry, winner=instead, equals=equals, crossed_judgement=None, plain=None))
        model, names = model_of(revised_rounds[-1], instead), instead.ranked.variant.new
    for later_round, later in with_winners(rounds[number + 1:]):
        is_first = instead is None and model.fit is entry.null
        screening = entry.screening if is_first else state.setting.screen(model, [later.ranked.candidate])
        starts = _starts({**later.refitted.values, **values}, names)
        rival = _added(state, model, later, screening, starts)
        if rival is None:
            return None
        members = entry.rivals if is_first else ()
        revised_rounds.append(Round(screening, model.fit,
                                    (rival, *(member for member in members if member.ranked.key != rival.ranked.key)),
                                    rival, later_round.equals, source=model.source))
        model = model_of(revised_rounds[-1], rival)
    return revised_rounds


def _added(state: State, model: FittedModel, winner: Rival, screening: Screening,
           starts: Mapping[str, float]) -> Rival | None:
    """The cause of a later round refitted on top of a model, in the form that it had; None where it does not apply, or
    its refit fails.

    starts : values of parameters where the refit begins
    """
    setting = state.setting
    ranked = next((r for r in screening.ranked if r.key == winner.ranked.key
                   and np.isfinite(r.std)), None)
    if ranked is None:
        return None
    rival = refit_of_candidate(model.source, model.fit, ranked, screening, setting.refits, setting.grid, setting.seed,
                               starts)
    if not rival.refitted.usable:
        return None
    jumps = any(jump_frame(name) is not None for name in winner.ranked.variant.new)
    forms = [OWN_SCALE, *([OWN_COURSE] if has_own_course(winner) else []),
             *([FEW_JUMPS] if jumps else [])]
    entry = Round(screening, model.fit, (rival,), rival, source=model.source)
    setting = replace(setting, clock=Clock())  # the time is that of the revision
    return moved(replace(state, setting=setting, model=model, round=entry, announced=None), forms).winner


def _starts(values: Mapping[str, float], excluded: Sequence[str]) -> dict[str, float]:
    """Values of parameters as a start of a revised set, but those of the cause that joins it instead.

    excluded : its parameters. Two courses of one cause may share a name: an expansion per kelvin is found where the
    warmth goes with time, and stated where the temperature of every frame is found.
    """
    return {name: value for name, value in values.items() if name not in excluded}


def without_last_cause(cause: Selected) -> State | None:
    """The model before the last cause fitted with the errors that have joined since; None where the fit fails."""
    state, setting, entry = cause.state, cause.state.setting, cause.round
    (fit,) = setting.refits([refit_of_one(entry.source, "null", entry.null, setting.grid,
                                          setting.seed)])
    return replace(state, rounds=state.rounds[:-1],
                   model=FittedModel(entry.source, fit)) if fit.usable else None


def earns_nothing(cause: Selected, tried: State) -> bool:
    """Whether the last cause brings less, beside the errors that have joined since, than a further one must."""
    rounds = cause.state.rounds
    first = next(iter(causes_of(rounds)), rounds[0])
    return not earns_its_place(cause.winner, first.null.judgement,
                               tried.model.fit.judgement, cause.state.model.fit.judgement)


def has_others(selected: Selected) -> bool:
    """Whether a cause was selected before, finite strains aside."""
    return bool(causes_of(selected.state.rounds))


def is_one_of_several(cause: Selected) -> bool:
    """Whether rounds before the last one have ended."""
    return len(cause.state.rounds) > 1


FURTHER_CAUSE = Move("place of a further cause", "refits_s", leading, earning_alone, has_others)
REVISION = Move("removal and exchange", "revision_s", last_cause, with_revised_rounds, is_one_of_several,
                stage=lambda cause: "every selected cause tested for removal and exchange")
LAST_CAUSE = Move("removal of the last cause", "revision_s", changed_cause, without_last_cause, is_one_of_several,
                  earns_nothing, stage=lambda cause: "the last cause tested anew, as the model has changed beside it")
