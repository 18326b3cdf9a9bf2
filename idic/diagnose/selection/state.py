"""The state of a diagnosis between two moves, and what all of its steps share."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace

from idic.diagnose.locate.mismatch import Mismatch
from idic.diagnose.physics.candidate import Candidate
from idic.diagnose.refits.fitted_model import FittedModel
from idic.diagnose.refits.refit import Fit
from idic.diagnose.refits.refit_job import Refits, AnnouncedRefits
from idic.diagnose.residual.evidence import Columns
from idic.diagnose.residual.excess import power
from idic.diagnose.residual.margin import ASSUMED, Margin
from idic.diagnose.residual.residual_evidence import ResidualEvidence
from idic.diagnose.residual.subspace import Grid
from idic.diagnose.residual.thinning import COPY_VARIANCE_FACTOR
from idic.diagnose.screen.score_columns import ScoreColumn
from idic.diagnose.screen.select import Screening
from idic.diagnose.selection.free_model import FreeEnd
from idic.diagnose.selection.notes import Notes
from idic.diagnose.selection.rival import Rival, Round
from idic.identification import Identification
from idic.model import MotionError

MAX_ROUNDS = 3
Stage = Callable[[str], None]
Watch = Callable[[ResidualEvidence, Sequence[ScoreColumn], Columns], None]
Screen = Callable[[FittedModel, Sequence[Candidate]], Screening]  # scores some candidates beside a selected cause


def silent(text: str) -> None:
    """A stage that reports nothing."""


def unwatched(residual: ResidualEvidence, tested: Sequence[ScoreColumn], columns: Columns) -> None:
    """A watch that looks at nothing."""


@dataclass
class Clock:
    """Seconds spent on every step."""

    seconds: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def step(self, name: str):
        """Add the time spent inside to a step."""
        began = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - began


@dataclass(frozen=True, eq=False)
class Setting:
    """What all steps of one diagnosis share.

    refits : runs refit jobs; screen : scores candidates again in a revised set; grid : of the free motions that measure
    a residual; seed : of the noise that makes two copies of the recording; library : candidates that are tested;
    stage : called with the name of a step that begins; watch, margin, quick : see `diagnose`; notes : what has failed
    beside the verdict
    """

    refits: Refits
    screen: Screen
    grid: Grid
    seed: int
    library: Sequence[Candidate] = ()
    stage: Stage = silent
    clock: Clock = field(default_factory=Clock)
    watch: Watch = unwatched
    margin: Margin = ASSUMED
    quick: bool = False
    notes: Notes = field(default_factory=Notes)

    @property
    def max_rounds(self) -> int:
        """Screenings at most."""
        return 1 if self.quick else MAX_ROUNDS


@dataclass(frozen=True, eq=False)
class Joined:
    """The model as a cause has joined it, before errors of its simulation are computed anew.

    fit, error : of that model; close_rivals : rivals whose evidence comes near that of the cause; is_finite : whether
    finite strains have joined since
    """

    fit: Fit
    error: MotionError | None
    close_rivals: tuple[Rival, ...]
    is_finite: bool = False


@dataclass(frozen=True, eq=False)
class Doubted:
    """A round whose winner awaits other causes; rounds, model : the rounds before it, and the model that it joins."""

    round: Round
    rounds: tuple[Round, ...]
    model: FittedModel


@dataclass(frozen=True, eq=False)
class State:
    """A diagnosis between two moves.

    identification : under diagnosis, with its known error
    first : the identified model, fitted to the copy for choosing
    model : the last model, with every selected cause; its residual is mostly that of the end of its fit
    mismatch : side, onset and place, None where they could not be located
    rounds : that have ended; the last one has no winner, unless the limit of rounds was reached
    number : of screenings; round : under way, None between two rounds; announced : its refits
    joined : the model as the last cause has joined it, None while a round is under way
    doubted : the first round whose winner awaits others
    end : the freed end that explains more than the causes that were selected, which are not told then
    final : the last model fitted to the recording itself, None where no cause joined the identified one
    other_axis : fit of that model with another axis, where the recording does not tell it from the first
    settled : the model at the values that the known error of `final` is of, None where it is of its start
    small_errors : of the simulation of the identified model, that it does not count, by name: a part of the null of
    scores
    """

    setting: Setting
    identification: Identification
    first: FittedModel
    model: FittedModel
    mismatch: Mismatch | None = None
    rounds: tuple[Round, ...] = ()
    number: int = 0
    round: Round | None = None
    announced: AnnouncedRefits | None = None
    joined: Joined | None = None
    doubted: Doubted | None = None
    end: FreeEnd | None = None
    final: FittedModel | None = None
    other_axis: Fit | None = None
    settled: Identification | None = None
    small_errors: Mapping[str, MotionError] = field(default_factory=dict)

    @property
    def refits(self) -> Refits:
        """Runs refit jobs: announced while a round is under way."""
        return self.setting.refits if self.announced is None else self.announced

    @property
    def winner(self) -> Rival | None:
        """Of the round under way."""
        return None if self.round is None else self.round.winner

    @property
    def is_open(self) -> bool:
        """Whether another round follows."""
        return not self.rounds or (last_cause(self) is not None and self.number < self.setting.max_rounds)

    def with_last(self, entry: Round, model: FittedModel) -> State:
        """With another last round, and the model that it ends with."""
        return replace(self, rounds=(*self.rounds[:-1], entry), model=model)

    def simulated(self) -> State | None:
        """With the residual of the model on the recording; None where it finds no equilibrium from rest."""
        if self.model.residual is not None:
            return self
        model = self.model.simulated()
        return None if model is None else replace(self, model=model)

    @property
    def power_of_copy(self) -> float:
        """Chi-square of a motion of one px (rms) in all frames of a copy."""
        return self.power / COPY_VARIANCE_FACTOR

    @property
    def power(self) -> float:
        """The same of the recording."""
        return float(power(self.first.residual.evidence).sum())


@dataclass(frozen=True, eq=False)
class OpenRound:
    """A round under way; state : that it belongs to."""

    state: State
    round: Round


@dataclass(frozen=True, eq=False)
class Selected:
    """A cause: the winner of a round, which is under way or the last one that has ended; state : that it belongs to."""

    state: State
    round: Round
    winner: Rival


@dataclass(frozen=True, eq=False)
class JoinedCause(Selected):
    """The last cause, once it has joined the model; joined : the model as it did."""

    joined: Joined


def open_round(state: State) -> OpenRound | None:
    """The round under way."""
    return None if state.round is None else OpenRound(state, state.round)


def leading(state: State) -> Selected | None:
    """The winner of the round under way."""
    entry = state.round
    return None if entry is None or entry.winner is None else Selected(state, entry, entry.winner)


def improvable(state: State) -> Selected | None:
    """The winner of the round under way, whose form may be improved; not in a quick diagnosis."""
    return None if state.setting.quick else leading(state)


def last_cause(state: State) -> Selected | None:
    """The winner of the last round that has ended."""
    entry = state.rounds[-1] if state.rounds else None
    return None if entry is None or entry.winner is None else Selected(state, entry, entry.winner)


def joined_cause(state: State) -> JoinedCause | None:
    """The last cause, which has joined the model in this round."""
    cause = last_cause(state)
    if cause is None or state.joined is None:
        return None
    return JoinedCause(state, cause.round, cause.winner, state.joined)


def changed_cause(state: State) -> JoinedCause | None:
    """The same where the model has been fitted again since."""
    cause = joined_cause(state)
    return None if cause is None or state.model.fit is cause.joined.fit else cause
