"""Plasticity of a model that is elastic: J2 flow with a yield stress on a grid.

At an infinite yield stress every derivative is zero, so the probe is finite: each level is a quantile of the largest
stress that the points of the body reach, and the tangent after yield is a tenth of the elastic one.
"""

from __future__ import annotations

from idic.diagnose.physics.candidate import Candidate, Situation, Variant, register
from idic.diagnose.physics.enrich import (
    elastic_pair,
    enriched,
    materials_with,
    new,
    stress_levels,
)

STRESS_LEVELS = (0, 2, 4, 5, 6)  # of `Situation.stress`
PROBE_MODULUS_RATIO = 10.0  # elastic modulus over hardening modulus of the probe


def variants(situation: Situation) -> tuple[Variant, ...]:
    proposals = []
    for name, law in materials_with(situation, "elastic", "neo_hookean"):
        modulus = elastic_pair(situation, name)[0] / PROBE_MODULUS_RATIO
        names = (f"{name}.yield_stress", f"{name}.hardening_modulus")
        for stress in stress_levels(situation, name, STRESS_LEVELS):
            edits = enriched(situation, name, "j2_linear", yield_stress=new(stress, "MPa"),
                             hardening_modulus=new(modulus, "MPa"))
            proposals.append(Variant(f"{name} yields at {stress:.3g} MPa", edits, names,
                                     null={names[0]: float("inf"), names[1]: 0.0},
                                     probe={names[0]: stress, names[1]: modulus}, sign=1,
                                     exact=law != "elastic"))
    return tuple(proposals)


register(Candidate(
    "plasticity", "plasticity", "plasticity", "an infinite yield stress",
    rivals={"damage": "both soften under load: only unloading tells them apart",
            "heterogeneity": "a soft spot where stress is high",
            "viscoelasticity": "both leave strain behind after unloading",
            "creep": "both leave strain behind; only creep continues while the load is held"},
    separating_tests=("unload to zero once", "hold the load", "reverse the load"),
    variants=variants, has_onset=True,
    paraphrase="J2 flow beyond a yield stress"))
