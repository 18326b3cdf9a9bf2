"""Geometric nonlinearity: the same law with Green's strain; there is no parameter."""

from __future__ import annotations

from idic.diagnose.physics.candidate import Candidate, Situation, Variant, register
from idic.laws import get_law


def variants(situation: Situation) -> tuple[Variant, ...]:
    names = [material.element_set for material in situation.experiment.model.materials
             if material.kinematics == "small" and "finite" in get_law(material.law).kinematics]
    if not names:
        return ()
    edits = {f"material.{name}.kinematics": "finite" for name in names}
    return (Variant("finite strains and rotations", edits, (), {}, {}, sign=1, exact=True),)


register(Candidate(
    "geometric_nonlinearity", "elastic_form", "geometric nonlinearity", "small strains",
    rivals={"damage": "a stiffness that changes with the load",
            "second_invariant": "another curvature of stress over strain",
            "plasticity": "a stiffness that falls with the load"},
    separating_tests=("the same test at half the load", "load in the other direction"),
    variants=variants,
    paraphrase="finite strains and rotations"))
