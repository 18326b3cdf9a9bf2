"""Placement of the mesh before cameras with a lens: it lies beside the specimen, or leans against it."""

from __future__ import annotations

import numpy as np

from idic.diagnose.screen.candidate import Candidate, Situation, Variant, register
from idic.diagnose.screen.edits import further_dofs
from idic.images.placed_camera import PLACEMENT_STEM, PlacedCamera
from idic.images.rigid_motion import RIGID

PROBE_PX = 2.0


def variants(situation: Situation) -> tuple[Variant, ...]:
    experiment, camera = situation.experiment, situation.experiment.camera
    names = tuple(f"{PLACEMENT_STEM}.{kind}" for kind in RIGID)
    if not isinstance(camera, PlacedCamera) or (edits := further_dofs(situation, *names)) is None:
        return ()
    moved = {name: np.linalg.norm(camera.parameter_jacobian(experiment.mesh.nodes, name), axis=1).max()
             for name in names}
    at = dict(zip(names, camera.placement.tolist(), strict=True))
    return (Variant("the mesh lies beside the specimen", edits, names, at,
                    {name: at[name] + PROBE_PX / float(moved[name]) for name in names}, direct=True),)


register(Candidate(
    "placement", "camera", "wrong place of the mesh", "the place in the file",
    rivals={"focal_length": "a distance and a focal length both scale the image",
            "hole_geometry": "a misplaced hole: with the whole mesh, or alone",
            "heterogeneity": "both change strain from place to place"},
    separating_tests=("click more points of the specimen in the reference images of all cameras",),
    variants=variants,
    paraphrase="the mesh is shifted or leans against the specimen"))
