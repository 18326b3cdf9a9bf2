"""The candidates of a diagnosed RUN between which a further test shall decide, and each of them in a planned test.

A candidate is edits of the RUN's experiment.toml and the values of its refit (``refits`` of diagnosis.json). In a plan
it changes what it changed there: tables of lists are found by their set, column or name, whatever their order.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from idic.errors import InputError
from idic.experiment_file import locate, read_toml, with_overrides
from idic.identification import Plan
from idic.run.diagnosis.diagnosis_file import DIAGNOSIS_FILE
from idic.run.prepared.context import open_run
from idic.run.store.result_file import read_json
from idic.run.store.schemas.diagnosis import Undecided
from idic.run.store.schemas.types import refuse_other_types

KEYS = ("nodes", "column", "name", "set", "kind")  # by which tables of a list are told from each other
MAX_MEMBERS = 4  # each pair is simulated both ways round


@dataclass(frozen=True)
class RefittedModel:
    """A candidate as it was refitted: edits of experiment.toml, values of its parameters in internal units."""

    name: str
    edits: Mapping[str, Any]
    values: Mapping[str, float]


@dataclass(frozen=True)
class Diagnosed:
    """What a diagnosed RUN hands to a planned test.

    models : left undecided; tables : of the RUN's experiment.toml; largest : reading of each channel there, which the
    degrees of freedom of a load cell are shares of
    """

    models: tuple[RefittedModel, ...]
    tables: Mapping[str, Any]
    largest: Mapping[str, float]


def diagnosed(run: Path | str) -> Diagnosed:
    """The models that a diagnosis left undecided.

    The set that the diagnosis tells; where it tells one cause, that one and the best of the other refitted candidates.

    Raises
    ------
    InputError
        The RUN is not diagnosed, or the diagnosis leaves nothing to decide.
    """
    run = Path(run)
    if not (run / DIAGNOSIS_FILE).exists():
        raise InputError("the run is not diagnosed", file=run, key="--separate",
                         expected=f"a RUN with {DIAGNOSIS_FILE}", found="none",
                         remedy=f"run  idic diagnose {run.name}  first")
    try:
        content = read_json(run / DIAGNOSIS_FILE)
        refuse_other_types(content, Undecided, run / DIAGNOSIS_FILE)
        refits = {entry["name"]: RefittedModel(entry["name"], tomllib.loads(entry["edits"]), dict(entry["values"]))
                  for entry in content.get("refits", ())}
    except ValueError as problem:
        raise InputError("a damaged diagnosis", file=run / DIAGNOSIS_FILE, expected="what idic diagnose writes",
                         found=str(problem), remedy=f"run  idic diagnose {run.name}  again") from problem
    chosen = [name for name in undecided(content) if name in refits][:MAX_MEMBERS]
    if len(chosen) < 2:
        raise InputError("nothing is left to decide", file=run / DIAGNOSIS_FILE, key="--separate",
                         expected="two refitted candidates or more", found=", ".join(chosen or refits) or "none",
                         remedy="diagnose a run that leaves a set of candidates; an older diagnosis.json has none")
    context = open_run(str(run))
    return Diagnosed(tuple(refits[name] for name in chosen), context.tables.raw,
                     {channel.column: channel.largest for channel in context.experiment.model.channels})


def undecided(content: Mapping) -> list[str]:
    """Names of the candidates between which a diagnosis.json does not decide; of the best two where it names one."""
    groups = [content.get("set"), *content.get("indistinguishable", ())]
    for group in groups:
        if group and len(group) > 1:
            return list(group)
    refitted = [entry["name"] for entry in content.get("refits", ())]
    named = [name for name in content.get("named", ()) if name in refitted][:1]
    return [*named, *(name for name in refitted if name not in named)][:2]


def planned(model: RefittedModel, origin: Diagnosed, path: Path | str, overrides: Mapping[str, Any] | None,
            noise_std_gv: float | None) -> Plan:
    """The plan with a refitted model in the place of its own.

    Raises
    ------
    InputError
        As `Plan.of`; the plan has not what the candidate changes.
    """
    document = with_overrides(read_toml(locate(path)), overrides)
    edits = carried_edits(model, origin.tables, document, path)
    plan = Plan.of(path, {**(overrides or {}), **edits}, noise_std_gv)
    parameters = plan.experiment.model.parameters
    channels = tuple(replace(channel, full_scale=origin.largest.get(channel.column, channel.full_scale))
                     for channel in plan.experiment.model.channels)
    values = {name: value for name, value in model.values.items() if name in parameters and value is not None}
    experiment = replace(plan.experiment, model=replace(plan.experiment.model, channels=channels))
    return replace(plan, experiment=experiment.with_parameters(parameters.with_values(values)))


def carried_edits(model: RefittedModel, base: Mapping, document: Mapping, path: Path | str) -> dict[str, Any]:
    """What the edits of a candidate change, as edits of another experiment."""
    carried: dict[str, Any] = {}
    for key, value in model.edits.items():
        if isinstance(value, list) and all(isinstance(table, Mapping) for table in value):
            carried[key] = _merged_tables(value, _at(base, key), _at(document, key), model.name, key, path)
        else:
            carried[key] = value
        head, _, name = key.partition(".")
        if head == "material" and name.split(".")[0] not in document.get("material", {}):
            raise _missing(model.name, f"[{key}]", path, ", ".join(document.get("material", {})))
    return carried


def _at(document: Any, key: str) -> list:
    for part in key.split("."):
        document = document.get(part, []) if isinstance(document, Mapping) else []
    return document if isinstance(document, list) else [document]


def _merged_tables(edited: Sequence[Mapping], base: Sequence[Mapping], tables: Sequence[Mapping], member: str, key: str,
                   path: Path | str) -> list[dict]:
    """The tables of the plan with what the candidate changed in those of the RUN, and with those that it added."""
    merged = [dict(table) for table in tables]
    for table in edited:
        original = next((entry for entry in base if _label(entry) == _label(table)), None)
        place = next((k for k, entry in enumerate(merged) if _label(entry) == _label(table)), None)
        if original is None and place is None:
            merged.append(dict(table))
        elif original != table:
            if place is None:
                raise _missing(member, f"[[{key}]] {_label(table)[1]}", path,
                               ", ".join(str(_label(entry)[1]) for entry in tables))
            merged[place] = _changed(merged[place], original or {}, table)
    return merged


def _label(table: Mapping) -> tuple[str, Any]:
    return next(((key, table[key]) for key in KEYS if key in table), ("", ""))


def _changed(planned_value: Any, original: Any, edited: Any) -> Any:
    """What an edit changed in a table, changed in another one; a number that became a table keeps its place there."""
    if not isinstance(edited, Mapping):
        return edited
    if isinstance(original, Mapping):
        original_keys = original
    else:  # ux = 0.0 became { value = 0.0, corrections = ... }
        original_keys = {} if original is None else {"value": original}
    result = dict(planned_value) if isinstance(planned_value, Mapping) else {} if planned_value is None else {
        "value": planned_value}
    for key, value in edited.items():
        if original_keys.get(key) != value:
            result[key] = _changed(result.get(key), original_keys.get(key), value)
    return result


def _missing(member: str, key: str, path: Path | str, names: str) -> InputError:
    return InputError("the plan has not what a candidate changes", file=path, key=key,
                      expected=f"a test with it, for {member.replace('_', ' ')}", found=names or "none",
                      remedy="copy the experiment.toml of the run, and change what the plan changes")
