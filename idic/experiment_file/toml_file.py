"""experiment.toml as text: read from disk, changed by ``--set``, written by commands that make experiments."""

from __future__ import annotations

import copy
import math
import tomllib
import unicodedata
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import tomli_w
from pydantic import ValidationError

from idic.errors import InputError
from idic.experiment_file.laws.composed_law import with_flat_terms
from idic.experiment_file.schema.experiment_file import ExperimentFile
from idic.experiment_file.schema.errors import input_error, shortened
from idic.readers import text_of

EXPERIMENT_FILE = "experiment.toml"
_MAX_LEVELS = 20  # of tables and lists within each other
_MAX_LINE = 100  # characters of a list written on one line
_MAX_NUMBER = 1e60  # absolute value, and its reciprocal the smallest: variances of variances stay floats
EXPERIMENT_SUFFIX = ".toml"
_MAX_INDEX_DIGITS = 6  # of the number of a [[...]] table
TABLES = tuple(name for name in ExperimentFile.model_fields if name != "further_cameras")


def locate(path: str | Path) -> Path:
    """The experiment.toml of a folder, or the TOML file itself."""
    path = Path(path)
    if path.is_dir():
        if not (path / EXPERIMENT_FILE).is_file():
            raise InputError("the folder holds no experiment", file=path, key=EXPERIMENT_FILE,
                             expected=f"a file {EXPERIMENT_FILE}", found="none",
                             remedy=f"run  idic init {path}  to write one for the files found there")
        return path / EXPERIMENT_FILE
    if not path.is_file():
        raise InputError("no such experiment", file=path,
                         expected=f"a folder with an {EXPERIMENT_FILE}, or such a file", found="nothing there",
                         remedy="check the path")
    if path.suffix.lower() != EXPERIMENT_SUFFIX:  # a forged RUN may name any file as its experiment
        raise InputError("not an experiment file", file=path, expected=f"a name that ends in {EXPERIMENT_SUFFIX}",
                         found=path.name, remedy="check the path, or rename the file")
    return path


def read_toml(path: Path) -> dict:
    """The raw tables of a TOML file; editors of Windows put a byte order mark before it."""
    text, _ = text_of(path.read_bytes(), path, None, windows=False)
    try:
        tables = tomllib.loads(text.replace("\r\n", "\n"))
    except RecursionError:
        raise _too_deep(path) from None
    except ValueError as error:  # TOMLDecodeError; numbers with thousands of digits
        raise InputError("not valid TOML", file=path, expected="TOML, https://toml.io", found=str(error),
                         remedy="correct that line: text stands in quotes, numbers have a decimal point") from None
    check_values(tables, path)
    return with_law_files(tables, path.parent, path)


def with_law_files(tables: dict, folder: Path, path: Path) -> dict:
    """The tables with the laws that ``from = "law.toml"`` takes from other files in `folder`; keys beside it win.

    path : the file of the tables, for messages

    Raises
    ------
    InputError
        There is no such file, or it is no law.
    """
    materials = tables.get("material")
    if not isinstance(materials, dict):
        return tables
    law_tables = {}
    for name, table in materials.items():
        law_tables[name] = table
        if not isinstance(table, dict) or "from" not in table:
            continue
        key, source = f"material.{name}.from", folder / str(table["from"])
        if not source.is_file():
            raise InputError("no such law file", file=path, key=key,
                             expected="a file that  idic laws --export RUN  wrote",
                             found=shortened(str(table["from"])),
                             remedy="correct the path; it counts from the experiment's folder")
        law = read_toml(source)
        if "law" not in law or "from" in law:
            raise InputError("not a law file", file=source, key="law", expected='law = "...", and its parameters',
                             found=", ".join(law) or "nothing",
                             remedy="name a file that  idic laws --export RUN  wrote")
        law_tables[name] = law | {parameter: value for parameter, value in table.items() if parameter != "from"}
    return tables | {"material": law_tables}


def law_files(path: Path) -> list[Path]:
    """The files of ``from = "law.toml"`` in a TOML file that was read without complaint."""
    text, _ = text_of(path.read_bytes(), path, None, windows=False)
    materials = tomllib.loads(text.replace("\r\n", "\n")).get("material", {})
    return [path.parent / str(table["from"]) for table in materials.values() if isinstance(table, dict)
            and "from" in table]


def check_values(value: object, file: Path | str, key: tuple[str, ...] = ()) -> None:
    """Refuse control characters (they would reach terminals), numbers whose powers overflow, and deep nesting."""
    if len(key) > _MAX_LEVELS:
        raise _too_deep(file)
    if isinstance(value, str) and any(unicodedata.category(c) == "Cc" and c not in "\n\t" for c in value):
        raise InputError("text with control characters", file=file, key=shortened(".".join(key)),
                         expected="printable text", found=shortened(value), remedy="remove them")
    if isinstance(value, (int, float)) and not _measurable(value):
        raise InputError("a number beyond all measure", file=file, key=shortened(".".join(key)),
                         expected=f"zero, or an absolute value from {1 / _MAX_NUMBER:g} to {_MAX_NUMBER:g}",
                         found=shortened(value), remedy="correct the number, or choose another unit")
    if isinstance(value, dict):
        for name, below in value.items():
            check_values(name, file, (*key, repr(name)))
            check_values(below, file, (*key, name))
    elif isinstance(value, list):
        for number, below in enumerate(value):
            check_values(below, file, (*key, str(number)))


def _measurable(value: float) -> bool:
    """Whether a number is zero, or of a size whose fourth power is a float; infinite bounds are judged later."""
    return value == 0 or value != value or abs(value) == math.inf or 1 / _MAX_NUMBER <= abs(value) <= _MAX_NUMBER


def _too_deep(file: Path | str) -> InputError:
    return InputError("the tables are nested too deeply", file=file, expected=f"{_MAX_LEVELS} levels at most",
                      found="more", remedy="remove levels; idic init writes a commented example")


def with_overrides(raw: Mapping, overrides: Mapping[str, Any] | None) -> dict:
    """The tables with ``--set key=value`` applied.

    Keys are dotted paths (``options.max_iterations``, ``boundary.1.uy``, ``material.SPECIMEN.E.value``); ``SPECIMEN.E``
    is short for the start value of that parameter, ``SPECIMEN.E.identify`` for another key of it, and a name in [[dof]]
    for the value of that entry. A value that is text is read as TOML where it can be (``--set options.alpha=0.05``),
    else kept as text. The terms of a composed law are flat parameters before: ``SPECIMEN.hardening_1_Q``.

    Raises
    ------
    InputError
        A key that does not exist; a term that is not one.
    """
    edited = copy.deepcopy(with_flat_terms(raw, EXPERIMENT_FILE))
    for key, value in (overrides or {}).items():
        check_values(key, "--set")
        setting = _toml_value(value)
        check_values(setting, "--set", (key,))
        _override(edited, key, copy.deepcopy(setting))  # a later key may edit the value of an earlier one
    return edited


def validated(raw: Mapping, file: Path) -> ExperimentFile:
    """The tables as records; the first error becomes an InputError."""
    try:
        return ExperimentFile.model_validate(raw)
    except ValidationError as error:
        raise input_error(error, raw, file) from None


def to_toml(tables: Mapping) -> str:
    """The tables as TOML text, short lists on one line.

    Raises
    ------
    TypeError
        A value that TOML does not know.
    """
    return "\n".join(_short_lists_folded(tomli_w.dumps(tables).splitlines())) + "\n"


def _short_lists_folded(lines: list[str]) -> list[str]:
    """The lines of tomli-w (one list entry per line) with short lists folded into one line."""
    folded_lines: list[str] = []
    starts: list[int] = []
    for line in lines:
        folded_lines.append(line)
        if line.endswith("["):
            starts.append(len(folded_lines) - 1)
        elif line.strip() in ("]", "],") and starts:
            start = starts.pop()
            inside = " ".join(entry.strip() for entry in folded_lines[start + 1 : -1]).rstrip(",")
            folded = folded_lines[start] + inside + line.strip()
            if len(folded) <= _MAX_LINE:
                folded_lines[start:] = [folded]
    return folded_lines


# overrides --------------------------------------------------------------------------------------------
def _toml_value(value: object) -> object:
    if not isinstance(value, str):
        return value
    try:
        return tomllib.loads(f"value = {value}")["value"] if "\n" not in value else value
    except RecursionError:
        raise _too_deep("--set") from None
    except ValueError:  # TOMLDecodeError; numbers with thousands of digits
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
                         remedy="correct the key, e.g.  --set SPECIMEN.E=70000  or  --set options.max_iterations=20")
    place: object = raw
    for part in parts[:-1]:
        place = _step_into(place, part, key)
    leaf = parts[-1]
    if isinstance(place, list):
        place[_index(place, leaf, key)] = value
    elif isinstance(place, dict):
        entry_value = place.get(leaf)
        if isinstance(entry_value, dict) and not isinstance(value, dict) and "value" in entry_value:
            entry_value["value"] = value
        else:
            place[leaf] = value
    else:
        _nothing_below(key, leaf)


def _step_into(place: Any, part: str, key: str) -> Any:
    if isinstance(place, list):
        return place[_index(place, part, key)]
    if not isinstance(place, dict):
        _nothing_below(key, part)
    if isinstance(place.get(part), (int, float)) and not isinstance(place.get(part), bool):
        place[part] = {"value": place[part]}  # SPECIMEN.nu = 0.3 is short for { value = 0.3 }
    return place.setdefault(part, {})


def _index(place: list, part: str, key: str) -> int:
    if not part.isdecimal() or len(part) > _MAX_INDEX_DIGITS or int(part) >= len(place):
        raise InputError("no such entry", file="--set", key=key, expected=f"a number from 0 to {len(place) - 1}",
                         found=part,
                         remedy="correct the number: entries of [[...]] tables count from 0")
    return int(part)


def _nothing_below(key: str, part: str):
    raise InputError("no such key", file="--set", key=key, expected="the path of a key",
                     found=f"{part!r} below a value that is not a table",
                     remedy="check the path against experiment.toml")
