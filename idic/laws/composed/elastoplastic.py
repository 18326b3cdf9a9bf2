"""The composed law: ``elastoplastic`` and, with terms,
``elastoplastic(hill48+voce+linear+armstrong_frederick+norton)``.

Each combination is a separate law, declared and compiled at its first use; its name tells a worker how to make it.
Orthotropic or nonlinear elasticity and in-plane-shear yield take ``anisotropic_return.py``. All others have isotropic
elasticity and the split of ``plasticity/elastoplastic.py`` (Simo 1992; Simo & Hughes, Computational Inelasticity
(1998), doi:10.1007/b98904): with back stress, Hill's surface or damage ``general_return.py``, else
``isotropic_return.py``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from idic.errors import InputError
from idic.laws.composed import anisotropic_return, elasticity, general_return, isotropic_return
from idic.laws.composed.flow_stress import NONE
from idic.laws.composed.terms import (
    FLOW_STRESS, FREE_NAME, GROUPS, KNOTS, LISTS, LOCUS_NAME, REFERENCE, TERMS, PRODUCT_SIGN, Term, kinds_of, term_of)
from idic.laws.core.crack_band import CrackBand
from idic.laws.core.inner import array_maker
from idic.laws.core.law import LawParameter, LawSpec, register
from idic.laws.core.temperature import Factor, TemperatureDependence
from idic.laws.orthotropic import no_plane_body
from idic.laws.plasticity import elastoplastic
from idic.laws.plasticity.free_locus import FREE_LOCUS

ELASTOPLASTIC = "elastoplastic"
MOST_TERMS = 8  # in a list
ONCE = ("linear", "swift", "prager", *kinds_of("nonlinear_elasticity"))  # two of them are one
DEFAULTS = ("isotropic", "mises")  # need no mention in the name
NEED_AXES = ("fibre", "hahn_tsai")
COMPONENTS = ("11", "22", "33", "12", "13", "23")


def composed_name(kinds: Sequence[str]) -> str:
    """The law of these terms, whatever the order of the groups; Mises's surface needs no mention.

    Raises
    ------
    InputError
        An unknown kind, two terms of a group that has one, or terms that do not go together.
    """
    chosen = _chosen(kinds)
    return f"{ELASTOPLASTIC}({'+'.join(term.kind for term in chosen)})" if chosen else ELASTOPLASTIC


def _chosen(kinds: Sequence[str]) -> list[Term]:
    candidates = [term_of(kind) for kind in kinds]
    unknown = [kind for kind, term in zip(kinds, candidates, strict=True) if term is None]
    if unknown:
        raise InputError(f"{ELASTOPLASTIC} has no such term", key="law", expected=f"one of {', '.join(TERMS)}",
                         found=repr(unknown[0]),
                         remedy=f"correct the kind; a free curve has {KNOTS[0]} to {KNOTS[1]} knots")
    terms = sorted((term for term in candidates if term is not None), key=lambda term: GROUPS.index(term.group))
    for group in GROUPS:
        group_kinds = [term.kind for term in terms if term.group == group]
        flexible = [kind for kind in group_kinds if FREE_NAME.fullmatch(kind)]
        if flexible and len(group_kinds) > 1:
            raise InputError(f"{ELASTOPLASTIC}: a free curve is the whole hardening", key=group,
                             expected=f"{flexible[0]} alone",
                             found=" and ".join(group_kinds), remedy="remove the other terms of the list")
        twice = [kind for kind in ONCE if group_kinds.count(kind) > 1]
        if (len(group_kinds) > 1 and group not in LISTS) or twice:
            raise InputError(f"{ELASTOPLASTIC}: two terms where one is enough", key=group,
                             expected=f"one {twice[0]} term"
                             if twice else f"one {group}", found=" and ".join(group_kinds), remedy="remove one of them")
        if len(group_kinds) > MOST_TERMS:
            raise InputError(f"{ELASTOPLASTIC}: too many terms", key=group, expected=f"{MOST_TERMS} at most",
                             found=str(len(group_kinds)), remedy="remove those that the test cannot separate")
    _refuse(terms)
    return [term for term in terms if term.kind not in DEFAULTS]


def _refuse(terms: Sequence[Term]) -> None:
    """Raise where terms do not go together."""
    kinds = [term.kind for term in terms]
    conflicts = [term.kind for term in terms if term.group in ("backstress", "damage")]
    if "drucker_prager" in kinds and conflicts:
        raise InputError(f"{ELASTOPLASTIC}: drucker_prager does not go with {conflicts[0]}, which has no equation "
                         "where tension leaves no strength", key="yield_surface",
                         expected="mises or hill48 with a back stress or damage", found="drucker_prager",
                         remedy=f"remove {conflicts[0]}, or take mises or hill48")
    conflicts = [kind for kind in kinds if kind == "orthotropic" or kind in kinds_of("nonlinear_elasticity")]
    if "drucker_prager" in kinds and conflicts:
        raise InputError(f"{ELASTOPLASTIC}: drucker_prager does not go with {conflicts[0]}: the pressure would change "
                         "with the flow",
                         key="yield_surface", expected="mises, hill48 or in_plane_shear", found="drucker_prager",
                         remedy=f"remove {conflicts[0]}, or take another yield surface")
    surface = next((kind for kind in kinds if LOCUS_NAME.fullmatch(kind)), None)
    conflicts = [kind for kind in kinds if kind == "orthotropic" or kind in kinds_of("nonlinear_elasticity")]
    if surface is not None and conflicts:
        raise InputError(f"{ELASTOPLASTIC}: a free yield surface does not go with {conflicts[0]}", key="yield_surface",
                         expected="isotropic elasticity, or hill48", found=surface,
                         remedy=f"remove {conflicts[0]}, or take hill48")
    along = [kind for kind in kinds if kind in NEED_AXES]
    if along and "orthotropic" not in kinds:
        raise InputError(f"{ELASTOPLASTIC}: {along[0]} needs material axes", key="nonlinear_elasticity",
                         expected='elasticity = { kind = "orthotropic", ... }', found="isotropic elasticity",
                         remedy="make the elasticity orthotropic, or take stiffening or ramberg_osgood")


def compose(kinds: Sequence[str]) -> LawSpec:
    """The law of these terms; raises as `composed_name`."""
    return law_of(composed_name(kinds), _chosen(kinds))


def law_of(name: str, terms: Sequence[Term]) -> LawSpec:
    """The law of terms that go together, its parameters in their order; the elasticity comes first."""
    orthotropic = any(term.kind == "orthotropic" for term in terms)
    parameters: list[LawParameter] = list(elastoplastic.PARAMETERS)
    codes: dict[str, tuple[int, ...]] = dict.fromkeys(GROUPS, ())
    equations, states = [], list(elastoplastic.STATE_NAMES)
    for number, term in enumerate([term for term in terms if term.group == "hardening"], 1):
        if term.kind == "swift":  # in the place of the yield stress
            parameters = [*parameters[:-1], *term.named(number)]
    for term in terms:
        number = len(codes[term.group]) // 2 + 1
        term_parameters = term.named(number)
        if term.kind == "orthotropic":
            parameters = [*term_parameters, *parameters[2:]]
        elif term.kind == "swift":
            codes[term.group] += (term.code, parameters.index(term_parameters[0]))
        else:  # one set of axes: those of the elasticity where it has some
            codes[term.group] += (term.code, len(parameters))
            parameters += [p for p in term_parameters if not (orthotropic and p.name == "yield_surface_angle")]
        equations.append(f"{term.group} {term.kind}: {term.equation}")
        if term.group == "backstress":
            states += [f"back{number}_{c}" for c in COMPONENTS]
    if codes["damage"]:
        states.append("damage")
    dependence = _dependence([term for term in terms if term.group == "temperature"], codes["temperature"], parameters)
    if dependence is not None:
        parameters.append(REFERENCE)
    updates, linearise, tangent = _functions(codes, orthotropic)
    return LawSpec(
        name=name, parameters=tuple(parameters), updates={"finite": updates},
        linearise={} if linearise is None else {"finite": linearise},
        tangents={} if tangent is None else {"finite": tangent}, state_names=tuple(states),
        isotropic=not orthotropic and all(term.kind in ("mises", "drucker_prager") for term in terms
                                          if term.group == "yield_surface"),
        reference="; ".join(["q = yield_stress + hardening, p the plastic strain", *equations,
                             "return: Simo (1992), doi:10.1016/0045-7825(92)90123-2; Simo & Hughes (1998), "
                             "doi:10.1007/b98904"]),
        alternatives={} if orthotropic else elastoplastic.ALTERNATIVES, compose=compose, temperature=dependence,
        crack_band=CrackBand("damage_length") if codes["damage"] else None,
        impossible=no_plane_body if orthotropic else None)


def _dependence(terms: Sequence[Term], codes: tuple[int, ...],
                parameters: Sequence[LawParameter]) -> TemperatureDependence | None:
    """Dependence of the parameters on the temperature by its terms; the reference temperature follows them in the
    order.

    Raises
    ------
    InputError
        A factor on a name that is not a parameter of the other terms.
    """
    names = [p.name for p in parameters]
    stresses = [p.name for p in parameters if p.unit == "MPa" and p.name.startswith(("yield_stress", "hardening_"))]
    allowed = [p.name for p in parameters if not p.name.startswith("temperature_") and p.unit != "deg"]
    factors = []
    for term, kind, first in zip(terms, codes[::2], codes[1::2], strict=True):
        targets = term.kind.split(PRODUCT_SIGN)[1:]
        targets = [name for target in targets for name in (stresses if target == FLOW_STRESS else [target])]
        unknown = [name for name in targets if name not in allowed]
        if unknown or len({*targets}) < len(targets):
            raise InputError(f"{ELASTOPLASTIC}: a factor of the temperature acts on parameters of the other terms",
                             key="temperature",
                             expected=f"{FLOW_STRESS}, or some of {', '.join(allowed)}",
                             found=repr((unknown or targets)[0]),
                             remedy="correct `of`, and name each parameter once")
        factors.append(Factor(kind, first, tuple(names.index(name) for name in targets)))
    return TemperatureDependence(tuple(factors), len(parameters)) if factors else None


def _functions(codes: dict[str, tuple[int, ...]],
               orthotropic: bool) -> tuple[Callable, Callable | None, Callable | None]:
    """(update, linearise or None, tangent or None) of a combination: closures over integers, which numba's disk cache
    tells apart.

    Without a rate term they read no time, so the law counts as rate-independent.
    """
    surface = codes["yield_surface"] or (isotropic_return.MISES, 0)
    hardening, rate = (*codes["hardening"], NONE, 0), codes["rate"] or (NONE, 0)
    if orthotropic or codes["nonlinear_elasticity"] or surface[0] == isotropic_return.IN_PLANE_SHEAR:
        return _anisotropic(codes, orthotropic, surface[0], hardening, rate), None, None
    round_ones = (isotropic_return.MISES, isotropic_return.DRUCKER_PRAGER)
    if surface[0] in round_ones and not codes["backstress"] and not codes["damage"]:
        return _isotropic(surface, hardening, rate)
    back, damage = (*codes["backstress"], NONE, 0), codes["damage"][1] if codes["damage"] else 0
    if surface[0] >= FREE_LOCUS:
        surface = (*surface, surface[0] - FREE_LOCUS)

    def update(F, state, params, dt, P, state_new):
        return general_return.update(surface, hardening, back, rate, damage, F, state, params, dt, P, state_new)

    def update_without_rate(F, state, params, dt, P, state_new):
        return general_return.update(surface, hardening, back, rate, damage, F, state, params, 1.0, P, state_new)

    def tangent(F, state, params, dt, P, state_new, A, work):
        return general_return.tangent(surface, hardening, back, rate, damage, F, state, params, dt, P, state_new, A,
                                      work)

    def tangent_without_rate(F, state, params, dt, P, state_new, A, work):
        return general_return.tangent(surface, hardening, back, rate, damage, F, state, params, 1.0, P, state_new, A,
                                      work)

    return (update, None, tangent) if codes["rate"] else (update_without_rate, None, tangent_without_rate)


def _anisotropic(codes: dict[str, tuple[int, ...]], orthotropic: bool, surface: int, hardening: tuple[int, ...],
                 rate: tuple[int, ...]) -> Callable:
    """Update of a combination; E1, E2, nu12 stand before what its other terms count as places 0, 1, ..."""
    shift = 3 if orthotropic else 0
    elastic = (elasticity.ORTHOTROPIC if orthotropic else elasticity.ISOTROPIC, *codes["nonlinear_elasticity"], NONE, 0)
    axes = 4 if orthotropic else -1
    if not orthotropic and codes["yield_surface"]:
        axes = codes["yield_surface"][1] + (3 if surface == isotropic_return.HILL48 else 0)
    hill = codes["yield_surface"][1] - shift if surface == isotropic_return.HILL48 else 0
    back = _moved((*codes["backstress"], NONE, 0), shift)
    hardening, rate = _moved(hardening, shift), _moved(rate, shift)
    damage = codes["damage"][1] - shift if codes["damage"] else 0

    @array_maker
    def update(F, state, params, dt, P, state_new):
        return anisotropic_return.update(elastic, shift, axes, surface, hill, hardening, back, rate, damage, F, state,
                                         params, dt, P, state_new)

    @array_maker
    def update_without_rate(F, state, params, dt, P, state_new):
        return anisotropic_return.update(elastic, shift, axes, surface, hill, hardening, back, rate, damage, F, state,
                                         params, 1.0, P, state_new)

    return update if codes["rate"] else update_without_rate


def _moved(codes: tuple[int, ...], shift: int) -> tuple[int, ...]:
    """Terms whose places count from `shift` on; the last term is none."""
    return tuple(code - shift if i % 2 and i < len(codes) - 1 else code for i, code in enumerate(codes))


def _isotropic(surface: tuple[int, ...], hardening: tuple[int, ...],
               rate: tuple[int, ...]) -> tuple[Callable, Callable, Callable]:
    def update(F, state, params, dt, P, state_new):
        return isotropic_return.update(surface, hardening, rate, F, state, params, dt, P, state_new)

    def linearise(F, state, params, dt, dF, dstate, dparams, P, state_new, dP, dstate_new):
        return isotropic_return.linearise(surface, hardening, rate, F, state, params, dt, dF, dstate, dparams, P,
                                          state_new, dP, dstate_new)

    def update_without_rate(F, state, params, dt, P, state_new):
        return isotropic_return.update(surface, hardening, rate, F, state, params, 1.0, P, state_new)

    def linearise_without_rate(F, state, params, dt, dF, dstate, dparams, P, state_new, dP, dstate_new):
        return isotropic_return.linearise(surface, hardening, rate, F, state, params, 1.0, dF, dstate, dparams, P,
                                          state_new, dP, dstate_new)

    def tangent(F, state, params, dt, P, state_new, A, work):
        return isotropic_return.tangent(surface, hardening, rate, F, state, params, dt, P, state_new, A)

    def tangent_without_rate(F, state, params, dt, P, state_new, A, work):
        return isotropic_return.tangent(surface, hardening, rate, F, state, params, 1.0, P, state_new, A)

    if rate[0] != NONE:
        return update, linearise, tangent
    return update_without_rate, linearise_without_rate, tangent_without_rate


LAW = register(compose(()))
