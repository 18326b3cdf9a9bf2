"""Free curves of experiment.toml as flat parameters, and their stated smoothness.

    hardening = [{ kind = "free", knots = 8, range = 0.2, H = 1000.0 }]

becomes ``free8`` with hardening_1_range and the flow stresses hardening_1_s2 ... hardening_1_s8 at its knots,
identified and starting on the straight line of slope H (MPa); s3 = ... gives one its own value. Of ``law =
"free_rubber"``,

    I1 = { knots = 8, range = 4.0, C10 = 0.3 }
    I2 = { knots = 3, range = 3.0 }

become ``free_rubber(8+3)`` with I1_range and the derivatives I1_g1 ... I1_g8 (MPa) of the energy, identified and
starting as neo-Hooke's law with C10; I2, which may be left out, starts with C01 = 0.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from idic.errors import InputError
from idic.materials.composed.free_curve import bends, even_bends, knots, level_names
from idic.materials.composed.free_rubber import INVARIANTS, NAME, knots_of_rubber
from idic.materials.composed.free_rubber import level_names as rubber_levels
from idic.materials.composed.terms import DEFAULT_KNOTS, KNOTS
from idic.model.experiment import Material
from idic.parameters import Parameter, SmoothnessPrior
from idic.readers.units import factor_between

START_SLOPE = 1000.0  # MPa, of a free hardening curve
LAST_KNOT = 0.2  # plastic strain
START_C10 = 0.3  # MPa
SECOND_SHARE = 0.1  # of the size of g1: bends of g2, which is a small part of the energy of rubbers


def free_hardening(entry: Mapping, yield_stress: object, file: str, key: str) -> tuple[str, dict]:
    """A free curve as the kind with its number of knots and a start value at every knot."""
    n, slope, last = _knots(entry, file, key), entry.get("H", START_SLOPE), entry.get("range", LAST_KNOT)
    for name, value in (("H", slope), ("range", last)):
        if not _is_number(value) or not value > 0:
            raise InputError("a free curve starts on a straight line", file=file, key=f"{key}.{name}",
                             expected="a number above zero" + (" (MPa)" if name == "H" else ""), found=repr(value)[:80],
                             remedy=f"write  {name} = {START_SLOPE if name == 'H' else LAST_KNOT}")
    first = yield_stress if isinstance(yield_stress, Mapping) else {"value": yield_stress}
    start, unit = first.get("value"), first.get("unit")
    if not _is_number(start):
        start, unit = START_SLOPE, None  # the missing yield stress is told with the other parameters
    per_unit = factor_between(unit, "MPa", file=file, key=f"{key}.yield_stress") if isinstance(unit, str) else 1.0
    levels = {f"s{k + 1}": {"value": float(start * per_unit + slope * p), "unit": "MPa", "identify": True}
              for k, p in enumerate(knots(last, n)) if k > 0}
    own = {name: value for name, value in entry.items() if name not in ("knots", "H")}
    return f"free{n}", {"range": last} | levels | own


def free_rubber(table: Mapping, file: str, key: str) -> dict:
    """The table of a free rubber energy as flat parameters; one without tables I1 and I2 as it is.

    Raises
    ------
    InputError
        No I1, an unknown key, or a number of knots, range or start that is none.
    """
    if not any(isinstance(table.get(invariant), Mapping) for invariant in INVARIANTS):
        return dict(table)
    flat: dict = {}
    counts = []
    for invariant, start in zip(INVARIANTS, ("C10", "C01"), strict=True):
        entry = table.get(invariant)
        if entry is None and invariant == INVARIANTS[1]:
            continue
        place = f"{key}.{invariant}"
        if not isinstance(entry, Mapping):
            raise InputError("a free curve is a table", file=file, key=place,
                             expected="{ knots = 8, range = 4.0, C10 = 0.3 }",
                             found=repr(entry)[:80], remedy="write it in { }")
        n = _knots(entry, file, place)
        names = rubber_levels(invariant, n)
        own = {name.partition("_")[2]: name for name in names}
        unknown = [name for name in entry if name not in ("knots", "range", start, *own)]
        if unknown:
            raise InputError("a free curve has no such key", file=file, key=f"{place}.{unknown[0]}",
                             expected=f"knots, range, {start}, g1 ... g{n}", found=unknown[0], remedy="remove it")
        first = entry.get(start, START_C10 if start == "C10" else 0.0)
        if not _is_number(first) or (start == "C10" and not first > 0):
            raise InputError("a free energy starts as neo-Hooke's law", file=file, key=f"{place}.{start}",
                             expected="a number (MPa), C10 above zero", found=repr(first)[:80],
                             remedy=f"write  {start} = {START_C10}")
        if not _is_number(entry.get("range")) or not entry["range"] > 0:
            raise InputError("a free energy needs its range", file=file, key=f"{place}.range",
                             expected=f"{invariant} - 3 at the largest stretch L, in tension "
                             + ("L^2 + 2 / L - 3" if invariant == "I1" else "2 L + 1 / L^2 - 3"),
                             found=repr(entry.get("range"))[:80], remedy="write e.g.  range = 4.0")
        counts.append(n)
        flat[f"{invariant}_range"] = entry["range"]
        flat |= {name: entry.get(short, {"value": float(first), "unit": "MPa", "identify": True})
                 for short, name in own.items()}
    return {k: v for k, v in table.items()
            if k not in INVARIANTS} | {"law": f"{NAME}({'+'.join(map(str, counts))})"} | flat


def _knots(entry: Mapping, file: str, key: str) -> int:
    n = entry.get("knots", DEFAULT_KNOTS)
    if not isinstance(n, int) or isinstance(n, bool) or not KNOTS[0] <= n <= KNOTS[1]:
        raise InputError("a free curve needs its number of knots", file=file, key=f"{key}.knots",
                         expected=f"a whole number, {KNOTS[0]} to {KNOTS[1]}", found=repr(n)[:80],
                         remedy=f"{DEFAULT_KNOTS} suit most materials; more show a sharper bend")
    return n


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def smoothness_priors(materials: Sequence[Material], parameters: Sequence[Parameter]) -> tuple[SmoothnessPrior, ...]:
    """The stated smoothness of every free curve, in units of its start: of the mean slope of a hardening curve, of g1
    of a rubber."""
    values, made = {p.name: p.value for p in parameters}, []
    for material in materials:
        names = level_names(material.law, material.element_set)
        if names:
            rows = bends(values[f"{material.element_set}.hardening_1_range"],
                         np.array([values[name] for name in names]))
            made.append(_prior(names, rows))
        counts = knots_of_rubber(material.law)
        size = values[f"{material.element_set}.I1_g1"] if counts[0] else 0.0
        for invariant, n in zip(INVARIANTS, counts, strict=True):
            if n:
                made.append(_prior([f"{material.element_set}.{name}" for name in rubber_levels(invariant, n)],
                                   even_bends(n, size if invariant == "I1" else SECOND_SHARE * size)))
    return tuple(made)


def _prior(names: Sequence[str], rows: np.ndarray) -> SmoothnessPrior:
    return SmoothnessPrior(tuple(names), tuple(tuple(row) for row in rows.tolist()))
