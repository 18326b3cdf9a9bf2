"""Nonlinear hardening: Voce's saturating term on a straight line, with its rate on a grid; a slope or exponent freed.

The amplitude Q of the term enters linearly, so its null is regular; without it the rate b has no meaning and is tried
at values that saturate within a thirtieth to all of the largest plastic strain. What saturates over many cycles is
`cyclic_softening`.
"""

from __future__ import annotations

from idic.diagnose.physics.candidate import Candidate, Situation, Variant, register
from idic.diagnose.physics.enrich import (
    elastic_pair,
    enriched,
    freed,
    materials_with,
    new,
    plastic_strain,
)

SATURATION_RATES = (1.0, 3.0, 10.0, 30.0)  # b times the largest plastic strain
PROBE_STRESS_SHARE = 0.1  # of the yield stress
PROBE_HARDENING_SHARE = 0.02  # of Young's modulus: probe of a hardening modulus that is locked
LAWS_WITH_LINEAR_HARDENING = ("j2_linear", "j2_voce", "j2_pressure", "j2_kinematic", "viscoplastic")


def variants(situation: Situation) -> tuple[Variant, ...]:
    proposals: list[Variant] = []
    for name, law in materials_with(situation, *LAWS_WITH_LINEAR_HARDENING, "j2_power", "j2_power_reference"):
        if law in LAWS_WITH_LINEAR_HARDENING:
            proposals += _slope(situation, name)
        if law == "j2_linear":
            proposals += _voce(situation, name)
        if law in ("j2_power", "j2_power_reference"):
            proposals += _exponent(situation, name)
        if law == "j2_kinematic":
            proposals += _recovery(situation, name)
    return tuple(proposals)


def _voce(situation: Situation, name: str) -> list[Variant]:
    proposals, Q, b = [], f"{name}.Q", f"{name}.b"
    size = PROBE_STRESS_SHARE * situation.values[f"{name}.yield_stress"]
    for saturation in SATURATION_RATES:
        rate = saturation / plastic_strain(situation, name)
        edits = enriched(situation, name, "j2_voce", Q=new(size, "MPa"), b=new(rate))
        proposals.append(Variant(f"{name} hardens with a bend over {1.0 / rate:.2g} of plastic strain", edits, (Q, b),
                                 null={Q: 0.0, b: rate}, probe={Q: size, b: rate}, exact=True))
    return proposals


def _slope(situation: Situation, name: str) -> list[Variant]:
    """A hardening modulus that the file locks."""
    H = f"{name}.hardening_modulus"
    value = situation.values[H]
    probe = value + PROBE_HARDENING_SHARE * elastic_pair(situation, name)[0]
    edits = freed(situation, name, "hardening_modulus")
    return [] if edits is None else [Variant(f"another slope of hardening in {name}", edits, (H,), {H: value},
                                             {H: probe}, exact=True)]


def _exponent(situation: Situation, name: str) -> list[Variant]:
    n = f"{name}.n"
    value = situation.values[n]
    edits = freed(situation, name, "n")
    return [] if edits is None else [Variant(f"another exponent of hardening in {name}", edits, (n,), {n: value},
                                             {n: 1.1 * value}, exact=True)]


def _recovery(situation: Situation, name: str) -> list[Variant]:
    """The back stress saturates: Armstrong and Frederick's term in Prager's law."""
    gamma = f"{name}.gamma"
    value = 1.0 / plastic_strain(situation, name)
    edits = freed(situation, name, "gamma", value) if situation.values[gamma] == 0.0 else None
    return [] if edits is None else [Variant(f"the back stress of {name} saturates", edits, (gamma,), {gamma: 0.0},
                                             {gamma: value}, sign=1, exact=True)]


register(Candidate(
    "hardening_curvature", "plasticity", "nonlinear hardening", "linear hardening (Voce's Q = 0)",
    rivals={"plasticity": "a wrong yield stress curves the onset too",
            "kinematic_hardening": "a back stress that saturates curves the loading curve in the same way",
            "yield_plateau": "a curve that is broken, not bent",
            "cyclic_softening": "an elastic range that changes from cycle to cycle, not within the first loading",
            "rate_dependence": "overstress that changes with the rate of straining"},
    separating_tests=("strain further", "unload and load again at another speed", "reverse the load"),
    variants=variants, has_onset=True,
    paraphrase="nonlinear hardening, another slope or exponent; negative: softening",
    hidden_by_yield_law=True))
