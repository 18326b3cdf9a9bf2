"""Common parts of the tables of experiment.toml: the strict base model, number types, errors with their parts."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field
from pydantic_core import PydanticCustomError

Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
Pair = Annotated[list[float], Field(min_length=2, max_length=2)]
Component = Literal["x", "y", "z"]


def refuse(what: str, expected: str | None = None, remedy: str | None = None,
           found: object = None) -> PydanticCustomError:
    """An error that keeps its parts until `toml_file.validated` makes an InputError of it."""
    return PydanticCustomError("idic", "{what}", {"what": what, "expected": expected, "remedy": remedy, "found": found})


class Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)


def is_number(value: object) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def as_value_table(value: object) -> object:
    """A bare number is short for ``{ value = number }``."""
    return {"value": value} if is_number(value) else value


def as_list(value: object) -> object:
    return [value] if isinstance(value, str) else value


def exactly_one(model: BaseModel, names: tuple[str, ...], example: str) -> None:
    keys = [name for name in names if getattr(model, name) is not None]
    if len(keys) != 1:
        raise refuse("the source of the values is ambiguous", f"exactly one of {', '.join(names)}",
                     f"write e.g. {example}",
                     ", ".join(keys) or "none of them")
