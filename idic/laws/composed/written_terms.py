"""The terms of a law by name: of a composed law, or of one that is a special case of it.

``terms_of`` is what a law file, a card of another program and the report read a law by: kinds with their values.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from idic.laws.composed.elastoplastic import ELASTOPLASTIC
from idic.laws.free_forms.free_curve import basis, knots_of
from idic.laws.composed.terms import GROUPS, Term, term_of
from idic.laws.core.law import get_law
from idic.laws.composed.short_forms import SHORT_FORMS

TERMS_OF_OTHERS = {  # law: (terms, {parameter of the law: that of the composed one})
    "elastic": ((), {}),
    "orthotropic": (("orthotropic",), {name: f"elasticity_{name}" for name in ("E1", "E2", "nu12", "G12", "angle")}),
    **{name: (form.kinds, {short: composed for composed, short in form.names.items()})
       for name, form in SHORT_FORMS.items()},
}


@dataclass(frozen=True)
class WrittenTerm:
    """A term and its values: those of the term by their own names, and by the names that they have in the law."""

    term: Term
    values: dict[str, float]
    names: dict[str, str]

    @property
    def kind(self) -> str:
        return self.term.kind


def terms_of(law: str, values: Mapping[str, float]) -> tuple[WrittenTerm, ...] | None:
    """The terms of a law with its values by parameter name, in the order of the groups; None of a law that has none."""
    kinds, renamed = TERMS_OF_OTHERS.get(law, (None, {}))
    if law == ELASTOPLASTIC:
        kinds = ()
    elif law.startswith(f"{ELASTOPLASTIC}("):
        kinds = tuple(law[len(ELASTOPLASTIC) + 1:-1].split("+"))
    if kinds is None:
        return None
    in_law = {composed: older for older, composed in renamed.items()}
    written, counted = [], dict.fromkeys(GROUPS, 0)
    terms = [term for kind in kinds if (term := term_of(kind)) is not None]  # all: the law exists
    for term in sorted(terms, key=lambda term: GROUPS.index(term.group)):
        counted[term.group] += 1
        names = {parameter.name: in_law.get(f"{term.stem(counted[term.group])}_{parameter.name}",
                                            f"{term.stem(counted[term.group])}_{parameter.name}")
                 for parameter in term.parameters}
        names = {key: name for key, name in names.items() if name in values}  # one angle may serve two terms
        written.append(WrittenTerm(term, {key: values[name] for key, name in names.items()}, names))
    return tuple(written)


def values_at(law: str, values: Mapping[str, float], temperature: float) -> dict[str, float]:
    """The parameters of a composed law at a temperature (°C); those that do not depend on it as they are."""
    spec, dependence = get_law(law), get_law(law).temperature
    if dependence is None:
        return dict(values)
    params = np.array([values[name] for name in spec.parameter_names])
    return dict(zip(spec.parameter_names, map(float, dependence.values(params, np.array([temperature]))[0]),
                    strict=True))


def flow_stress(law: str, values: Mapping[str, float], p: np.ndarray) -> np.ndarray:
    """Yield stress and isotropic hardening at plastic strain p, slow  # (m,) MPa"""
    p = np.asarray(p, dtype=float)
    total = np.full(len(p), float(values.get("yield_stress", 0.0)))
    for written in terms_of(law, values) or ():
        v = written.values
        if written.kind == "linear":
            total += v["H"] * p
        elif written.kind == "voce":
            total += v["Q"] * (1.0 - np.exp(-v["b"] * p))
        elif written.kind == "plateau":
            total += v["H"] * np.maximum(p - v["length"], 0.0)
        elif written.kind == "power":
            total += v["K"] * p ** v["n"]
        elif written.kind == "power_reference":
            total += v["K0"] * (p / v["ep0"]) ** v["n"]
        elif written.kind == "swift":
            total += v["K"] * (v["eps0"] + p) ** v["n"]
        elif written.kind.startswith("free"):
            n, first = knots_of(law), float(values["yield_stress"])
            levels = np.maximum.accumulate([first, *(v[f"s{k}"] for k in range(2, n + 1))])
            total += basis(p, v["range"], n) @ levels - first
    return total
