"""Values with other treatments of boundary and camera, one row each (`idic systematic`)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from idic.identification import ratios_of
from idic.model import is_mode
from idic.report.result.words import derived_names, number_text, short_names

THE_RUN = "as given"
NOT_DETERMINED = "not determined"


@dataclass(frozen=True)
class TreatmentTable:
    """One row per treatment, the run itself first: boundary, camera, how it ended, and every value in words."""

    quantities: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


def treatment_table(result: Mapping) -> TreatmentTable | None:
    """Every treatment with the parameters and ratios that the run determines; None where none was tried.

    result : content of result.json
    """
    treatments = result.get("treatments")
    if not treatments:
        return None
    of_run = _own(result)
    short = short_names(result["parameters"]) | derived_names(result)
    rows = [(THE_RUN, THE_RUN, result["status"], *(number_text(value, std) for value, std in of_run.values()))]
    for treatment in treatments:
        values = treatment["values"] | ratios_of(result, treatment["values"])
        blank = "–" if treatment["status"] == "failed" else NOT_DETERMINED
        rows.append((*_with_added(treatment), treatment["status"],
                     *(number_text(values[name], std) if name in values else blank
                       for name, (_, std) in of_run.items())))
    return TreatmentTable(tuple(short[name] for name in of_run), tuple(rows))


def _with_added(treatment: Mapping) -> tuple[str, ...]:
    """Boundary and camera of a treatment, with the values of their degrees of freedom."""
    texts: dict[bool, list[str]] = {True: [], False: []}
    for name, entry in treatment.get("added", {}).items():
        value = f"{number_text(entry['value'], entry['std'])} {entry['unit']}" if entry["std"] else NOT_DETERMINED
        texts[name.startswith("boundary.")].append(f"{name.rpartition('.')[2]} {value}".rstrip())
    joined = {key: ", ".join(texts[key == "boundary"]) for key in ("boundary", "camera")}
    return tuple(": ".join((treatment[key], *([text] if text else []))) for key, text in joined.items())


def _own(result: Mapping) -> dict[str, tuple[float, float]]:
    """Value and standard deviation of the run; of parameters found not identifiable afterwards, the former ones."""
    judged = {entry["name"]: entry for entry in result["not_identifiable"] if entry.get("std") is not None}
    values = {}
    for name, entry in (result["parameters"] | result["derived"]).items():
        entry = judged.get(name, entry)
        if entry.get("std") is not None and entry.get("free", True) and not is_mode(name):
            values[name] = (entry["value"], entry["std"])
    return values
