"""Two records of the same case: every place where they differ.

Where the fingerprints agree, everything must be equal to the last bit. On another machine the last bits of a number
depend on the processor: numbers are compared with a tolerance, texts without their numbers, sums of bits not at all.
"""

from __future__ import annotations

import difflib
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from idic_studies.equality.normal_text import without_numbers

VALUE_TOLERANCE, STD_TOLERANCE = 1e-6, 1e-4  # of the scale, between machines
SMALLEST_SCALE = 1e-9  # of a number: below it is rounding
UNITS = {"score": 1.0, "effect_channel_std": 1.0, "effect_px_rms": 0.01}  # std, std, px; far below is rounding
STD_PLACES = ("std", "ci95", "bias", "p_value", "eigen", "correlation", "discrepancy", " M", "diagnosis.json")
REMAINDERS = ("system/b", "system/frame_local_step")  # arrays that a search brings near zero: their digits are rounding
MAX_TEXT_LINES = 6  # of one text that are shown


@dataclass(frozen=True)
class Difference:
    """A place of a record, and what base and head have there."""

    place: str
    text: str

    def __str__(self) -> str:
        return f"{self.place}: {self.text}"


@dataclass(frozen=True)
class Comparison:
    """The differences of a case; exact : the machines are alike."""

    case: str
    exact: bool
    differences: tuple[Difference, ...]

    @property
    def equal(self) -> bool:
        return not self.differences


def read_record(file: Path) -> dict[str, Any]:
    """A record of a case."""
    return json.loads(file.read_text(encoding="utf-8"))


def compared(base: Mapping[str, Any], head: Mapping[str, Any], base_arrays: Mapping[str, np.ndarray] | None = None,
             head_arrays: Mapping[str, np.ndarray] | None = None) -> Comparison:
    """Compare the record of one version with that of a later one.

    base_arrays, head_arrays : the arrays, where they were kept; a difference then says how large it is
    """
    exact = base["fingerprint"] == head["fingerprint"]
    sums = _inputs(base["inputs"], head["inputs"], exact)
    parts = [*_commands(base["commands"], head["commands"], exact),
             *_documents(base["documents"], head["documents"], exact),
             *_arrays(base["arrays"], head["arrays"], exact, base_arrays or {}, head_arrays or {}),
             *_texts(base["texts"], head["texts"], exact), *_names("files", base["files"], head["files"])]
    return Comparison(base["case"], exact, (*sums, *parts))


# parts ------------------------------------------------------------------------------------------------------
def _inputs(base: Mapping[str, str], head: Mapping[str, str], exact: bool) -> Iterator[Difference]:
    yield from _names("inputs", base, head)
    if exact:
        changed = [name for name in base if name in head and base[name] != head[name]]
        if changed:
            yield Difference("inputs", f"the case, or what makes its input, has changed: {', '.join(changed)}")


def _commands(base: Sequence[Mapping], head: Sequence[Mapping], exact: bool) -> Iterator[Difference]:
    words = [[" ".join(command["words"]) for command in commands] for commands in (base, head)]
    if words[0] != words[1]:
        yield Difference("commands", f"{words[0]} -> {words[1]}")
        return
    for number, (first, second) in enumerate(zip(base, head, strict=True)):
        place = f"command {number} ({' '.join(first['words'][:2])})"
        if first["exit_code"] != second["exit_code"]:
            yield Difference(place, f"exit code {first['exit_code']} -> {second['exit_code']}")
        for name in sorted({*first["counts"], *second["counts"]}):
            counts = first["counts"].get(name, 0), second["counts"].get(name, 0)
            if counts[0] != counts[1]:
                yield Difference(f"{place} {name}", f"{counts[0]} -> {counts[1]}")
        yield from _lines(f"{place} output", first["output"], second["output"], exact)


def _documents(base: Mapping, head: Mapping, exact: bool) -> Iterator[Difference]:
    yield from _names("documents", base, head)
    for name in base:
        if name in head:
            yield from _values(name, base[name], head[name], exact, None, UNITS | _parameter_stds(base))


def _parameter_stds(documents: Mapping) -> dict[str, float]:
    """Standard deviations of the identified parameters: a change far below its own is rounding."""
    parameters = documents.get("run/result.json", {}).get("parameters") or {}
    return {name: entry["std"] for name, entry in parameters.items() if entry.get("std")}


def _arrays(base: Mapping, head: Mapping, exact: bool, base_arrays: Mapping,
            head_arrays: Mapping) -> Iterator[Difference]:
    yield from _names("arrays", base, head)
    for name, first in base.items():
        second = head.get(name)
        if second is None:
            continue
        kinds = [f"{record['dtype']} {tuple(record['shape'])}" for record in (first, second)]
        if kinds[0] != kinds[1]:
            yield Difference(name, f"{kinds[0]} -> {kinds[1]}")
        elif exact and first["sha256"] != second["sha256"]:
            yield Difference(name, _array_difference(first, second, base_arrays.get(name), head_arrays.get(name)))
        elif not exact and not name.endswith(REMAINDERS):
            scale = first.get("largest", 0.0)
            for key in ("largest", "rms"):
                yield from _numbers(f"{name} {key}", first.get(key), second.get(key), STD_TOLERANCE, scale)


def _array_difference(first: Mapping, second: Mapping, base: np.ndarray | None, head: np.ndarray | None) -> str:
    if base is None or head is None:
        return f"other bits; rms {first.get('rms')} -> {second.get('rms')} (record --arrays tells more)"
    if base.dtype.kind not in "fiub":
        return f"{np.count_nonzero(base != head)} of {base.size} entries differ"
    change = np.abs(base.astype(float) - head.astype(float))
    gaps = int(np.count_nonzero(np.isnan(base.astype(float)) != np.isnan(head.astype(float))))
    at = np.unravel_index(int(np.argmax(np.nan_to_num(change))), change.shape)
    place = ", ".join(str(int(index)) for index in at)
    largest = np.nan_to_num(change).max(initial=0.0)
    return (f"largest difference {largest:.3g} at [{place}], of {first.get('largest'):.3g}"
            + (f"; {gaps} more or fewer gaps" if gaps else ""))


def _texts(base: Mapping, head: Mapping, exact: bool) -> Iterator[Difference]:
    yield from _names("texts", base, head)
    for name in base:
        if name in head:
            yield from _lines(name, base[name], head[name], exact)


# values -----------------------------------------------------------------------------------------------------
def _values(place: str, base: Any, head: Any, exact: bool, scale: float | None,
            units: Mapping[str, float]) -> Iterator[Difference]:
    """scale : largest magnitude of the list around a number, or its unit; None: there is none. units : by name."""
    if isinstance(base, dict) and isinstance(head, dict):
        yield from _names(place, base, head)
        for key in base:
            if key in head:
                yield from _values(f"{place} {key}", base[key], head[key], exact,
                                   _unit(key, base, units) or scale, units)
    elif isinstance(base, list) and isinstance(head, list):
        if len(base) != len(head):
            yield Difference(place, f"{len(base)} entries -> {len(head)}")
        scale = _largest(base) if scale is None else scale
        for number, (first, second) in enumerate(zip(base, head, strict=False)):
            yield from _values(f"{place}[{number}]", first, second, exact, scale, units)
    elif not exact and _is_number(base) and _is_number(head):
        tolerance = STD_TOLERANCE if any(word in place for word in STD_PLACES) else VALUE_TOLERANCE
        yield from _numbers(place, base, head, tolerance, scale)
    elif not exact and isinstance(base, str) and isinstance(head, str):
        if without_numbers(base) != without_numbers(head):
            yield Difference(place, f"{base!r} -> {head!r}")
    elif type(base) is not type(head) or not (base == head or _both_nan(base, head)):
        yield Difference(place, f"{base!r} -> {head!r}")


def _unit(key: str, record: Mapping, units: Mapping[str, float]) -> float | None:
    """What a number is measured in; a change that a candidate expects: in its standard deviation."""
    return record.get("expected_change_std") if key == "expected_change" else units.get(key)


def _numbers(place: str, base: float | None, head: float | None, tolerance: float,
             scale: float | None) -> Iterator[Difference]:
    if base is None or head is None or base == head or _both_nan(base, head):
        if (base is None) != (head is None):
            yield Difference(place, f"{base!r} -> {head!r}")
        return
    reach = max(abs(base), abs(head), scale or 0.0, SMALLEST_SCALE)
    if not abs(base - head) <= tolerance * reach:
        yield Difference(place, f"{base!r} -> {head!r} (tolerance {tolerance:g} of {reach:.3g})")


def _lines(place: str, base: Sequence[str], head: Sequence[str], exact: bool) -> Iterator[Difference]:
    if not exact:
        base, head = ([without_numbers(line) for line in lines] for lines in (base, head))
    changed = [line for line in difflib.unified_diff(base, head, lineterm="", n=0)
               if not line.startswith(("---", "+++", "@@"))]
    for line in changed[:MAX_TEXT_LINES]:
        yield Difference(place, line)
    if len(changed) > MAX_TEXT_LINES:
        yield Difference(place, f"{len(changed) - MAX_TEXT_LINES} more lines differ")


def _names(place: str, base: Any, head: Any) -> Iterator[Difference]:
    for names, words in ((set(base) - set(head), "is gone"), (set(head) - set(base), "is new")):
        for name in sorted(names):
            yield Difference(place, f"{name} {words}")


def _largest(values: list) -> float:
    """The largest magnitude in nested lists."""
    magnitudes = [_largest(value) if isinstance(value, list) else abs(value) for value in values
                  if isinstance(value, list) or (_is_number(value) and math.isfinite(value))]
    return max(magnitudes, default=0.0)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _both_nan(base: Any, head: Any) -> bool:
    return isinstance(base, float) and isinstance(head, float) and math.isnan(base) and math.isnan(head)
