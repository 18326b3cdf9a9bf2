"""Schema of ``batch.json``."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Field, model_validator

from idic.run.store.schemas.types import Count, Exact, Finite


class _BatchParameter(Exact):
    value: Finite | None
    std: Finite | None
    unit: str | None
    start: Finite | None

    @model_validator(mode="after")
    def _std_of_a_value(self) -> _BatchParameter:
        if self.value is None and self.std is not None:
            raise ValueError("a standard deviation of no value")
        return self


class BatchRow(Exact):
    """``batch.json``: a run of a batch."""

    name: str
    experiment: str
    set_: Annotated[dict[str, Any], Field(alias="set")]
    run: str
    status: str
    reason: str
    iterations: Count | None
    image_chi2_dof: Finite | None
    wall_s: Finite | None
    parameters: dict[str, _BatchParameter]
