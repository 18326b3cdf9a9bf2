"""Schema of ``state.json``."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Field, model_validator

from idic.run.store.schemas.types import MAX_WHOLE, Count, Exact, Hex, Number, Part


class _Parallel(Exact):
    values: dict[str, Hex]
    damping: Hex
    halvings: int


class _Trial(Exact):
    values: dict[str, Hex]
    parallel: list[_Parallel]
    re_evaluation: bool
    tries_activation: bool
    new_increments: bool


class _Accepted(Exact):
    values: dict[str, Hex]
    number: Annotated[int, Field(ge=-1, le=MAX_WHOLE)]
    phi: Hex | None


class _Trust(Exact):
    radius: Hex
    damping: Hex
    rejections: Count


class _Schedule(Exact):
    stage: Count
    iterations: Count


class _Activation(Exact):
    active: list[str]
    reactivated: list[str]
    rejections: Count


class _Estimator(Exact):
    kind: str
    ordinary_solution: dict[str, Hex] | None


class _Increments(Exact):
    per_frame: int | None
    status: str
    coarser: dict[str, Hex] | None
    change: dict[str, Hex] | None


class _Ending(Exact):
    status: str
    reason: str
    limit: str | None


class Evaluated(Part):
    """An entry of the history."""

    evaluation: Count
    stage: Count
    accepted: bool
    damping: Number
    phi: Number
    message: str | None = None


class _EvaluatedExactly(Evaluated):
    values: dict[str, Hex]


class State(Exact):
    """``state.json``: where the identification stands (`idic.identification.LoopState`)."""

    trial: _Trial
    accepted: _Accepted | None
    trust: _Trust
    schedule: _Schedule
    activation: _Activation
    estimator: _Estimator
    increments: _Increments
    evaluations: Count
    parallel_evaluations: Count
    iteration: Count
    status: str
    history: list[_EvaluatedExactly]
    end: _Ending | None

    @model_validator(mode="after")
    def _of_the_same_parameters(self) -> State:
        accepted = [self.accepted] if self.accepted else []
        points: list[Any] = [self.trial, *self.trial.parallel, *self.history, *accepted]
        if any(point.values.keys() != self.trial.values.keys() for point in points):
            raise ValueError("points of other parameters")
        return self
