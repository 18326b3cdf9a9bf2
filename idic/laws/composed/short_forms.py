"""Laws with a name of their own that are special cases of ``elastoplastic``: its terms under shorter parameter names.

    j2_linear           yield_stress + hardening_modulus p
    j2_plateau          yield_stress + hardening_modulus max(p - plateau, 0)
    j2_voce             yield_stress + Q (1 - exp(-b p)) + hardening_modulus p
    j2_power            yield_stress + K p^n
    j2_power_reference  yield_stress + K0 (p / ep0)^n, for tests at small strain
    j2_swift            K (eps0 + p)^n
    j2_kinematic        j2_linear with a back stress of Armstrong and Frederick
    j2_chaboche         j2_voce with that back stress: Q < 0 is cyclic softening, Q > 0 cyclic hardening
    j2_hill             j2_voce in Hill's yield condition
    viscoplastic        j2_linear with Norton's overstress
    j2_pressure         j2_linear in Drucker and Prager's yield condition

The compiled code is that of the combination. A parameter that may be left out has the value without its effect.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

from idic.laws.composed.elastoplastic import law_of
from idic.laws.composed.terms import term_of
from idic.laws.core.law import DerivedQuantity, LawSpec, register


@dataclass(frozen=True)
class ShortForm:
    """A name for a combination of terms.

    Attributes
    ----------
    kinds : terms, in the order of their parameters
    names : {parameter of the composed law: that of the short form}; others keep their name
    nulls : {parameter of the short form: value without effect}
    defaults : {parameter of the short form: typical value}, where it is not that of the term
    flow : the flow stress, for ``idic laws``
    derived : {constant: (unit, function)} that follow from the parameters
    """

    kinds: tuple[str, ...]
    names: Mapping[str, str]
    nulls: Mapping[str, float]
    flow: str
    defaults: Mapping[str, float] = field(default_factory=dict)
    derived: Mapping[str, tuple[str, Callable]] = field(default_factory=dict)


def factor_at_one(K0, n, ep0):
    """K of ``j2_power``."""
    return K0 * ep0**-n


def _short_names(group: str, *names: str) -> dict[str, str]:
    return {f"{group}_{name}": name for name in names}


_H1, _H2 = {"hardening_1_H": "hardening_modulus"}, {"hardening_2_H": "hardening_modulus"}
_FLAT = {"hardening_modulus": 0.0}
_VOCE = {"Q": 0.0, "b": 0.0, **_FLAT}

SHORT_FORMS = {
    "j2_linear": ShortForm(("linear",), _H1, _FLAT, "yield_stress + hardening_modulus p"),
    "j2_plateau": ShortForm(("plateau",), _H1 | {"hardening_1_length": "plateau"}, {**_FLAT, "plateau": 0.0},
                            "yield_stress + hardening_modulus max(p - plateau, 0)"),
    "j2_voce": ShortForm(
        ("voce", "linear"), _short_names("hardening_1", "Q", "b") | _H2, _VOCE,
        "yield_stress + Q (1 - exp(-b p)) + hardening_modulus p", {"hardening_modulus": 200.0}),
    "j2_power": ShortForm(("power",), _short_names("hardening_1", "K", "n"), {"K": 0.0}, "yield_stress + K p^n"),
    "j2_power_reference": ShortForm(
        ("power_reference",), _short_names("hardening_1", "K0", "n", "ep0"), {"K0": 0.0},
        "yield_stress + K0 (p / ep0)^n", derived={"K": ("MPa", factor_at_one)}),
    "j2_swift": ShortForm(("swift",), _short_names("hardening_1", "K", "eps0", "n"), {"K": math.inf, "n": 0.0},
                          "K (eps0 + p)^n"),
    "j2_kinematic": ShortForm(
        ("linear", "armstrong_frederick"), _H1 | _short_names("backstress_1", "C", "gamma"),
        {**_FLAT, "C": 0.0, "gamma": 0.0},
        "yield_stress + hardening_modulus p, the size of the elastic range; gamma = 0: Prager, J. Appl. Mech. 23 "
        "(1956) 493", {"hardening_modulus": 500.0}),
    "j2_chaboche": ShortForm(
        ("voce", "linear", "armstrong_frederick"),
        _short_names("hardening_1", "Q", "b") | _H2 | _short_names("backstress_1", "C", "gamma"),
        {**_VOCE, "C": 0.0, "gamma": 0.0},
        "yield_stress + Q (1 - exp(-b p)) + hardening_modulus p, the size of the elastic range: it softens with every "
        "cycle where Q < 0; Chaboche, Int. J. Plast. 2 (1986) 149, doi:10.1016/0749-6419(86)90010-0",
        {"Q": -20.0, "b": 10.0, "hardening_modulus": 0.0}),
    "j2_hill": ShortForm(
        ("voce", "linear", "hill48"),
        _short_names("hardening_1", "Q", "b") | _H2 | _short_names("yield_surface", "r0", "r45", "r90", "angle"), _VOCE,
        "yield_stress + Q (1 - exp(-b p)) + hardening_modulus p along the rolling direction",
        {"hardening_modulus": 200.0}),
    "viscoplastic": ShortForm(
        ("linear", "norton"), _H1 | _short_names("rate", "eta", "m"), {**_FLAT, "eta": 0.0, "m": 1.0},
        "yield_stress + hardening_modulus p + eta (dp/dt)^(1/m); Perzyna, Adv. Appl. Mech. 9 (1966) 243, "
        "doi:10.1016/S0065-2156(08)70009-7"),
    "j2_pressure": ShortForm(
        ("linear", "drucker_prager"), _H1 | _short_names("yield_surface", "friction"), _FLAT,
        "yield_stress + friction pressure + hardening_modulus p"),
}


def short_law(name: str) -> LawSpec:
    """The law of a short form."""
    form = SHORT_FORMS[name]
    terms = [term_of(kind) for kind in form.kinds]
    law = law_of(name, [term for term in terms if term is not None])
    parameters = []
    for p in law.parameters:
        short_name = form.names.get(p.name, p.name)
        parameters.append(replace(p, name=short_name, null=form.nulls.get(short_name, p.null),
                                  default=form.defaults.get(short_name, p.default)))
    return replace(
        law, name=name, parameters=tuple(parameters), compose=None, isotropic=law.isotropic,
        reference=f"elastoplastic({'+'.join(form.kinds)}): sigma = {form.flow}; {law.reference.partition('; ')[2]}",
        derived={key: DerivedQuantity(unit, value) for key, (unit, value) in form.derived.items()})


LAWS = tuple(register(short_law(name)) for name in SHORT_FORMS)
