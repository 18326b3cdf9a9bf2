"""Fibre stiffening: a modulus along an axis of the material that rises with the strain there, and comes back."""

from __future__ import annotations

from idic.diagnose.physics.candidate import Candidate, Situation, Variant, register
from idic.diagnose.physics.enrich import absent_in_laminates, enriched, new

PROBE_GAIN = 0.05  # of the secant modulus at the largest strain
AXES = (1, 2)


def variants(situation: Situation) -> tuple[Variant, ...]:
    proposals = []
    for axis in AXES:
        parameter = f"stiffening_{axis}"
        for name in absent_in_laminates(situation, parameter):
            dof, size = f"{name}.{parameter}", PROBE_GAIN / situation.strain[name]
            edits = enriched(situation, name, "laminate", **{parameter: new(size)})
            edits[f"material.{name}"]["kinematics"] = situation.experiment.model.material_of(name).kinematics
            proposals.append(Variant(f"the fibres of {name} along axis {axis} stiffen", edits, (dof,), {dof: 0.0},
                                     {dof: size}, exact=True))
    return tuple(proposals)


register(Candidate(
    "fibre_stiffening", "elastic_form", "fibre stiffening", "a modulus along the fibres that does not change",
    rivals={"load_cell_curvature": "a nonlinear force over motion: by the load cell, or by the fibres",
            "geometric_nonlinearity": "a stiffness that changes with the load",
            "seating": "a stiffness that rises with the load: a toe ends, fibres go on",
            "shear_nonlinearity": "both change the stiffness with the load: along the fibres, or between them"},
    separating_tests=("calibrate the load cell in several steps", "pull a strip cut across the fibres",
                      "load twice as far"),
    variants=variants,
    paraphrase="a modulus along the fibres that rises with the strain, reversible; negative: it falls"))
