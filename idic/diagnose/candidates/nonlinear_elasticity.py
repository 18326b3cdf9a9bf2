"""Reversible nonlinear elasticity: a stiffness that falls or rises with the strain and comes back on unloading.

Of an isotropic model; the fibres of an orthotropic one stiffen by `fibre_stiffening`.
"""

from __future__ import annotations

from idic.diagnose.physics.candidate import Candidate, Situation, Variant, register
from idic.diagnose.physics.enrich import enriched, materials_with, new

PROBE_LOSS = 0.05  # of the secant stiffness at the largest strain


def variants(situation: Situation) -> tuple[Variant, ...]:
    proposals = []
    for name, _ in materials_with(situation, "elastic"):
        strain = situation.strain[name]
        if not strain > 0.0:
            continue
        dof, size = f"{name}.nonlinearity", PROBE_LOSS / strain
        edits = enriched(situation, name, "nonlinear_elastic", nonlinearity=new(1.0 / strain))  # its scale
        edits[f"material.{name}"]["kinematics"] = situation.experiment.model.material_of(name).kinematics
        label = f"the stiffness of {name} changes with its strain"
        proposals.append(Variant(label, edits, (dof,), {dof: 0.0}, {dof: size}, exact=True))
    return tuple(proposals)


register(Candidate(
    "nonlinear_elasticity", "elastic_form", "nonlinear elasticity", "a stress in proportion to the strain",
    rivals={"damage": "both soften: damage is permanent, a nonlinear elastic body unloads along its loading curve",
            "plasticity": "both soften: plastic flow leaves strain behind",
            "load_cell_curvature": "a nonlinear force over motion: by the load cell, or by the material",
            "geometric_nonlinearity": "a stiffness that changes with the load"},
    separating_tests=("unload to zero once", "load again: is the path that of the first loading?"),
    variants=variants,
    paraphrase="a stiffness that changes with the strain, reversible"))
