"""Viscoplasticity: an overstress eta rate^(1/m) on top of the flow stress.

From plastic the viscosity goes to zero, which is a regular null on the boundary; from elastic the yield stress comes
from infinity and the probe is finite. m is tried at a few values: without viscosity it has no meaning.
"""

from __future__ import annotations

from idic.diagnose.physics.candidate import Candidate, Situation, Variant, register
from idic.diagnose.physics.enrich import (
    elastic_pair,
    enriched,
    has_times,
    locked,
    materials_with,
    new,
    plastic_strain,
    stress_levels,
)

RATE_EXPONENTS = (1.0, 4.0)
STRESS_LEVELS = (0, 4)  # of `Situation.stress`, yield stress of an elastic null
PROBE_OVERSTRESS_SHARE = 0.1  # of the yield stress at the mean rate of the test: the probe of a plastic null
PROBE_OVERSTRESS_SHARE_ELASTIC = 0.3  # the same of an elastic null


def variants(situation: Situation) -> tuple[Variant, ...]:
    if not has_times(situation):
        return ()
    proposals = []
    for name, law in materials_with(situation, "j2_linear", "elastic", "neo_hookean"):
        proposals += _from_plastic(situation, name) if law == "j2_linear" else _from_elastic(situation, name, law)
    return tuple(proposals)


def viscosity(overstress: float, strain: float, duration: float, m: float) -> float:
    """eta (MPa s) that gives this overstress where a strain is made in a time."""
    return overstress * (strain / duration) ** (-1.0 / m)


def _from_plastic(situation: Situation, name: str) -> list[Variant]:
    proposals, eta = [], f"{name}.eta"
    for m in RATE_EXPONENTS:
        size = viscosity(PROBE_OVERSTRESS_SHARE * situation.values[f"{name}.yield_stress"],
                         plastic_strain(situation, name),
                         situation.duration, m)
        edits = enriched(situation, name, "viscoplastic", eta=new(size, "MPa*s"), m=locked(m))
        proposals.append(Variant(f"an overstress in {name}, rate to the 1/{m:g}", edits, (eta,), {eta: 0.0},
                                 {eta: size}, sign=1, exact=True))
    return proposals


def _from_elastic(situation: Situation, name: str, law: str) -> list[Variant]:
    proposals, names = [], (f"{name}.yield_stress", f"{name}.eta")
    strain = situation.strain[name]
    modulus = 0.1 * elastic_pair(situation, name)[0]
    for stress in stress_levels(situation, name, STRESS_LEVELS):
        for m in RATE_EXPONENTS:
            size = viscosity(PROBE_OVERSTRESS_SHARE_ELASTIC * stress, strain, situation.duration, m)
            edits = enriched(situation, name, "viscoplastic", yield_stress=new(stress, "MPa"), eta=new(size, "MPa*s"),
                             m=locked(m), hardening_modulus=new(modulus, "MPa"))
            proposals.append(Variant(f"{name} flows with time beyond {stress:.3g} MPa, rate to the 1/{m:g}", edits,
                                     names, {names[0]: float("inf"), names[1]: 0.0}, {names[0]: stress, names[1]: size},
                                     sign=1, exact=law != "elastic"))
    return proposals


register(Candidate(
    "rate_dependence", "rate", "viscoplasticity", "no viscosity (eta = 0)",
    rivals={"plasticity": "the same where the speed hardly changes",
            "creep": "both continue to flow under a held load",
            "viscoelasticity": "both relax; only this one keeps its strain after unloading",
            "hardening_curvature": "another curve of flow stress over strain"},
    separating_tests=("hold the motion once", "jump to ten times the speed", "unload to zero and wait"),
    variants=variants, has_onset=True, limits=("plasticity",),
    paraphrase="plastic flow with an overstress that depends on the rate"))
