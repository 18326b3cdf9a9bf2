"""Identified laws as files: a table that experiment.toml takes (``from = "sheet.toml"``), and cards of other
programs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from idic.errors import InputError
from idic.experiment_file import StatedCurve, to_toml
from idic.fe import EXTERNAL
from idic.inside import folder_inside, write_inside
from idic.laws import (
    ELASTOPLASTIC, EXPANSION, LISTS, LOCUS_NAME, PRODUCT_SIGN, PROGRAMS, RINGS, WrittenTerm, get_law, material_card,
    terms_of,
)
from idic.model import Model, nodal_temperature
from idic.readers import factor_between
from idic.path_names import path_name
from idic.run.prepared.context import open_run
from idic.run.reporting.write import accepted_parameters
from idic.run.store.result_file import read_result

CARD_TEMPERATURES = 9


@dataclass(frozen=True)
class WrittenLaw:
    """Files of one material, and per program what its card does not say."""

    name: str
    files: tuple[Path, ...]
    missing: dict[str, tuple[str, ...]]


def export_laws(run: Path | str, folder: Path | str) -> tuple[WrittenLaw, ...]:
    """Write every identified law of a RUN: SET.toml, SET.abaqus.inp and SET.calculix.inp.

    Raises
    ------
    InputError
        No result in the RUN, several experiments with laws of their own, or a law of an external solver.
    """
    context, result, folder = open_run(str(run)), read_result(run), Path(folder)
    parameters = accepted_parameters(result, context.experiment.model.parameters)
    materials = [m for m in context.experiment.model.materials if m.law != EXTERNAL]
    if not materials:
        raise InputError("the laws of this RUN belong to another solver", file=run, key="--export",
                         expected="a law of idic", found="[solver]", remedy="take the parameters from its result.json")
    folder_inside(folder)
    written, visited = [], _visited_temperatures(context.experiment.model)
    for material in materials:
        names = [*get_law(material.law).parameter_names, EXPANSION.name]
        values = {name: parameters[f"{material.element_set}.{name}"].value for name in names
                  if f"{material.element_set}.{name}" in parameters}
        stem = path_name(material.element_set)
        curves = [curve for curve in context.experiment.model.free_curves
                  if curve.last_knot.startswith(f"{material.element_set}.")]
        files = [write_inside(folder, f"{stem}.toml", law_table(
            material.element_set, material.law, material.kinematics, values, result, curves))]
        missing = {}
        for program in PROGRAMS:
            card = material_card(material.element_set, material.law, values, program, temperatures=visited)
            files.append(write_inside(folder, f"{stem}.{program}.inp", card.text))
            missing[program] = card.missing
        written.append(WrittenLaw(material.element_set, tuple(files), missing))
    return tuple(written)


def _visited_temperatures(model: Model) -> tuple[float, ...]:
    """Temperatures (°C) over the range of the test, for the tables of cards."""
    field = nodal_temperature(model)
    if field is None:
        return ()
    temperatures = field.start + field.values[model.reference:]
    return tuple(float(T) for T in np.unique(np.linspace(temperatures.min(), temperatures.max(), CARD_TEMPERATURES)))


def law_table(element_set: str, law: str, kinematics: str, values: Mapping[str, float], result: Mapping,
              curves: Sequence[StatedCurve] = ()) -> str:
    """A law with its values as a table of [material.SET], terms as experiment.toml writes them, stds as comments.

    curves : its free curves, whose stated smoothness goes with it: in units of the curve that the test started with
    """
    units = {p.name: p.unit for p in (*get_law(law).parameters, EXPANSION)}
    entries = result["parameters"]
    composed = law.partition("(")[0] == ELASTOPLASTIC
    terms = (terms_of(law, values) or ()) if composed else ()
    in_terms = {name for written in terms for name in written.names.values()}
    table: dict = {"law": ELASTOPLASTIC if composed else law}
    if len(get_law(law).kinematics) > 1:
        table["kinematics"] = kinematics
    table |= {name: _value(value, units[name]) for name, value in values.items() if name not in in_terms}
    for written in terms:
        entry = _term_table(written, units)
        if written.term.group in LISTS:
            table.setdefault(written.term.group, []).append(entry)
        else:
            table[written.term.group] = entry
    if curves:
        table["smoothness"] = {curve.key: {"strength": curve.smoothness.strength, "over": curve.smoothness.over,
                                           "size": float(f"{curve.size:.10g}")} for curve in curves}
    law_entries = {name: entry for name in values if (entry := entries.get(f"{element_set}.{name}"))}
    stds = [f"#   {name} = {values[name]:.6g} ± {_std(entry, units[name]):.2g} {units[name]}".rstrip(" -")
            for name, entry in law_entries.items() if entry.get("std")]
    open_ones = [f"#   {name}: not determined by the test, {_undetermined(entry)}"
                 for name, entry in law_entries.items()
                 if entry.get("free") and entry.get("std") is None]
    head = [f"# The law of {element_set} as it was identified. In experiment.toml:  [material.{element_set}]  "
            f'from = "{element_set}.toml"', "# Identified, with standard deviations (other values were given):",
            *stds, *open_ones]
    return "\n".join(head) + "\n" + to_toml(table)


def _std(entry: Mapping, unit: str) -> float:
    """Standard deviation in the unit of the law, which the values of the file have."""
    entry_unit = entry.get("unit", unit)
    return entry["std"] * (1.0 if entry_unit in (unit, "") else factor_between(entry_unit, unit))


def _undetermined(entry: Mapping) -> str:
    """Which value of it the file has."""
    if entry.get("value_relative") is not None:
        return "its value is valid in ratio to the other undetermined ones only"
    return "its starting value"


def _term_table(written: WrittenTerm, units: Mapping[str, str]) -> dict:
    kind, counts = written.kind, {}
    if LOCUS_NAME.fullmatch(kind):
        counts["knots"], kind = sum(name.startswith("u") for name in written.values) // RINGS, "free_surface"
    elif kind.startswith("free"):
        counts["knots"], kind = sum(name.startswith("s") for name in written.values) + 1, "free"
    kind, *of = kind.split(PRODUCT_SIGN)
    multiplied = {"of": of} if of else {}
    return {"kind": kind, **counts, **multiplied,
            **{key: _value(value, units[written.names[key]]) for key, value in written.values.items()}}


def _value(value: float, unit: str) -> float | dict:
    value = float(f"{value:.10g}")
    return {"value": value, "unit": unit} if unit not in ("-", "") else value
