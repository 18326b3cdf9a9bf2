"""The shortlist of a round: its refits, the judgement of the rivals, and further starts of the winner."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from idic.diagnose.residual.excess_left import effect
from idic.diagnose.residual.measured_motion import MAX_REGISTER_PX, holds_motion
from idic.diagnose.selection.move import Move
from idic.diagnose.selection.rival import (
    MIN_HELDOUT_DROP, Rival, Round, causes_of, judge, lead_of, noise_of_evidence,
)
from idic.diagnose.selection.rivals import refitted, refitted_from_other_starts
from idic.diagnose.selection.state import OpenRound, Selected, State, leading, open_round
from idic.identification import Identification

YIELD_STATES = ("plastic_strain",)


def with_refits(under_way: OpenRound) -> State:
    """The round with its rivals refitted, and the winner among them."""
    state, entry = under_way.state, under_way.round
    setting, model = state.setting, state.model
    unit = state.power_of_copy if holds_motion(state.identification.experiment.recording) else np.inf
    is_off = effect(model.fit.judgement, unit) > MAX_REGISTER_PX
    bends = not causes_of(state.rounds) and has_state(state.identification, YIELD_STATES)
    rivals = refitted(model.source, model.fit, entry.screening, state.refits, setting.grid, setting.seed, bends=bends,
                      is_alone=setting.quick, is_far=is_off)
    return judged(state, replace(entry, rivals=rivals))


def judged(state: State, entry: Round) -> State:
    """The state with a round under way that has the winner of its rivals, and those that cannot be told from it."""
    winner, equals = judge(entry.rivals, entry.screening)
    return replace(state, round=replace(entry, winner=winner, equals=equals))


def judged_again(under_way: OpenRound) -> State:
    """The round judged as its rivals are now."""
    return judged(under_way.state, under_way.round)


def has_other_starts(selected: Selected) -> bool:
    """Whether the winner is fitted from other starts: a place always, a law not in a quick diagnosis."""
    return not selected.state.setting.quick or is_place(selected.winner)


def from_other_starts(selected: Selected) -> State | None:
    """The winner from its other starts: a stiffness that depends on direction has several minima over the angle of its
    axis, an inclusion one for a stiff and one for a soft place."""
    state = selected.state
    rival = refitted_from_other_starts(state.model.source, state.model.fit, selected.winner,
                                       selected.round.screening, state.refits,
                                       state.setting.grid, state.setting.seed)
    if rival is None:
        return None
    former = selected.winner
    is_lower = former.copies == 1 and rival.achieved > former.achieved + MIN_HELDOUT_DROP
    winner, alternative = (rival, former) if is_lower else (former, rival)
    if (are_opposite(winner, alternative) and alternative.determined
            and lead_of(winner, alternative) < noise_of_evidence(winner)):
        return with_winner(selected, replace(winner, rival_place=alternative))
    return with_winner(selected, winner) if is_lower else None


def are_opposite(first: Rival, second: Rival) -> bool:
    """Whether of two refits of a place one ended softer and one stiffer; both may have come to the same place."""
    variant = first.ranked.variant
    return is_place(first) and any((first.refitted.values[name] - variant.null[name])
                                   * (second.refitted.values[name] - variant.null[name]) < 0.0 for name in variant.new)


def is_place(rival: Rival) -> bool:
    """Whether a candidate has a place on the body."""
    return rival.ranked.variant.place is not None


def with_winner(selected: Selected, rival: Rival) -> State:
    """The state with another form of the winner of its round, not judged among its rivals yet."""
    entry = selected.round
    rivals = tuple(rival if former is selected.winner else former for former in entry.rivals)
    return replace(selected.state, round=replace(entry, rivals=rivals, winner=rival))


def has_state(identification: Identification, states: Collection[str]) -> bool:
    """Whether a law of the identified model has one of these states."""
    laws = (section.law.spec for section in identification.forward.body.sections)
    return any(state in law.state_names for law in laws for state in states)


SHORTLIST = Move("refits of the shortlist", "refits_s", open_round, with_refits)
OTHER_STARTS = Move("other starts", "refits_s", leading, from_other_starts, has_other_starts)
JUDGED = Move("judgement of the rivals", "refits_s", open_round, judged_again)
