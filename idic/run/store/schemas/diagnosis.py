"""Schemas of files of a diagnosis that are read again."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from idic.run.store.schemas.types import Count, Exact, Finite, Part, Values


class _RefittedCandidate(Part):
    name: str
    edits: str
    values: dict[str, Finite | None]


class Undecided(Part):
    """``diagnosis.json``: the candidates that were refitted, and those among which it does not decide."""

    refits: list[_RefittedCandidate] = []
    set_: Annotated[list[str] | None, Field(alias="set")] = None
    indistinguishable: list[list[str]] = []
    named: list[str] = []


class StoredRefit(Exact):
    """``diagnosis/*.npz``: a refit without its arrays."""

    name: str
    label: str
    status: str
    values: dict[str, float]
    stds: Values
    choice: float | None
    judgement: float | None
    evaluations: Count
    problem: str
    phi: float
    estimator: str
