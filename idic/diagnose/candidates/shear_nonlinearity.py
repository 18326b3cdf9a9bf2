"""Nonlinear shear of a laminate: Ramberg and Osgood's curve between its axes, on which the body also unloads.

The amplitude enters linearly, so the null is regular; without it the exponent has no meaning and is tried on a grid.
"""

from __future__ import annotations

import math

from idic.diagnose.physics.candidate import Candidate, Situation, Variant, register
from idic.diagnose.physics.enrich import absent_in_laminates, enriched, locked, new

EXPONENTS = (2.0, 3.0, 5.0)
PROBE_SOFTENING = 0.1  # shear strain beyond the elastic one, at half the largest shear stress


def variants(situation: Situation) -> tuple[Variant, ...]:
    return softening(situation, 0.0, "{name} softens in shear with the power {exponent:g} of the stress")


def softening(situation: Situation, damage: float, label: str) -> tuple[Variant, ...]:
    """Variants of a shear that softens; damage : share of the lost stiffness that unloading does not give back."""
    proposals = []
    for name in absent_in_laminates(situation, "shear_softening"):
        G = situation.values[f"{name}.G12"]
        reference = 0.5 * G * math.sqrt(3.0) * situation.strain[name]  # half of what pure shear of this size has
        names = (f"{name}.shear_softening", f"{name}.shear_exponent")
        constants = {f"{name}.shear_reference": reference, f"{name}.shear_damage": damage}
        for exponent in EXPONENTS:
            edits = enriched(situation, name, "laminate", shear_softening=new(PROBE_SOFTENING),
                             shear_exponent=new(exponent), shear_reference=locked(reference, "MPa"),
                             shear_damage=locked(damage))
            edits[f"material.{name}"]["kinematics"] = situation.experiment.model.material_of(name).kinematics
            proposals.append(Variant(label.format(name=name, exponent=exponent), edits, names,
                                     null={names[0]: 0.0, names[1]: exponent} | constants,
                                     probe={names[0]: PROBE_SOFTENING, names[1]: exponent} | constants, sign=1,
                                     exact=True))
    return tuple(proposals)


register(Candidate(
    "shear_nonlinearity", "elastic_form", "nonlinear shear", "a shear stress in proportion to the shear",
    rivals={"shear_damage": "the same until the load falls: only unloading tells them apart",
            "grip_rotation": "grips that pull at an angle shear the specimen too",
            "force_drift": "a force that falls behind the motion",
            "machine_compliance": "a motion that grows more than the force"},
    separating_tests=("unload to zero once", "load again: is the path that of the first loading?",
                      "turn a second specimen by 45 degrees"),
    variants=variants,
    paraphrase="a shear stiffness between the fibres that falls with the shear, reversible"))
