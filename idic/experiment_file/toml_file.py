"""experiment.toml from disk to `schema.ExperimentFile`: syntax, overrides, and messages that say what to do."""

from __future__ import annotations

import copy
import difflib
import tomllib
import unicodedata
from collections.abc import Mapping
from pathlib import Path

from pydantic import BaseModel, ValidationError

from idic.errors import InputError
from idic.experiment_file.schema import ExperimentFile, FurtherCameraTable, ParameterTable

NAME = "experiment.toml"
_DEEPEST = 20  # levels of tables and lists
TABLES = tuple(name for name in ExperimentFile.model_fields if name != "further_cameras")


def locate(path: str | Path) -> Path:
    """The experiment.toml of a folder, or the TOML file itself."""
    path = Path(path)
    if path.is_dir():
        if not (path / NAME).is_file():
            raise InputError("the folder holds no experiment", file=path, key=NAME, expected=f"a file {NAME}",
                             found="none",
                             remedy=f"run  idic init {path}  to write one for the files found there")
        return path / NAME
    if not path.is_file():
        raise InputError("no such experiment", file=path, expected=f"a folder with an {NAME}, or such a file",
                         found="nothing there",
                         remedy="check the path")
    return path


def read_toml(path: Path) -> dict:
    """The raw tables of a TOML file."""
    try:
        tables = tomllib.loads(path.read_text(encoding="utf-8"))
    except UnicodeDecodeError as error:
        raise InputError("not a text file in UTF-8", file=path, expected="UTF-8", found=str(error),
                         remedy="save it as UTF-8") from None
    except RecursionError:
        raise _too_deep(path) from None
    except ValueError as error:  # TOMLDecodeError; numbers with thousands of digits
        raise InputError("not valid TOML", file=path, expected="TOML, https://toml.io", found=str(error),
                         remedy="mend the line named; text needs quotes, decimal points are points") from None
    _check_text(tables, path)
    return tables


def _check_text(value: object, file: Path, key: tuple[str, ...] = ()) -> None:
    """Text that can be a name, and tables that a person could have written; escape sequences would reach terminals."""
    if len(key) > _DEEPEST:
        raise _too_deep(file)
    if isinstance(value, str) and any(unicodedata.category(c) == "Cc" and c not in "\n\t" for c in value):
        raise InputError("text with control characters", file=file, key=_short(".".join(key)),
                         expected="printable text", found=_short(value), remedy="take them out")
    if isinstance(value, dict):
        for name, below in value.items():
            _check_text(name, file, (*key, repr(name)))
            _check_text(below, file, (*key, name))
    elif isinstance(value, list):
        for number, below in enumerate(value):
            _check_text(below, file, (*key, str(number)))


def _too_deep(file: Path) -> InputError:
    return InputError("tables within tables within tables", file=file, expected=f"{_DEEPEST} levels at most",
                      found="more", remedy="idic init writes a commented example")


def with_overrides(raw: Mapping, overrides: Mapping[str, object] | None) -> dict:
    """The tables with ``--set key=value`` applied.

    Keys are dotted paths (``options.max_iterations``, ``boundary.1.uy``, ``material.SPECIMEN.E.value``); ``SPECIMEN.E``
    is short for the start value of that parameter, ``SPECIMEN.E.identify`` for another key of it, and a name in [[dof]]
    for the value of that entry. A value that is text is read as TOML where it can be (``--set options.alpha=0.05``),
    else kept as text.
    """
    raw = copy.deepcopy(dict(raw))
    for key, value in (overrides or {}).items():
        _override(raw, key, copy.deepcopy(_toml_value(value)))  # a later key may edit what an earlier one put in
    return raw


def validated(raw: Mapping, file: Path) -> ExperimentFile:
    """The tables as records; the first error becomes an InputError."""
    try:
        return ExperimentFile.model_validate(raw)
    except ValidationError as error:
        raise _input_error(error, raw, file) from None


# overrides --------------------------------------------------------------------------------------------
def _toml_value(value: object) -> object:
    if not isinstance(value, str):
        return value
    try:
        return tomllib.loads(f"value = {value}")["value"] if "\n" not in value else value
    except tomllib.TOMLDecodeError:
        return value


def _override(raw: dict, key: str, value: object) -> None:
    for entry in raw.get("dof", []):
        if isinstance(entry, dict) and entry.get("name") == key and not isinstance(value, dict):
            entry["value"] = value
            return
    parts = key.split(".")
    if len(parts) in (2, 3) and parts[0] in raw.get("material", {}) and parts[0] not in TABLES:
        parts = ["material", *parts]
    if not all(parts) or parts[0] not in TABLES:
        raise InputError("no such key", file="--set", key=key, found=repr(key),
                         expected=f"TABLE.key (tables: {', '.join(TABLES)}) or SET.parameter",
                         remedy="for instance  --set SPECIMEN.E=70000  or  --set options.max_iterations=20")
    place: object = raw
    for part in parts[:-1]:
        place = _step_into(place, part, key)
    last = parts[-1]
    if isinstance(place, list):
        place[_index(place, last, key)] = value
    elif isinstance(place, dict):
        old = place.get(last)
        if isinstance(old, dict) and not isinstance(value, dict) and "value" in old:
            old["value"] = value
        else:
            place[last] = value
    else:
        _nothing_below(key, last)


def _step_into(place: object, part: str, key: str) -> object:
    if isinstance(place, list):
        return place[_index(place, part, key)]
    if not isinstance(place, dict):
        _nothing_below(key, part)
    if isinstance(place.get(part), (int, float)) and not isinstance(place.get(part), bool):
        place[part] = {"value": place[part]}  # SPECIMEN.nu = 0.3 is short for { value = 0.3 }
    return place.setdefault(part, {})


def _index(place: list, part: str, key: str) -> int:
    if not part.isdigit() or int(part) >= len(place):
        raise InputError("no such entry", file="--set", key=key, expected=f"a number from 0 to {len(place) - 1}",
                         found=part,
                         remedy="entries of [[...]] tables are counted from 0")
    return int(part)


def _nothing_below(key: str, part: str):
    raise InputError("no such key", file="--set", key=key, expected="the path of a key",
                     found=f"nothing can stand at {part!r}",
                     remedy="check the path against experiment.toml")


# messages -----------------------------------------------------------------------------------------------
_EXPECTED = {
    "missing": "this key", "string_type": "text in quotes", "float_type": "a number", "int_type": "a whole number",
    "bool_type": "true or false", "list_type": "a list in [ ]", "dict_type": "a table", "model_type": "a table",
    "model_attributes_type": "a table", "finite_number": "a finite number",
}
_WHAT = {"missing": "a key is missing", "extra_forbidden": "unknown key"}


def _input_error(error: ValidationError, raw: Mapping, file: Path) -> InputError:
    first = min(error.errors(include_url=False),
                key=lambda e: e["type"] != "extra_forbidden")  # a misspelt key explains a missing one
    loc = _existing(first["loc"])
    key, kind, ctx = _dotted(loc), first["type"], first.get("ctx") or {}
    if kind == "idic":
        found = ctx.get("found")
        return InputError(ctx["what"], file=file, key=key or None, expected=ctx.get("expected"), found=found,
                          remedy=ctx.get("remedy"))
    if kind in ("missing", "extra_forbidden"):
        names = _fields_at(loc[:-1])
        near = difflib.get_close_matches(str(loc[-1]), names, n=1, cutoff=0.6)
        if kind == "missing":
            return InputError("a key is missing", file=file, key=key, expected=f"{loc[-1]} in {_table(loc[:-1])}",
                              found="no such key",
                              remedy="add it; idic init writes a commented example")
        return InputError("unknown key", file=file, key=key, expected=f"one of {', '.join(names)}", found=str(loc[-1]),
                          remedy=f"did you mean {near[0]}?" if near else "remove the key")
    expected = _EXPECTED.get(kind, first["msg"][:1].lower() + first["msg"][1:])
    return InputError("not a usable value", file=file, key=key, expected=expected, found=_short(first.get("input")),
                      remedy="correct the value")


def _existing(loc: tuple) -> tuple:
    """Without the names that pydantic puts in for the branches of a union."""
    kept = tuple(part for part in loc if isinstance(part, int) or (not any(mark in part for mark in "[(")
                 and part not in ("str", "literal")))
    if kept[:1] == ("further_cameras",):  # the second and later of [[camera]]
        return ("camera", kept[1] + 1, *kept[2:]) if len(kept) > 1 else ("camera",)
    return kept


def _dotted(loc: tuple) -> str:
    text = ""
    for part in loc:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else part
    return text


def _table(loc: tuple) -> str:
    if not loc:
        return "the file"
    return f"[[{loc[0]}]] number {loc[1] + 1}" if len(loc) > 1 and isinstance(loc[1], int) else f"[{_dotted(loc)}]"


def _short(value: object) -> str:
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
        found = _model_in(part)
        if found is not None:
            return found
    return None
