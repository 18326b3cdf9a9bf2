"""Thermal expansion: by the log where it has one, else by a course that is only supposed.

Without a record of the temperature only the product alpha dT can be found: the supposed courses rise by 1 K over the
test, evenly or as warming-up does, and alpha then stands for the product.
"""

from __future__ import annotations

import copy
from typing import Any

import numpy as np

from idic.diagnose.physics.candidate import Candidate, Situation, Variant, register
from idic.laws import EXPANSION
from idic.parameters import PlausibleSize

PROBE_EXPANSION_PER_K = 1e-5  # 1/K where the temperature is known
PROBE_STRAIN = 1e-4  # over the test where it is not
WARM_UP_TIMES_PER_TEST = 5.0  # times that fit into the test, of the course that levels off
N_COURSE_POINTS = 9  # of that course


def variants(situation: Situation) -> tuple[Variant, ...]:
    names = [material.element_set for material in situation.experiment.model.materials
             if f"{material.element_set}.{EXPANSION.name}" not in situation.experiment.model.parameters.free]
    if not names:
        return ()
    if situation.experiment.model.temperatures:
        return tuple(_variant(situation, name, f"{name} expands with the temperature of the file", None,
                              PROBE_EXPANSION_PER_K)
                     for name in names)
    proposals = []
    for label, table in _temperatures(situation):
        size = PROBE_EXPANSION_PER_K if "column" in table else PROBE_STRAIN
        proposals += [_variant(situation, name, f"{name} expands {label}", table, size) for name in names]
    return tuple(proposals)


def _temperatures(situation: Situation) -> list[tuple[str, dict[str, Any]]]:
    """Columns of the log that are temperatures; without any, courses that are supposed."""
    columns = [name for name in situation.experiment.recording.column_units if is_temperature(name)]
    if columns:
        return [(f"with {column}", {"column": column}) for column in columns]
    start, end = (float(situation.experiment.model.times[k]) for k in (situation.experiment.model.reference, -1))
    share = np.linspace(0.0, 1.0, N_COURSE_POINTS)
    levels = (1.0 - np.exp(-WARM_UP_TIMES_PER_TEST * share)) / (1.0 - np.exp(-WARM_UP_TIMES_PER_TEST))
    warming = [[start + s * (end - start), float(level)] for s, level in zip(share, levels, strict=True)]
    return [("evenly with time", {"course": [[start, 0.0], [end, 1.0]]}),
            ("as if warming up", {"course": warming})]


def is_temperature(column: str) -> bool:
    """Whether a column of the log is a temperature, by its name."""
    return "temp" in column.lower() or column.endswith(("_C", "_degC", "_K"))


def _variant(situation: Situation, name: str, label: str, temperature: dict[str, Any] | None,
             size: float) -> Variant:
    alpha = f"{name}.{EXPANSION.name}"
    edits: dict[str, Any] = {f"material.{alpha}": {"value": size, "unit": EXPANSION.unit, "identify": True}}
    if temperature is not None:
        tables = copy.deepcopy(list(situation.document.get("boundary", ())))
        edits["boundary"] = [*tables, {"temperature": temperature}]
    value = situation.values.get(alpha, 0.0)
    return Variant(label, edits, (alpha,), {alpha: value}, {alpha: value + size}, exact=True)


register(Candidate(
    "thermal_expansion", "environment", "thermal expansion", "no expansion (alpha dT = 0)",
    rivals={"magnification": "the same field in the image: only a force between the grips separates them",
            "force_drift": "a warming specimen between grips loses force",
            "viscoelasticity": "a force that falls while the motion is held",
            "creep": "a strain that grows with time",
            "poisson_ratio": "the same strain in both directions"},
    separating_tests=("log the temperature of the specimen",
                      "record still frames at zero load for as long as the test"),
    variants=variants,
    paraphrase="strain that follows the temperature",
    size=PlausibleSize(1e-4, "a strain of 1e-4", "an estimate: 2 K in a laboratory at 5e-5 per K", in_probes=False)))
