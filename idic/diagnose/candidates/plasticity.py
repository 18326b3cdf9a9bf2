"""Plastic flow in a model that is elastic: J2 flow with a yield stress on a grid.

At an infinite yield stress every derivative is zero, so the probe is finite: each level is a quantile of the largest
stress that the points of the body reach, and the tangent after yield is a tenth of the elastic one.
"""

from __future__ import annotations

from idic.diagnose.candidate import Candidate, Situation, Variant, register

LEVELS = (0, 2, 4, 5, 6)  # of `Situation.stress`
SOFTENING = 10.0  # elastic modulus over hardening modulus of the probe


def variants(situation: Situation) -> tuple[Variant, ...]:
    found = []
    for material in situation.experiment.materials:
        name = material.element_set
        if material.law != "elastic":
            continue
        E = situation.values[f"{name}.E"]
        table = dict(situation.document["material"][name])
        for level in LEVELS:
            yield_stress = float(situation.stress[name][min(level, len(situation.stress[name]) - 1)])
            enriched = {key: value for key, value in table.items() if key != "kinematics"} | {
                "law": "j2_linear",
                "yield_stress": {"value": yield_stress, "unit": "MPa", "identify": True},
                "hardening_modulus": {"value": E / SOFTENING, "unit": "MPa", "identify": True}}
            new = (f"{name}.yield_stress", f"{name}.hardening_modulus")
            found.append(Variant(
                f"{name} yields at {yield_stress:.3g} MPa", {f"material.{name}": enriched}, new,
                null={new[0]: float("inf"), new[1]: 0.0}, probe={new[0]: yield_stress, new[1]: E / SOFTENING}, sign=1))
    return tuple(found)


register(Candidate(
    "plasticity", "plasticity", "plastic flow", "an infinite yield stress",
    rivals={"damage": "both soften under load: only unloading tells them apart",
            "heterogeneity": "a soft spot where stress is high",
            "viscoelasticity": "both leave strain behind after unloading"},
    separates=("unload to zero once", "hold the load", "reverse the load"),
    variants=variants))
