"""Messages for invalid tables of experiment.toml: the errors of pydantic in the terms of the file."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from pathlib import Path

from pydantic import BaseModel, ValidationError

from idic.errors import InputError
from idic.experiment_file.schema.experiment_file import ExperimentFile
from idic.experiment_file.schema.cameras import FurtherCameraTable
from idic.experiment_file.schema.materials import ParameterTable

_EXPECTED = {
    "missing": "this key", "string_type": "text in quotes", "float_type": "a number", "int_type": "a whole number",
    "bool_type": "true or false", "list_type": "a list in [ ]", "dict_type": "a table", "model_type": "a table",
    "model_attributes_type": "a table", "finite_number": "a finite number",
}


def input_error(error: ValidationError, raw: Mapping, file: Path) -> InputError:
    """The first error of pydantic as an InputError: key, expected, found, remedy."""
    first = min(error.errors(include_url=False),
                key=lambda e: e["type"] != "extra_forbidden")  # a misspelt key explains a missing one
    kind, ctx = first["type"], first.get("ctx") or {}
    n_exact = 1 if kind in ("missing", "extra_forbidden") else 0  # a key of the file, whatever its name looks like
    loc = _existing(first["loc"], n_exact)
    key = _dotted(loc)
    if kind == "idic":
        actual = ctx.get("found")
        return InputError(ctx["what"], file=file, key=key or None, expected=ctx.get("expected"), found=actual,
                          remedy=ctx.get("remedy"))
    if kind in ("missing", "extra_forbidden"):
        names = _fields_at(loc[:-1])
        matches = difflib.get_close_matches(str(loc[-1]), names, n=1, cutoff=0.6)
        if kind == "missing":
            return InputError("a key is missing", file=file, key=key, expected=f"{loc[-1]} in {_table(loc[:-1])}",
                              found="no such key",
                              remedy="add the key; idic init writes a commented example")
        return InputError("unknown key", file=file, key=key, expected=f"one of {', '.join(names)}", found=str(loc[-1]),
                          remedy=f"did you mean {matches[0]}?" if matches else "remove the key")
    expected = _EXPECTED.get(kind, first["msg"][:1].lower() + first["msg"][1:])
    return InputError("not a usable value", file=file, key=key, expected=expected, found=shortened(first.get("input")),
                      remedy="correct the value")


def _existing(loc: tuple, n_exact: int) -> tuple:
    """The location without the names that pydantic inserts for the branches of a union; its last `n_exact` parts
    are kept."""
    inner = len(loc) - n_exact
    parts = tuple(part for k, part in enumerate(loc) if k >= inner or isinstance(part, int)
                  or (not any(mark in part for mark in "[(") and part not in ("str", "literal")))
    if parts[:1] == ("further_cameras",):  # the second and later of [[camera]]
        return ("camera", parts[1] + 1, *parts[2:]) if len(parts) > 1 else ("camera",)
    return parts


def _dotted(loc: tuple) -> str:
    text = ""
    for part in loc:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else part
    return text


def _table(loc: tuple) -> str:
    if not loc:
        return "the file"
    return f"[[{loc[0]}]] number {loc[1] + 1}" if len(loc) > 1 and isinstance(loc[1], int) else f"[{_dotted(loc)}]"


def shortened(value: object) -> str:
    """The value in at most 80 characters."""
    text = repr(value)
    return text if len(text) < 80 else text[:77] + "..."


def _fields_at(loc: tuple) -> list[str]:
    """The keys allowed in the table at `loc`."""
    if loc[:1] == ("material",) and len(loc) == 3:  # material.SET.parameter
        return list(ParameterTable.model_fields)
    if loc[:1] == ("camera",) and len(loc) == 2:
        return list(FurtherCameraTable.model_fields)
    model: type[BaseModel] | None = ExperimentFile
    for part in loc:
        if isinstance(part, int) or model is None:
            continue
        field = model.model_fields.get(part)
        model = _model_in(field.annotation) if field is not None else model
    return list(model.model_fields) if model is not None else []


def _model_in(annotation: object) -> type[BaseModel] | None:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    for part in getattr(annotation, "__args__", ()):
        model = _model_in(part)
        if model is not None:
            return model
    return None
