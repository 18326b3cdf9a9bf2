"""Kinematic hardening: a back stress in addition to isotropic hardening.

While the load only grows both are the same: without reverse yield somewhere in the body the column is a multiple of
the hardening modulus, and its visibility says so.
"""

from __future__ import annotations

from idic.diagnose.physics.candidate import Candidate, Situation, Variant, register
from idic.diagnose.physics.enrich import (
    elastic_pair,
    enriched,
    locked,
    materials_with,
    new,
    plastic_strain,
)

MIN_PROBE_MODULUS_SHARE = 0.02  # of Young's modulus: the probe where the identified hardening is smaller
RECOVERY_RATES = (3.0, 10.0, 30.0)  # rate of recovery of the other variants times the largest plastic strain
MIN_BACK_STRESS_SHARE = 0.1  # of the yield stress: saturation of the back stress of these, at least


def variants(situation: Situation) -> tuple[Variant, ...]:
    proposals = []
    for name, _ in materials_with(situation, "j2_linear"):
        C, gamma = f"{name}.C", f"{name}.gamma"
        modulus = max(abs(situation.values[f"{name}.hardening_modulus"]),
                      MIN_PROBE_MODULUS_SHARE * elastic_pair(situation, name)[0])
        straight = enriched(situation, name, "j2_kinematic", C=new(modulus, "MPa"), gamma=locked(0.0))
        proposals.append(Variant(f"a back stress in {name}", straight, (C,), {C: 0.0}, {C: modulus}, sign=1,
                                 exact=True))
        for saturation in RECOVERY_RATES:
            recovery = saturation / plastic_strain(situation, name)
            size = max(modulus, MIN_BACK_STRESS_SHARE * situation.values[f"{name}.yield_stress"] * recovery)
            bent = enriched(situation, name, "j2_kinematic", C=new(size, "MPa"), gamma=new(recovery))
            label = f"a back stress in {name} that saturates over {1.0 / recovery:.2g} of plastic strain"
            proposals.append(Variant(label, bent, (C, gamma), {C: 0.0, gamma: recovery}, {C: size, gamma: recovery},
                                     sign=1, exact=True))
    return tuple(proposals)


register(Candidate(
    "kinematic_hardening", "plasticity", "kinematic hardening", "no back stress (C = 0)",
    rivals={"hardening_curvature": "the same under a load that only grows",
            "pressure_dependence": "both make tension and compression differ",
            "plasticity": "an isotropic hardening of another slope: the same without reverse yield"},
    separating_tests=("reverse the load until it yields again", "unload far enough for reverse yield at the notch"),
    variants=variants, has_onset=True, shows_at_reversal=True,
    paraphrase="a back stress that moves the yield surface", hidden_by_yield_law=True))
