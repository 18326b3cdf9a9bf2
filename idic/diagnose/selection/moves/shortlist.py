"""The shortlist of a round: its refits, the judgement of the rivals, and further starts of the winner."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from idic.diagnose.residual.excess_left import effect
from idic.diagnose.residual.measured_motion import MAX_REGISTER_PX, holds_motion
from idic.diagnose.selection.move import Move
from idic.diagnose.selection.rival import MIN_HELDOUT_DROP, Rival, causes_of, judge
from idic.diagnose.selection.rivals import refitted, refitted_from_other_starts
from idic.diagnose.selection.state import State
from idic.identification import Identification

YIELD_STATES = ("plastic_strain",)


def with_refits(state: State) -> State:
    """The round with its rivals refitted, and the winner among them."""
    setting, model, screening = state.setting, state.model, state.round.screening
    unit = state.power_of_copy if holds_motion(state.identification.experiment) else np.inf
    is_off = effect(model.fit.judgement, unit) > MAX_REGISTER_PX
    bends = not causes_of(state.rounds) and has_state(state.identification, YIELD_STATES)
    rivals = refitted(model.source, model.fit, screening, state.refits, setting.grid, setting.seed, bends=bends,
                      is_alone=setting.quick, is_far=is_off)
    return judged(replace(state, round=replace(state.round, rivals=rivals)))


def judged(state: State) -> State:
    """The round with the winner of its rivals, and those that cannot be told from it."""
    winner, equals = judge(state.round.rivals, state.round.screening)
    return replace(state, round=replace(state.round, winner=winner, equals=equals))


def from_other_starts(state: State) -> State | None:
    """The winner from its other starts: a stiffness that depends on direction has several minima over the angle of its
    axis, and one that ends with half of what its score promised may be the wrong one."""
    rival = refitted_from_other_starts(state.model.source, state.model.fit, state.winner,
                                       state.round.screening, state.refits,
                                       state.setting.grid, state.setting.seed)
    return None if rival is None else with_winner(state, rival)


def ends_lower(state: State, tried: State) -> bool:
    """Whether the winner of the tried state explains more where it was fitted, by more than noise."""
    return tried.winner.achieved > state.winner.achieved + MIN_HELDOUT_DROP


def with_winner(state: State, rival: Rival) -> State:
    """A round whose winner has another form, not judged among its rivals yet."""
    rivals = tuple(rival if entry is state.winner else entry for entry in state.round.rivals)
    return replace(state, round=replace(state.round, rivals=rivals, winner=rival))


def has_winner(state: State) -> bool:
    """Whether the round has one whose form may be improved; not in a quick diagnosis."""
    return state.winner is not None and not state.setting.quick


def has_state(identification: Identification, states: Collection[str]) -> bool:
    """Whether a law of the identified model has one of these states."""
    laws = (section.law.spec for section in identification.forward.model.sections)
    return any(state in law.state_names for law in laws for state in states)


def is_under_way(state: State) -> bool:
    """Whether a round is."""
    return state.round is not None


SHORTLIST = Move("refits of the shortlist", "refits_s", applies=is_under_way, edit=with_refits)
OTHER_STARTS = Move("other starts", "refits_s", applies=has_winner, edit=from_other_starts, accept=ends_lower)
JUDGED = Move("judgement of the rivals", "refits_s", applies=is_under_way, edit=judged)
