"""Shear damage of a laminate: the curve of nonlinear shear, whose lost stiffness unloading does not give back."""

from __future__ import annotations

from idic.diagnose.candidates.shear_nonlinearity import softening
from idic.diagnose.physics.candidate import Candidate, Situation, Variant, register


def variants(situation: Situation) -> tuple[Variant, ...]:
    return softening(situation, 1.0, "{name} loses shear stiffness for good, with the power {exponent:g} of the stress")


register(Candidate(
    "shear_damage", "elastic_form", "shear damage", "no loss of shear stiffness",
    rivals={"shear_nonlinearity": "the same until the load falls: only unloading tells them apart",
            "grip_slip": "a force that stays behind on the way back",
            "friction": "hysteresis of force over motion: damage leaves none when the load comes a second time"},
    separating_tests=("unload to zero once", "load again: is the slope that of the first loading?"),
    variants=variants,
    paraphrase="permanent loss of shear stiffness between the fibres, as cracks of the matrix make it"))
