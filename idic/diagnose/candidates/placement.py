"""Placement of the mesh: beside the specimen, turned, or of another size in the image; before cameras with a lens it
may lean against it.

Who misreads a scale or a point in the image often has a wrong pixel size, rotation and origin at once. Each of them
alone explains a part, and the motion that a shifted and scaled mesh finds is explained better by a camera that moves
in every frame.
"""

from __future__ import annotations

import numpy as np

from idic.diagnose.physics.candidate import Candidate, Situation, Variant, register
from idic.diagnose.physics.edits import further_dofs
from idic.images import Camera, PLACEMENT_STEM, PlacedCamera, RIGID

PROBE_PX = 2.0
MIN_SHARE_OVER_LIMIT = 0.03  # of its evidence, beyond that of its limits: a smaller gain is an inexact model of a limit
SIMILARITY = ("shift_col", "shift_row", "rotation_deg", "pixel_size")  # of a camera without a lens


def variants(situation: Situation) -> tuple[Variant, ...]:
    experiment, camera = situation.experiment, situation.experiment.model.camera
    if isinstance(camera, PlacedCamera):
        names = {f"{PLACEMENT_STEM}.{kind}": f"{PLACEMENT_STEM}.{kind}" for kind in RIGID}
        at = dict(zip(names, camera.placement.tolist(), strict=True))
    elif isinstance(camera, Camera):
        names = {f"{experiment.recording.camera_name}.{kind}": kind for kind in SIMILARITY}
        at = {name: camera.values()[kind] for name, kind in names.items()}
    else:
        return ()
    edits = further_dofs(situation, *names)
    if edits is None:
        return ()
    moved = {name: np.linalg.norm(camera.parameter_jacobian(experiment.model.mesh.nodes, kind), axis=1).max()
             for name, kind in names.items()}
    return (Variant("the mesh lies beside the specimen", edits, tuple(names), at,
                    {name: at[name] + PROBE_PX / float(moved[name]) for name in names}, direct=True),)


register(Candidate(
    "placement", "camera", "wrong place of the mesh", "the place in the file",
    rivals={"focal_length": "a distance and a focal length both scale the image",
            "camera_motion": "a camera that moves in every frame follows a part of what a scaled or turned mesh misses",
            "hole_geometry": "a misplaced hole: with the whole mesh, or alone",
            "heterogeneity": "both change strain from place to place"},
    separating_tests=("measure edges, holes and a scale in the reference image; click more points of the specimen",),
    variants=variants, limits=("origin", "camera_rotation", "pixel_size"), share_over_limit=MIN_SHARE_OVER_LIMIT,
    paraphrase="the mesh is shifted, turned, scaled or leans against the specimen"))
