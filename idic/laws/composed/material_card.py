"""A law as a material card of Abaqus or CalculiX: *ELASTIC, *PLASTIC and what goes with them.

Units are mm, N, MPa, s. Terms without a card in a program are listed in `Card.missing`; nothing is replaced silently.
idic's flow stress is the Kirchhoff stress, that of both programs the Cauchy stress: they differ by the change of
volume, (1 - 2 nu) stress / E.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from idic.laws.free_forms.free_curve import knots, knots_of
from idic.laws.composed.rubber_card import rubber_card
from idic.laws.composed.written_terms import WrittenTerm, flow_stress, terms_of, values_at
from idic.laws.core.law import EXPANSION
from idic.laws.orthotropic import contraction_through_thickness
from idic.laws.rate.free_relaxation import spectrum
from idic.laws.free_forms.relaxation_forms import relaxation_card

PROGRAMS = ("abaqus", "calculix")
ROWS = 40  # of a table of the flow stress, dense at the beginning
COMPARED_STRAIN = 1.0  # plastic strain at the end of a table of a law without a range of its own


Warm = Sequence[tuple[float, Mapping[str, float]]]  # temperatures (°C) with the values there


@dataclass(frozen=True)
class Card:
    """Text of a card, and the terms that it does not contain."""

    text: str
    missing: tuple[str, ...]


def material_card(name: str, law: str, values: Mapping[str, float], program: str, reached: float | None = None,
                  temperatures: Sequence[float] = ()) -> Card:
    """The card of a law.

    Parameters
    ----------
    values : {parameter: value} MPa, -, deg, s
    program : "abaqus" | "calculix"
    reached : plastic strain at the end of the table of the flow stress; default: the last knot, or 1
    temperatures : °C, increasing, of the tables of a law whose parameters depend on it; between them the programs
    interpolate
        linearly
    """
    rubber = rubber_card(law, values)
    if rubber is not None:
        lines, missing = rubber
        head = [f"** {law}, units mm, N, MPa", *(f"** NOT IN THIS CARD: {gap}" for gap in missing)]
        return Card("\n".join([*head, f"*MATERIAL, NAME={name}", *lines, *_expansion(values)]) + "\n", tuple(missing))
    branches = spectrum(law, values)
    if branches is not None:
        lines, missing = relaxation_card(branches, values, program)
        head = [f"** {law}, units mm, N, MPa, s", *(f"** NOT IN THIS CARD: {gap}" for gap in missing)]
        return Card("\n".join([*head, f"*MATERIAL, NAME={name}", *lines, *_expansion(values)]) + "\n", tuple(missing))
    terms = terms_of(law, values)
    if terms is None:
        return Card(f"*MATERIAL, NAME={name}\n", (f"law {law}: neither program has such a law",))
    by_group: dict[str, list[WrittenTerm]] = {}
    for written in terms:
        by_group.setdefault(written.term.group, []).append(written)
    factors = by_group.get("temperature", [])
    tabled = bool(factors) and not {"backstress", "elasticity"} & {*by_group} and len(temperatures) > 0
    at = [(T, values_at(law, values, T)) for T in temperatures] if tabled else []
    preamble, lines, missing = _elastic(name, by_group, values, at)
    start = float(flow_stress(law, values, np.zeros(1))[0])
    if ("yield_stress" in values or any(w.kind == "swift" for w in terms)) and math.isfinite(start):
        more, lacking = _plastic(law, by_group, values, start, program, reached, at)
        lines, missing = lines + more, missing + lacking
    if factors and not tabled:
        missing.append(f"temperature: the values are those at {values['reference_temperature']:g} °C")
    lines = lines + _expansion(values)
    head = [f"** {line}".replace("°C", "deg C")  # a solver may read plain letters only
            for line in (f"{law}, units mm, N, MPa, s; Kirchhoff flow stress read as Cauchy stress",
                         *(f"NOT IN THIS CARD: {gap}" for gap in missing))]
    return Card("\n".join([*head, *preamble, f"*MATERIAL, NAME={name}", *lines]) + "\n", tuple(missing))


def _expansion(values: Mapping[str, float]) -> list[str]:
    return ["*EXPANSION", _row(values[EXPANSION.name])] if values.get(EXPANSION.name) else []


def _row(*numbers: float) -> str:
    return ", ".join(f"{number:.8g}" for number in numbers)


def _elastic(name: str, groups: Mapping[str, list[WrittenTerm]], values: Mapping[str, float],
             at: Warm) -> tuple[list[str], list[str], list[str]]:
    """(lines before *MATERIAL, lines, missing)"""
    missing = [f"nonlinear elasticity {w.kind}: reversible, no card of a plastic material has it"
               for w in groups.get("nonlinear_elasticity", [])]
    orthotropic = [w for w in groups.get("elasticity", []) if w.kind == "orthotropic"]
    if not orthotropic:
        rows = [_row(v["E"], v["nu"], T) for T, v in at] or [_row(values["E"], values["nu"])]
        return [], ["*ELASTIC", *rows], missing
    v = orthotropic[0].values
    E1, E2, nu12, G12 = v["E1"], v["E2"], v["nu12"], v["G12"]
    angle, preamble = math.radians(v.get("angle", 0.0)), []
    if angle:
        preamble = [f"** *SOLID SECTION, ..., ORIENTATION={name}",
                    f"*ORIENTATION, NAME={name}, SYSTEM=RECTANGULAR",
                    _row(math.cos(angle), math.sin(angle), 0.0, -math.sin(angle), math.cos(angle), 0.0)]
    # closed as idic's law
    across = float(contraction_through_thickness.py_func(E1, E2, nu12))  # type: ignore[attr-defined]
    shear = 0.5 * E2 / (1.0 + across)
    return preamble, ["*ELASTIC, TYPE=ENGINEERING CONSTANTS", _row(E1, E2, E2, nu12, across, across, G12, G12),
                      _row(shear)], missing


def _plastic(law: str, groups: Mapping[str, list[WrittenTerm]], values: Mapping[str, float], start: float,
             program: str, reached: float | None, at: Warm) -> tuple[list[str], list[str]]:
    missing = [f"{w.term.group} {w.kind}: no card has this equation" for group in ("rate", "damage")
               for w in groups.get(group, [])]
    free_terms = [w for w in groups.get("hardening", []) if w.kind.startswith("free")]
    end = reached or (free_terms[0].values["range"] if free_terms else COMPARED_STRAIN)
    p = end * np.linspace(0.0, 1.0, ROWS) ** 2
    if free_terms:  # straight between its knots
        p = np.append(knot_strains := knots(free_terms[0].values["range"], knots_of(law)),
                      max(end, 2.0 * knot_strains[-1]))
    table = [_row(stress, strain) for stress, strain in zip(flow_stress(law, values, p), p, strict=True)]
    if at:
        table = [_row(stress, strain, T) for T, v in at
                 for stress, strain in zip(flow_stress(law, v, p), p, strict=True)]
    lines, lacking = _hardening(groups.get("backstress", []), bool(groups.get("hardening")), start, p, table, program)
    missing += lacking
    for surface in groups.get("yield_surface", []):
        more, lacking = _surface(surface, program)
        lines, missing = lines + more, missing + lacking
    return lines, missing


def _hardening(back: list[WrittenTerm], isotropic: bool, start: float, p: np.ndarray, table: list[str],
               program: str) -> tuple[list[str], list[str]]:
    """*PLASTIC with its tables, and the terms without a card."""
    if not back:
        return ["*PLASTIC", *table], []
    straight = sum(w.values["C"] for w in back if w.kind == "prager")
    curved = [w for w in back if w.kind == "armstrong_frederick"]
    if program == "abaqus":
        terms = [x for w in back for x in (w.values["C"], w.values.get("gamma", 0.0))]
        lines = [f"*PLASTIC, HARDENING=COMBINED, DATA TYPE=PARAMETERS, NUMBER BACKSTRESSES={len(back)}",
                 _row(start, *terms)]
        return lines + (["*CYCLIC HARDENING", *table] if isotropic else []), []
    if curved:
        return ["*PLASTIC",
                *table], [f"backstress {w.kind}: CalculiX hardens kinematically by a table, without recovery; "
                                      "left out, so this body hardens too little" for w in curved]
    line = [_row(start + straight * strain, strain) for strain in (0.0, p[-1])]
    if not isotropic:
        return ["*PLASTIC, HARDENING=KINEMATIC", *line], []
    return ["*PLASTIC, HARDENING=COMBINED", *line, "*CYCLIC HARDENING", *table], []


def _surface(written: WrittenTerm, program: str) -> tuple[list[str], list[str]]:
    if written.kind != "hill48":
        return [], [f"yield_surface {written.kind}: this card yields by Mises"]
    if program == "calculix":
        return [], ["yield_surface hill48: CalculiX yields by Mises"]
    r0, r45, r90 = (written.values[name] for name in ("r0", "r45", "r90"))
    g = 1.0 / (1.0 + r0)
    h = r0 * g
    f, n = h / r90, 0.5 * (r0 + r90) * (1.0 + 2.0 * r45) * g / r90
    ratios = (1.0, (g + h) / (f + h), (g + h) / (f + g), 3.0 / (2.0 * n), 1.0, 1.0)
    note = [f"yield_surface hill48 at {written.values['angle']:g} deg: set *ORIENTATION to that angle"] \
        if written.values.get("angle") else []
    return ["*POTENTIAL", _row(*np.sqrt(ratios))], note
