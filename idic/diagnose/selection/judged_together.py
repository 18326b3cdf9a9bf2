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

from idic.diagnose.refits.refit import Refit
from idic.diagnose.refits.refit_job import ExperimentSource
from idic.diagnose.residual.residual_evidence import ResidualEvidence
from idic.diagnose.selection.block_step import BlockJudgement, holds
from idic.diagnose.selection.own_course import leaves_something
from idic.diagnose.selection.rival import Round


@dataclass(frozen=True, eq=False)
class Last:
    """The last model: its source, its fit, and its residual on the recording."""

    source: ExperimentSource
    null: Refit
    whole: ResidualEvidence


@dataclass(frozen=True, eq=False)
class Doubted:
    """A round whose winner awaits others; before, model : the rounds before it, and the model that it joins."""

    one: Round
    before: tuple[Round, ...]
    model: Last


def judged_alone(one: Round, judged: Sequence[BlockJudgement], formal: bool = False) -> Round:
    """A round after the judgement of blocks on its winner: with it, waiting for others, or without it.

    formal : the winner describes a flaw of a cause before it, and is none itself
    """
    if not formal and holds(judged):
        return replace(one, blocks=tuple(judged))
    if not formal and leaves_something(one.winner.refitted.judgement):  # type: ignore[union-attr, arg-type]
        return replace(one, blocks=tuple(judged), awaits_others=True)
    return without_winner(one, judged)


def judged_together(rounds: Sequence[Round], last: Last, doubted: Doubted,
                    judged: Sequence[BlockJudgement]) -> tuple[list[Round], Last]:
    """The rounds and the last model, where blocks confirm all causes from the doubted one on; else what was there
    before it, and its round without a winner.

    judged : the model that the doubted cause joins, and the last one
    """
    if holds(judged):
        return [replace(one, blocks=tuple(judged)) if one.awaits_others else one for one in rounds], last
    return [*doubted.before, without_winner(doubted.one, judged)], doubted.model


def without_winner(one: Round, judged: Sequence[BlockJudgement]) -> Round:
    """A round whose winner blocks do not confirm."""
    return replace(one, winner=None, equals=(), passed_over=one.winner, blocks=tuple(judged))
