"""A move: one change that a diagnosis tries on its state, a row of the table that is its selection.

    subject   what the move works on: the state itself, a round under way, a selected cause; None where there is none
    applies   whether the move has anything to try on it
    edit      the state with the changed model: what is fitted, and the fits; None where one of them fails
    accept    whether the recording prefers it; a model that finds no equilibrium from rest is not taken

What a move fits next may depend on what it has fitted before (a scale is bracketed, the shortlist is refitted in waves,
a set of causes is built up again one by one). So `edit` runs its fits itself, and its answer is a whole state: the loop
takes it or leaves it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from idic.diagnose.selection.state import State

Subject = TypeVar("Subject")


def itself(state: State) -> State:
    """Subject of a move that works on the whole state."""
    return state


def always(subject: Any) -> bool:
    """Applies of a move that tries something wherever it has a subject."""
    return True


def decided(subject: Any, tried: State) -> bool:
    """Accept of a move whose edit has decided all there is to decide."""
    return True


def silently(subject: Any) -> str:
    """Stage of a move that is not announced."""
    return ""


@dataclass(frozen=True)
class Move(Generic[Subject]):
    """One row.

    name : in one or two words; step : of the costs in diagnosis.json; subject, edit, applies, accept : see the module
    stage : what is announced before the edit, "" for nothing
    part : what a note calls the move where it fails; without it a failure ends the diagnosis
    """

    name: str
    step: str
    subject: Callable[[State], Subject | None]
    edit: Callable[[Subject], State | None]
    applies: Callable[[Subject], bool] = always
    accept: Callable[[Subject, State], bool] = decided
    stage: Callable[[Subject], str] = silently
    part: str = ""


def moved(state: State, moves: Iterable[Move]) -> State:
    """The state after every move of a table that applies and is accepted, in the order of the table."""
    for move in moves:
        if move.part:
            state = state.setting.notes.attempt(move.part, _after, state, move, otherwise=state)
        else:
            state = _after(state, move)
    return state


def _after(state: State, move: Move[Subject]) -> State:
    subject = move.subject(state)
    if subject is None or not move.applies(subject):
        return state
    if text := move.stage(subject):
        state.setting.stage(text)
    with state.setting.clock.step(move.step):
        tried = move.edit(subject)
        if tried is None or not move.accept(subject, tried):
            return state
        return tried if tried.model is state.model else tried.simulated() or state
