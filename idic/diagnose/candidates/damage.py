"""Isotropic damage: stiffness that is lost for good beyond a strain; threshold on a grid, rate from zero."""

from __future__ import annotations

from idic.diagnose.physics.candidate import Candidate, Situation, Variant, register
from idic.diagnose.physics.enrich import (
    comes_back,
    elastic_pair,
    enriched,
    materials_with,
    new,
    stress_levels,
)

STRESS_LEVELS = (0, 2, 4, 5, 6)  # of `Situation.stress`; over Young's modulus: strain thresholds
PROBE_DAMAGE = 0.1  # damage where the stress is a tenth above the highest level


def variants(situation: Situation) -> tuple[Variant, ...]:
    proposals = []
    for name, _ in materials_with(situation, "elastic"):
        E, _ = elastic_pair(situation, name)
        kinematics = situation.experiment.model.material_of(name).kinematics
        names = (f"{name}.threshold", f"{name}.softening")
        highest = 1.1 * float(situation.stress[name][-1]) / E
        for stress in stress_levels(situation, name, STRESS_LEVELS):
            threshold = stress / E
            softening = PROBE_DAMAGE / (highest - threshold)
            edits = enriched(situation, name, "elastic_damage", threshold=new(threshold), softening=new(softening))
            edits[f"material.{name}"]["kinematics"] = kinematics
            proposals.append(Variant(f"{name} is damaged beyond a strain of {threshold:.3g}", edits, names,
                                     {names[0]: float("inf"), names[1]: 0.0},
                                     {names[0]: threshold, names[1]: softening}, sign=1, exact=True))
    return tuple(proposals)


def untestable(situation: Situation) -> str:
    """Without a load, and without a way back, a loss of stiffness deforms the body as plastic flow does."""
    experiment = situation.experiment
    if experiment.model.channels or experiment.model.loads or comes_back(situation.u):
        return ""
    return "without a force, and without unloading, loss of stiffness and plastic flow look the same in the images"


register(Candidate(
    "damage", "damage", "damage", "no loss of stiffness beyond the threshold (softening = 0)",
    rivals={"plasticity": "both soften under load: damage unloads to zero strain, plastic flow does not",
            "heterogeneity": "a soft spot where stress is high: there from the start",
            "geometric_nonlinearity": "a stiffness that changes with the load"},
    separating_tests=("unload to zero once", "load again: is the slope that of the first loading?"),
    variants=variants, has_onset=True,
    paraphrase="permanent loss of stiffness beyond a strain", slow=True, untestable=untestable))
