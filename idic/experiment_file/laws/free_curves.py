"""Free curves of experiment.toml as flat parameters, and their stated smoothness.

    hardening = [{ kind = "free", knots = 8, range = 0.2, H = 1000.0 }]

becomes ``free8`` with hardening_1_range and the flow stresses hardening_1_s2 ... hardening_1_s8 at its knots,
identified and starting on the straight line of slope H (MPa); s3 = ... gives one its own value. Of ``law =
"free_rubber"``,

    I1 = { knots = 8, range = 4.0, C10 = 0.3 }
    I2 = { knots = 3, range = 3.0 }

become ``free_rubber(8+3)`` with I1_range and the derivatives I1_g1 ... I1_g8 (MPa) of the energy, identified and
starting as neo-Hooke's law with C10; I2, which may be left out, starts with C01 = 0. ``knots = "evidence"``, also of a
spectrum's ``times`` and of a yield surface, is the largest number, of which `idic.run.knots` leaves what the
data ask for; ``smoothness`` scales the prior,
``smooth_over = "root"`` states it over the root of the plastic strain.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from idic.errors import InputError
from idic.experiment_file.schema.materials import MaterialTable, SmoothnessTable
from idic.laws import (
    DEFAULT_KNOTS, FREE_RUBBER, INVARIANTS, KNOTS, OVER, RINGS, ROOT, STRAIN, Smoothness, bends, knots,
    knots_of_rubber, level_names, prior_rows, ring_knots_of, rise, rubber_level_names as rubber_levels,
    surface_weights, times_of, weight_names,
)
from idic.model import Material, StatedCurve
from idic.parameters import Parameter, SmoothnessPrior
from idic.readers import factor_between

BY_EVIDENCE = "evidence"  # in the place of a number of knots
SURFACE, SPECTRUM = "yield_surface", "spectrum"  # keys of the smoothness of a free yield surface, a spectrum
NEIGHBOURS = 1.0  # std of the difference of neighbouring weights of a free yield surface, whose mean is 1
SMOOTHNESS_KEYS = ("smoothness", "smooth_over")
START_SLOPE = 1000.0  # MPa, of a free hardening curve
LAST_KNOT = 0.2  # plastic strain
START_C10 = 0.3  # MPa
SMALLEST_WEIGHT = 0.01  # mean weight of a spectrum that starts without relaxation, as its prior sees it
SECOND_SHARE = 0.1  # of the size of g1: bends of g2, which is a small part of the energy of rubbers


def free_hardening(entry: Mapping, yield_stress: object, file: str, key: str) -> tuple[str, dict, dict]:
    """A free curve as the kind with its number of knots, a start value at every knot, and its stated smoothness."""
    n, slope, last_knot = _knots(entry, file, key), entry.get("H", START_SLOPE), entry.get("range", LAST_KNOT)
    for name, value in (("H", slope), ("range", last_knot)):
        if not is_number(value) or not value > 0:
            raise InputError("a free curve starts on a straight line", file=file, key=f"{key}.{name}",
                             expected="a number above zero" + (" (MPa)" if name == "H" else ""), found=repr(value)[:80],
                             remedy=f"write  {name} = {START_SLOPE if name == 'H' else LAST_KNOT}")
    first = yield_stress if isinstance(yield_stress, Mapping) else {"value": yield_stress}
    start, unit = first.get("value"), first.get("unit")
    if not is_number(start):
        start, unit = START_SLOPE, None  # the missing yield stress is told with the other parameters
    per_unit = factor_between(unit, "MPa", file=file, key=f"{key}.yield_stress") if isinstance(unit, str) else 1.0
    levels = {f"s{k + 1}": {"value": float(start * per_unit + slope * p), "unit": "MPa", "identify": True}
              for k, p in enumerate(knots(last_knot, n)) if k > 0}
    entries = {name: value for name, value in entry.items() if name not in ("knots", "H", *SMOOTHNESS_KEYS)}
    return f"free{n}", {"range": last_knot} | levels | entries, stated_smoothness(entry, file, key)


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
    counts, curve_smoothness = [], {}
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
        full_names = {name.partition("_")[2]: name for name in names}
        unknown = [name for name in entry if name not in ("knots", "range", "smoothness", start, *full_names)]
        if unknown:
            raise InputError("a free curve has no such key", file=file, key=f"{place}.{unknown[0]}",
                             expected=f"knots, range, smoothness, {start}, g1 ... g{n}", found=unknown[0],
                             remedy="remove it")
        first = entry.get(start, START_C10 if start == "C10" else 0.0)
        if not is_number(first) or (start == "C10" and not first > 0):
            raise InputError("a free energy starts as neo-Hooke's law", file=file, key=f"{place}.{start}",
                             expected="a number (MPa), C10 above zero", found=repr(first)[:80],
                             remedy=f"write  {start} = {START_C10}")
        if not is_number(entry.get("range")) or not entry["range"] > 0:
            raise InputError("a free energy needs its range", file=file, key=f"{place}.range",
                             expected=f"{invariant} - 3 at the largest stretch L, in tension "
                             + ("L^2 + 2 / L - 3" if invariant == "I1" else "2 L + 1 / L^2 - 3"),
                             found=repr(entry.get("range"))[:80], remedy="write e.g.  range = 4.0")
        counts.append(n)
        curve_smoothness |= {invariant: prior} if (prior := stated_smoothness(entry, file, place)) else {}
        flat[f"{invariant}_range"] = entry["range"]
        flat |= {name: entry.get(short, {"value": float(first), "unit": "MPa", "identify": True})
                 for short, name in full_names.items()}
    flat_table = {k: v for k, v in table.items() if k not in INVARIANTS}
    flat_table |= {"law": f"{FREE_RUBBER}({'+'.join(map(str, counts))})"} | flat
    return flat_table | ({"smoothness": curve_smoothness} if curve_smoothness else {})


def _knots(entry: Mapping, file: str, key: str) -> int:
    n = entry.get("knots", DEFAULT_KNOTS)
    if n == BY_EVIDENCE:
        return KNOTS[1]
    if not isinstance(n, int) or isinstance(n, bool) or not KNOTS[0] <= n <= KNOTS[1]:
        raise InputError("a free curve needs its number of knots", file=file, key=f"{key}.knots",
                         expected=f'a whole number, {KNOTS[0]} to {KNOTS[1]}, or "{BY_EVIDENCE}"', found=repr(n)[:80],
                         remedy=f'{DEFAULT_KNOTS} suit most materials; knots = "{BY_EVIDENCE}" has the data choose')
    return n


def stated_smoothness(entry: Mapping, file: str, key: str) -> dict:
    """The stated smoothness of a curve as the table that `SmoothnessTable` takes; nothing where nothing is stated."""
    strength, over = (entry.get(name) for name in SMOOTHNESS_KEYS)
    if strength is not None and (not is_number(strength) or not strength > 0):
        raise InputError("a smoothness is a size of changes of slope", file=file, key=f"{key}.smoothness",
                         expected="a number above zero; 1: the mean slope of the starting curve",
                         found=repr(strength)[:80], remedy="smaller is smoother; leave it out for 1")
    if over is not None and over not in OVER:
        raise InputError("a free curve is smooth over its strain, or over the root of it", file=file,
                         key=f"{key}.smooth_over", expected=" | ".join(OVER), found=repr(over)[:80],
                         remedy="leave it out")
    table = {} if strength is None else {"strength": float(strength)}
    table |= {} if over is None else {"over": over}
    return table | ({"by_evidence": True} if entry.get("knots") == BY_EVIDENCE else {})


def is_number(value: object) -> bool:
    """Whether a value of the file is a number; true and false are none."""
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def free_curves(materials: Sequence[Material], tables: Mapping[str, MaterialTable],
                parameters: Sequence[Parameter]) -> tuple[StatedCurve, ...]:
    """All free curves of the materials; parameters : where the identification starts."""
    values = {p.name: p.value for p in parameters}
    return tuple(curve for material in materials for curve in _curves(material, tables[material.element_set], values))


def _curves(material: Material, table: MaterialTable, values: Mapping[str, float]) -> Iterator[StatedCurve]:
    def curve(key: str, names: Sequence[str], last_knot: str, size: float, over: tuple[str, ...]) -> StatedCurve:
        smoothness = table.smoothness.get(key, SmoothnessTable())
        return StatedCurve(key, tuple(names), f"{material.element_set}.{last_knot}", smoothness.size or size,
                           Smoothness(smoothness.strength, smoothness.over or over[0]), over, key == "hardening_1",
                           smoothness.by_evidence)

    names = level_names(material.law, material.element_set)
    if names:
        yield curve("hardening_1", names, "hardening_1_range", rise(np.array([values[name] for name in names])), OVER)
    for invariant, n in zip(INVARIANTS, knots_of_rubber(material.law), strict=True):
        if n:
            size = values[f"{material.element_set}.I1_g1"] * (SECOND_SHARE if invariant == INVARIANTS[1] else 1.0)
            yield curve(invariant, [f"{material.element_set}.{name}" for name in rubber_levels(invariant, n)],
                         f"{invariant}_range", size, (ROOT,))
    n = ring_knots_of(material.law)
    if n:
        weights = [f"{material.element_set}.{name}" for name in surface_weights(n)]
        yield curve(SURFACE, weights, "yield_surface_angle", NEIGHBOURS, (STRAIN,))
    n = times_of(material.law)
    if n:
        weights = [f"{material.element_set}.{name}" for name in weight_names(n)]
        mean = max(sum(values[name] for name in weights) / n, SMALLEST_WEIGHT)
        yield curve(SPECTRUM, weights, "longest", (n - 1) * mean, (ROOT,))


def smoothness_priors(curves: Sequence[StatedCurve], parameters: Sequence[Parameter]) -> tuple[SmoothnessPrior, ...]:
    """The stated smoothness of every free curve."""
    values = {p.name: p.value for p in parameters}
    return tuple(SmoothnessPrior(curve.names, tuple(map(tuple, _bends(curve, values).tolist())), curve.rising,
                                 1.0 if curve.key == SURFACE else 0.0) for curve in curves)


def _bends(curve: StatedCurve, values: Mapping[str, float]) -> np.ndarray:
    if curve.key == SURFACE:
        return prior_rows(len(curve.names) // RINGS, curve.size * curve.smoothness.strength)
    return bends(knots(values[curve.last_knot], len(curve.names)), curve.size, curve.smoothness)


def knot_notes(tables: Mapping[str, MaterialTable]) -> list[str]:
    """The knots and the smoothness of every free curve that their evidence selects."""
    return [f"material.{name}.{key}: knots and smoothness by their evidence; ln Z against the best number of knots: "
            + ", ".join(f"{n} {ln_z:+.1f}" for n, ln_z in curve.evidence.items()) + f"; smoothness {curve.strength:g}"
            + (" over the root of the plastic strain" if curve.over == ROOT and key.startswith("hardening") else "")
            for name, table in tables.items() for key, curve in table.smoothness.items() if curve.evidence]
