"""Causes that blocks of the recording judge together, where they do not confirm one of them alone.

A part of the recording foretells the rest if the model is right but for its parameters. While a second cause is not in
it, the parameters that fit early frames, or the black squares, take up a part of that cause, and foretell the rest
worse with the first cause than without it: a seating beside friction (chi-square of later frames rises by 8280, of all
blocks by 5100), a slip beside a hole of another size (by 390 in the squares). So a cause that leaves more than noise
stays while further ones are looked for, and the set is judged as a whole.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from idic.diagnose.residual.measured_motion import holds_motion
from idic.diagnose.screen.local_residual import local_residual_tests
from idic.diagnose.selection.block_step import BlockJudgement, holds, judged_by_step
from idic.diagnose.selection.move import Move
from idic.diagnose.selection.moves.revision import model_of
from idic.diagnose.selection.rival import Round, causes_of, leaves_something
from idic.diagnose.selection.state import Doubted, OpenRound, Selected, State, improvable, open_round


def judged_alone(entry: Round, judged: Sequence[BlockJudgement], formal: bool = False) -> Round:
    """A round after the judgement of blocks on its winner: with it, waiting for others, or without it.

    formal : the winner describes a flaw of a cause before it, and is none itself
    """
    if not formal and holds(judged):
        return replace(entry, blocks=tuple(judged))
    if not formal and entry.winner is not None and leaves_something(entry.winner.refitted.judgement):
        return replace(entry, blocks=tuple(judged), awaits_others=True)
    return without_winner(entry, judged)


def judged_together(state: State, judged: Sequence[BlockJudgement]) -> State:
    """The state where blocks confirm all causes from the doubted one on; else what was there before it, and its round
    without a winner.

    judged : the model that the doubted cause joins, and the last one
    """
    doubted = state.doubted
    if doubted is None or holds(judged):
        rounds = [replace(entry, blocks=tuple(judged)) if entry.awaits_others else entry for entry in state.rounds]
        return replace(state, rounds=tuple(rounds))
    return replace(state, rounds=(*doubted.rounds, without_winner(doubted.round, judged)),
                   model=doubted.model)


def without_winner(entry: Round, judged: Sequence[BlockJudgement]) -> Round:
    """A round whose winner blocks do not confirm."""
    return replace(entry, winner=None, equals=(), passed_over=entry.winner, blocks=tuple(judged))


def on_blocks(selected: Selected) -> State:
    """The round after the judgement of blocks of the recording, which had no part in the fit of its winner; the model
    has the residual of a winner that stays.

    On a measured motion, an inclusion beside another cause that leaves motion at its own place describes a flaw of that
    cause and is none itself. Blocks measure motions and readings: of a cause that acts on grey values they say nothing.
    """
    state, entry, winner = selected.state, selected.round, selected.winner
    setting, model = state.setting, state.model
    joined = model_of(entry, winner).simulated()
    if joined is None:
        return replace(state, round=replace(entry, winner=None, equals=(), passed_over=winner))
    residual = joined.residual
    of_grey_values = winner.ranked.variant.pixels is not None
    judged = () if of_grey_values else judged_by_step(model.residual, residual, setting.grid)
    is_formal = bool(causes_of(state.rounds)) and holds_motion(residual.context.experiment.recording) and any(
        excess.matters for excess in local_residual_tests(model.residual, residual, setting.grid,
                                                          winner.refitted.values, setting.margin))
    entry = judged_alone(entry, judged, is_formal)
    if entry.winner is None:
        return replace(state, round=entry)
    doubted = state.doubted
    if doubted is None and entry.awaits_others:
        doubted = Doubted(selected.round, state.rounds, model)
    return replace(state, round=entry, model=replace(model, residual=residual), doubted=doubted)


def ended(under_way: OpenRound) -> State:
    """The round ends: its winner joins the model, or there is none."""
    state, entry = under_way.state, under_way.round
    model = state.model if entry.winner is None else replace(
        model_of(entry, entry.winner), residual=state.model.residual)
    return replace(state, rounds=(*state.rounds, entry), round=None, announced=None, model=model)


@dataclass(frozen=True, eq=False)
class Doubt:
    """A state whose causes from a doubted one on await their judgement."""

    state: State
    doubted: Doubted


def doubt(state: State) -> Doubt | None:
    """The doubt about the causes of a state."""
    return None if state.doubted is None else Doubt(state, state.doubted)


def confirmed_together(doubt: Doubt) -> State:
    """All causes from the doubted one on, judged by blocks of the recording."""
    state = doubt.state
    return judged_together(state, judged_by_step(doubt.doubted.model.residual,
                                                 state.model.residual, state.setting.grid))


ON_BLOCKS = Move("blocks of the recording", "blocks_s", improvable, on_blocks,
                 stage=lambda selected: "judgement on parts of the recording")
END_OF_ROUND = Move("end of the round", "refits_s", open_round, ended)
TOGETHER = Move("causes together", "blocks_s", doubt, confirmed_together,
                stage=lambda doubt: "judgement of all causes on parts of the recording")
