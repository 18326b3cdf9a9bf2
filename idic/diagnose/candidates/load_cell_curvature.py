"""Nonlinear load cell: its reading bends with the force."""

from __future__ import annotations

from idic.diagnose.physics.candidate import Candidate, Situation, Variant, register
from idic.diagnose.physics.edits import further_dofs

PROBE_CURVATURE = 0.02  # of the force, at its largest


def variants(situation: Situation) -> tuple[Variant, ...]:
    found = []
    for channel in situation.experiment.channels:
        name = f"channel.{channel.column}.curvature"
        if channel.kind == "reaction" and (edits := further_dofs(situation, name)) is not None:
            found.append(Variant(f"{channel.column} is bent", edits, (name,), {name: 0.0}, {name: PROBE_CURVATURE},
                                 direct=True))
    return tuple(found)


register(Candidate(
    "load_cell_curvature", "force", "nonlinear load cell", "a straight calibration line",
    rivals={"nonlinear_elasticity": "a nonlinear force over motion: by the load cell, or by the material",
            "force_scale": "a factor: the same at one load",
            "geometric_nonlinearity": "a stiffness that changes with the load"},
    separating_tests=("calibrate the load cell at several loads", "hang dead weights on the load cell"),
    variants=variants,
    paraphrase="a calibration line that bends"))
