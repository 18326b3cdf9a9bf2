"""The runs of a batch: experiments given by path, lists of runs (TOML or CSV), random starts.

::

    set = { "options.max_iterations" = 30 }        # optional, for all runs of the list
    [[run]]
    experiment = "specimen-1"                      # relative to the list
    name = "soft"                                  # optional: the folder in DIR
    set = { "sheet.E" = 60e3 }                     # as --set on the command line

or as a table, an empty cell being no setting::

    experiment,name,sheet.E
    specimen-1,soft,60e3
    specimen-2,,
"""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from idic.errors import InputError
from idic.experiment_file import EXPERIMENT_FILE, locate, read_toml

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._+-]{0,99}")
_FIXED = ("experiment", "name")
_LIST = "a list has tables [[run]] with experiment, name, set; optional on top: set"


@dataclass(frozen=True)
class BatchRun:
    """One identification of a batch: its folder in DIR, the experiment.toml, ``--set key=value``."""

    name: str
    experiment: str
    overrides: Mapping[str, Any] = field(default_factory=dict)


def read_batch(paths: Sequence[str | Path], overrides: Mapping[str, Any] | None = None) -> tuple[BatchRun, ...]:
    """The runs of experiments and lists, in order, each with its own name.

    Parameters
    ----------
    paths : experiment folders, experiment files, lists (``*.csv``, or TOML with ``[[run]]``)
    overrides : for every run; a list's own come on top

    Raises
    ------
    InputError
        A list that is not as above, an experiment that is not there, a name twice or one that is no folder name.
    """
    runs: list[BatchRun] = []
    for path in map(Path, paths):
        for run in _runs_of(path):
            runs.append(BatchRun(run.name, run.experiment, {**dict(overrides or {}), **run.overrides}))
    if not runs:
        raise InputError("an empty batch", expected="at least one experiment", found="none",
                         remedy="name experiment folders or a list of them")
    return _with_own_names(runs)


def _runs_of(path: Path) -> list[BatchRun]:
    if path.suffix.lower() == ".csv" and path.is_file():
        return _csv_list(path)
    if path.suffix.lower() == ".toml" and path.is_file():
        raw = read_toml(path)
        if "run" in raw:
            return _toml_list(path, raw)
    return [BatchRun("", str(locate(path).resolve()))]


# lists ----------------------------------------------------------------------------------------------
def _toml_list(file: Path, raw: Mapping) -> list[BatchRun]:
    common = _settings(raw.get("set", {}), file, "set")
    _known_keys(raw, ("run", "set"), file, "")
    if not isinstance(raw["run"], list) or not all(isinstance(entry, dict) for entry in raw["run"]):
        raise InputError("not a list of runs", file=file, key="run", expected="[[run]] tables", found="something else",
                         remedy=_LIST)
    runs = []
    for number, entry in enumerate(raw["run"]):
        key = f"run[{number}]"
        _known_keys(entry, ("experiment", "name", "set"), file, key)
        settings = _settings(entry.get("set", {}), file, f"{key}.set")
        runs.append(_entry(file, key, entry.get("experiment", ""), entry.get("name", ""), {**common, **settings}))
    return runs


def _csv_list(file: Path) -> list[BatchRun]:
    try:
        lines = file.read_text(encoding="utf-8-sig").splitlines()
        rows = [row for row in csv.reader(lines) if any(map(str.strip, row))]
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError("not a CSV file", file=file, expected="comma-separated UTF-8", found=str(error),
                         remedy="export the list again") from None
    header = [cell.strip() for cell in rows[0]] if rows else []
    if "experiment" not in header or len(set(header)) < len(header):
        raise InputError("the list has no usable header", file=file, key="line 1",
                         expected="experiment, name (optional), and keys as of --set, each once",
                         found=", ".join(header) or "nothing", remedy="name the columns")
    runs = []
    for number, row in enumerate(rows[1:], start=2):
        if len(row) > len(header):
            raise InputError("more cells than columns", file=file, key=f"row {number}", expected=f"{len(header)} cells",
                             found=str(len(row)), remedy="put text that holds a comma in quotes")
        cells = {name: cell.strip() for name, cell in zip(header, row, strict=False)}
        settings = {name: text for name, text in cells.items() if name not in _FIXED and text}
        runs.append(_entry(file, f"row {number}", cells.get("experiment", ""), cells.get("name", ""), settings))
    return runs


def _entry(file: Path, key: str, experiment: object, name: object, overrides: Mapping) -> BatchRun:
    if not isinstance(experiment, str) or not experiment:
        raise InputError("a run without an experiment", file=file, key=key, expected="the path of a folder, as text",
                         found=repr(experiment), remedy=_LIST)
    if not isinstance(name, str) or (name and not _NAME.fullmatch(name)):
        raise InputError("not a usable name of a run", file=file, key=key, found=repr(name),
                         expected="letters, digits, . _ + -, beginning with a letter or digit: a folder in DIR",
                         remedy="choose another name, or leave it out")
    path = file.parent / experiment  # an absolute path stays one
    try:
        return BatchRun(name, str(locate(path).resolve()), overrides)
    except InputError as error:
        raise InputError(error.what, file=file, key=key, expected=error.expected, found=f"{experiment}: {error.found}",
                         remedy="paths are relative to the list") from None


def _settings(table: object, file: Path, key: str) -> dict[str, Any]:
    if not isinstance(table, dict):
        raise InputError("not a table of settings", file=file, key=key, found=repr(table),
                         expected='{ "sheet.E" = 60e3 }, keys as of --set',
                         remedy="write the settings as a table in { }")
    return dict(table)


def _known_keys(table: Mapping, keys: Sequence[str], file: Path, key: str) -> None:
    for name in table:
        if name not in keys:
            raise InputError("unknown key", file=file, key=f"{key}.{name}".lstrip("."), expected=", ".join(keys),
                             found=name, remedy=_LIST)


# names ----------------------------------------------------------------------------------------------
def _with_own_names(runs: Sequence[BatchRun]) -> tuple[BatchRun, ...]:
    """Runs without a name get that of their folder (or file), with a number where it is taken."""
    names: set[str] = set()
    for run in runs:
        if run.name:
            if run.name.lower() in names:
                raise InputError("two runs of one name", key="name", found=run.name,
                                 expected="names that differ in more than upper and lower case",
                                 remedy="rename one of them")
            names.add(run.name.lower())
    return tuple(run if run.name else BatchRun(_free_name(run.experiment, names), run.experiment, run.overrides)
                 for run in runs)


def _free_name(experiment: str, names: set[str]) -> str:
    path = Path(experiment)
    stem = path.parent.name if path.name == EXPERIMENT_FILE else path.stem
    plain = re.sub(r"[^A-Za-z0-9._+-]+", "_", stem).lstrip("._+-") or "run"
    name, number = plain[:90], 2
    while name.lower() in names:
        name, number = f"{plain[:90]}-{number}", number + 1
    names.add(name.lower())
    return name

