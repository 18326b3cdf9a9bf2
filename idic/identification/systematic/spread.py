"""Systematic errors of a result: bias, spread over treatments, parameters that are not identifiable."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field

import numpy as np

from idic.parameters import digits_text

BETWEEN_TREATMENTS = "between treatments of boundary and camera"
MAX_SPREAD = 0.3  # of the value: a parameter that changes by more between treatments is not identified


@dataclass(frozen=True)
class Assessment:
    """The outcome of a treatment or of the finer mesh: values (biases) in the user's units, or why there are none.

    values : of parameters and ratios that it determines (`determined_values`)
    added : value, std (None: not determined) and unit of every additional degree of freedom of the treatment
    """

    boundary: str
    camera: str
    status: str
    values: Mapping[str, float]
    failed: str = ""
    added: Mapping[str, Mapping[str, float | str | None]] = field(default_factory=dict)


def with_bias(result: dict, finer: Assessment, shorter_increments: Assessment | None = None) -> dict:
    """The result with `discretisation_bias`, and a warning where it exceeds the standard deviation.

    finer : the biases of the mesh; shorter_increments : those of the increments of time, `time_bias`, which replace
    the estimate of the identification
    """
    if shorter_increments is not None:
        result = _with_time_bias(result, shorter_increments)
    notes = [note for note in result["notes"] if "discretisation bias" not in note]
    for name, bias in finer.values.items():
        entry = result["parameters"][name]
        if entry["std"] is None:
            continue
        entry["mesh_bias"], bias = bias, bias + (entry.get("time_bias") or 0.0)
        entry["discretisation_bias"] = bias
        if abs(bias) > entry["std"]:
            notes.append(f"{name}: the discretisation bias, {digits_text(bias)}, exceeds the standard deviation, "
                         f"{digits_text(entry['std'])} {entry['unit']}: use {_remedy(entry)}")
    if finer.failed:
        notes.append(f"discretisation bias not known: {finer.failed}")
    return result | {"notes": notes, "refinement": {"how": finer.status, "failed": finer.failed}}


def _remedy(entry: Mapping) -> str:
    """What makes the larger part of a discretisation bias smaller."""
    by_time = abs(entry.get("time_bias") or 0.0) > abs(entry["mesh_bias"])
    return "shorter increments (substeps)" if by_time else "smaller elements where the strain varies"


def _with_time_bias(result: dict, finer: Assessment) -> dict:
    """The result with `time_bias`, the part of `discretisation_bias` that is due to the increments of time."""
    notes = list(result["notes"])
    for name, bias in finer.values.items():
        if result["parameters"][name]["std"] is not None:
            result["parameters"][name]["time_bias"] = bias
    if finer.failed:
        notes.append(f"time step error not known: {finer.failed}")
    return result | {"notes": notes}


def determined_values(result: Mapping, names: Sequence[str]) -> dict[str, float]:
    """Values of the parameters `names` that an identification determines, and of ratios of those that it does not.

    A parameter that it leaves open keeps the value that it started from, which says nothing.

    result : content of result.json
    """
    entries = result["parameters"]
    values = {name: entries[name]["value"] for name in names if entries.get(name, {}).get("std") is not None}
    return values | {label: entry["value"] for label, entry in result["derived"].items() if ratio_of(label, entries)}


def with_spread(result: dict, assessments: Sequence[Assessment]) -> dict:
    """The result with `systematic_std`; a parameter that changes too much between treatments is not identifiable.

    systematic_std : standard deviation of the values of the run and of all treatments that converged
    """
    good = [assessment.values for assessment in assessments if assessment.status == "converged"]
    result = _without_earlier_judgement(result) | {"treatments": [asdict(assessment) for assessment in assessments]}
    if not good:
        return result
    for name, entry in result["parameters"].items():
        values = [values[name] for values in good if name in values]
        if entry["std"] is not None and values:
            entry["systematic_std"] = float(np.std([entry["value"], *values], ddof=1))
            _judge(result, name, entry, values)
    for label, entry in result["derived"].items():
        values = [ratios[label] for ratios in (ratios_of(result, values) for values in good) if label in ratios]
        if values:
            entry["systematic_std"] = float(np.std([entry["value"], *values], ddof=1))
            _judge(result, label, entry, values)
    return result


def _without_earlier_judgement(result: dict) -> dict:
    """The result without an earlier judgement; a parameter gets its value and standard deviation back."""
    result = copy.deepcopy(result)
    for entry in [e for e in result["not_identifiable"] if e["reason"].endswith(BETWEEN_TREATMENTS)]:
        result["not_identifiable"].remove(entry)
        parameter = result["parameters"].get(entry["name"])
        if parameter is not None and entry["std"] is not None:
            half = 1.96 * entry["std"]
            parameter.update(value=entry["value"], std=entry["std"],
                             ci95=[entry["value"] - half, entry["value"] + half])
    return result


def _judge(result: dict, name: str, entry: dict, values: Sequence[float]) -> None:
    """List a value that changes by more than `MAX_SPREAD` as not identifiable; its parameter returns to the start
    value."""
    moved = max(abs(value / entry["value"] - 1.0) for value in values) if entry["value"] else 0.0
    if moved <= MAX_SPREAD:
        return
    result["not_identifiable"].append({
        "name": name, "together_with": [], "value": entry["value"], "std": entry["std"],
        "reason": f"moves by {100 * moved:.0f} % {BETWEEN_TREATMENTS}"})
    if "start" in entry:
        entry.update(value=entry["start"], std=None, ci95=None)


def ratios_of(result: Mapping, values: Mapping[str, float]) -> dict[str, float]:
    """The ratios among the derived quantities of a result, of other values: as they are there, else of parameters."""
    pairs = {label: ratio_of(label, result["parameters"]) for label in result["derived"]}
    return {label: values[label] if label in values else values[pair[0]] / values[pair[1]]
            for label, pair in pairs.items() if pair and (label in values or set(pair) <= set(values))}


def ratio_of(label: str, parameters: Mapping) -> tuple[str, str] | None:
    """Names of the parameters of a ratio ``SET.E1/E2`` or ``A.E/B.E``."""
    first, slash, second = label.partition("/")
    second = second if "." in second else f"{first.rpartition('.')[0]}.{second}"
    return (first, second) if slash and first in parameters and second in parameters else None
