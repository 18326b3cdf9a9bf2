"""The terms of ``law = "elastoplastic"``: tables and lists of the file as the flat parameters of one composed law.

    hardening = [{ kind = "voce", Q = 80.0, b = { value = 15.0, identify = true } }, { kind = "linear", H = 500.0 }]

becomes ``law = "elastoplastic(voce+linear)"`` with hardening_1_Q, hardening_1_b and hardening_2_H, which is a form that
experiment.toml may have too. `idic.laws.composed` has the terms and their equations. Free curves:
``free_curves.py``, free yield surfaces: ``free_surface.py``. A factor of the temperature,

    temperature = [{ of = "yield_stress", kind = "linear", slope = { value = -1e-3, unit = "1/K", identify = true } }]

becomes ``linear*yield_stress`` with temperature_1_slope; reference_temperature (°C) is a key of the material.
"""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence

import numpy as np

from idic.errors import InputError
from idic.experiment_file.laws.free_curves import free_hardening, free_rubber
from idic.experiment_file.laws.free_surface import KIND as FREE_SURFACE
from idic.experiment_file.laws.free_surface import free_surface
from idic.experiment_file.laws.spectrum import free_relaxation
from idic.laws import (
    ELASTOPLASTIC as COMPOSED, FREE_RELAXATION as RELAXATION, FREE_RUBBER as RUBBER, GROUPS, LISTS, PRODUCT_SIGN,
    composed_name, get_law, kinds_of, term_of,
)
from idic.model import Material
from idic.parameters import Parameter

TURNED_SHARE = 0.02  # of the range of a course: less is noise of the log


def with_flat_terms(raw: Mapping, file: str) -> dict:
    """The tables of an experiment with the terms of its composed laws as flat parameters; others as they are.

    Raises
    ------
    InputError
        A term that is no table, without a kind, of an unknown kind, with an unknown or missing parameter, or terms
        that do not go together.
    """
    materials = raw.get("material")
    if not isinstance(materials, Mapping):
        return dict(raw)
    written = {COMPOSED: _flat, RUBBER: free_rubber, RELAXATION: free_relaxation}
    laws = {name: table.get("law") for name, table in materials.items() if isinstance(table, Mapping)}
    flat_materials = {name: written[laws[name]](table, file, f"material.{name}")
                      if isinstance(laws.get(name), str) and laws[name] in written else table
                      for name, table in materials.items()}
    return {key: flat_materials if key == "material" else value for key, value in raw.items()}


def _flat(table: Mapping, file: str, key: str) -> dict:
    kinds: list[str] = []
    flat: dict = {}
    curve_smoothness: dict = {}
    for group in GROUPS:
        terms = table.get(group, [])
        entries = terms if isinstance(terms, list) else [terms]
        if isinstance(terms, list) and group in table and group not in LISTS:
            raise InputError("not a usable value", file=file, key=f"{key}.{group}",
                             expected=f'{{ kind = "..." }}, one {group}',
                             found="a list", remedy="write one table")
        for number, entry in enumerate(entries, 1):
            place = f"{key}.{group}" + (f"[{number - 1}]" if isinstance(terms, list) else "")
            kind = _kind(entry, group, file, place)
            if kind == "free":
                kind, entry, smoothness = free_hardening(entry, table.get("yield_stress"), file, place)
                curve_smoothness |= {f"hardening_{number}": smoothness} if smoothness else {}
            elif kind == FREE_SURFACE:
                kind, entry, smoothness = free_surface(entry, file, place)
                curve_smoothness |= {group: smoothness} if smoothness else {}
            elif group == "temperature":
                kind, entry = _factor(kind, entry, file, place)
            kinds.append(kind)
            flat |= _parameters(kind, entry, number, file, place)
    try:
        name = get_law(composed_name(kinds)).name
    except InputError as error:
        raise InputError(error.what, file=file, key=f"{key}.{error.key}", expected=error.expected, found=error.found,
                         remedy=error.remedy) from None
    flat |= {"smoothness": curve_smoothness} if curve_smoothness else {}
    return {k: name if k == "law" else v for k, v in table.items() if k not in GROUPS} | flat


def _kind(entry: object, group: str, file: str, key: str) -> str:
    kinds = kinds_of(group)
    if not isinstance(entry, Mapping):
        raise InputError("a term is a table", file=file, key=key, expected=f'{{ kind = "{kinds[0]}", ... }}',
                         found=repr(entry)[:80], remedy="write it in { }")
    kind = entry.get("kind")
    if kind not in kinds:
        matches = difflib.get_close_matches(str(kind), kinds, n=1, cutoff=0.5)
        raise InputError(f"no such {group} term" if "kind" in entry else "a term without its kind", file=file,
                         key=f"{key}.kind", expected=" | ".join(kinds),
                         found=repr(kind) if "kind" in entry else "no such key",
                         remedy=f'did you mean kind = "{matches[0]}"?' if matches else "choose one of these")
    return str(kind)


def _factor(kind: str, entry: Mapping, file: str, key: str) -> tuple[str, dict]:
    """A factor of the temperature as the kind with the parameters that it multiplies, and its other keys."""
    of = entry.get("of")
    names = [of] if isinstance(of, str) else of
    if not isinstance(names, list) or not names or not all(isinstance(name, str) and name for name in names):
        raise InputError("a factor of the temperature without what it multiplies", file=file, key=f"{key}.of",
                         expected='of = "flow_stress", or a list of parameters',
                         found="no such key" if of is None else repr(of)[:80],
                         remedy='write e.g.  of = "yield_stress"')
    return PRODUCT_SIGN.join([kind, *names]), {name: value for name, value in entry.items() if name != "of"}


def course_notes(materials: Sequence[Material], parameters: Sequence[Parameter],
                 courses: Sequence[np.ndarray]) -> list[str]:
    """What the course of a test cannot tell apart in composed laws; courses : logged motions and loads, per frame."""
    if any(_turns_back(np.asarray(course, dtype=float)) for course in courses) or not courses:
        return []
    free_names, notes = [p.name for p in parameters if p.free], []
    for material in materials:
        if not material.law.startswith(COMPOSED):
            continue
        constants = [name.removeprefix(f"{material.element_set}.") for name in free_names
                     if name.startswith(f"{material.element_set}.")]
        groups = {group for group in ("hardening", "backstress", "damage") for name in constants
                  if name.startswith(f"{group}_")}
        if groups >= {"hardening", "backstress"}:
            notes.append(f"material.{material.element_set}: the load never turns back, so isotropic hardening and "
                         "back stress cannot be separated; lock one of them, or reverse the load")
        if groups >= {"hardening", "damage"}:
            notes.append(f"material.{material.element_set}: the load never turns back, so damage and softening of "
                         "the flow stress cannot be separated; lock one of them, or unload once")
    return notes


def _turns_back(course: np.ndarray) -> bool:
    """Whether a course goes back by more than a small part of its range."""
    course = course[np.isfinite(course)]
    size = np.ptp(course) if course.size else 0.0
    down, up = (np.maximum.accumulate(c) - c for c in (course, -course))
    return bool(size > 0.0 and min(down.max(), up.max()) > TURNED_SHARE * size)


def _parameters(kind: str, entry: Mapping, number: int, file: str, key: str) -> dict:
    """The values of one term by the names that they have in the law."""
    term = term_of(kind)
    assert term is not None  # `_kind` looks
    names = [p.name for p in term.parameters]
    unknown = [name for name in entry if name not in (*names, "kind")]
    if unknown:
        matches = difflib.get_close_matches(unknown[0], names, n=1, cutoff=0.5)
        raise InputError(f"{term.kind} has no such parameter", file=file, key=f"{key}.{unknown[0]}",
                         expected=", ".join(names) or "kind only", found=unknown[0],
                         remedy=f"did you mean {matches[0]}?" if matches else "remove it")
    for declared in term.parameters:
        if declared.name not in entry and declared.null is None:
            unit = f', unit = "{declared.unit}"' if declared.unit != "-" else ""
            raise InputError("a parameter of the term is missing", file=file, key=f"{key}.{declared.name}",
                             expected=f"{declared.name} ({declared.description}, {declared.unit})",
                             found=f"only {', '.join(entry)}",
                             remedy=f"add e.g.  {declared.name} = {{ value = {declared.default:g}{unit} }}")
    return {f"{term.stem(number)}_{name}": entry[name] for name in names if name in entry}
