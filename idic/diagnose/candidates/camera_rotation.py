"""Rotation of the camera: the axes of the mesh are turned in the image against those of the specimen."""

from __future__ import annotations

import numpy as np

from idic.diagnose.physics.candidate import Candidate, Situation, Variant, register
from idic.diagnose.physics.edits import further_dofs
from idic.images import Camera

PROBE_PX = 3.0  # in the corner of the image


def variants(situation: Situation) -> tuple[Variant, ...]:
    experiment = situation.experiment
    name = f"{experiment.recording.camera_name}.rotation_deg"
    edits = further_dofs(situation, name)
    if edits is None or not isinstance(situation.experiment.model.camera, Camera):
        return ()
    value, half = experiment.model.camera.rotation_deg, 0.5 * float(np.hypot(*experiment.recording.image_shape))
    probe = value + float(np.degrees(PROBE_PX / half))
    return (Variant("the camera is turned about its axis", edits, (name,), {name: value}, {name: probe}, direct=True),)


register(Candidate(
    "camera_rotation", "camera", "rotated camera", "the rotation in the file",
    rivals={"grip_rotation": "a load at an angle in the image: by the camera, or by the grip",
            "orthotropy": "a material with oblique axes shears under tension, too",
            "origin": "both misplace the mesh on the specimen"},
    separating_tests=("measure the angle of the specimen's edges in the reference image",
                      "move the unloaded specimen along the axis of the machine: its path in the image is the axis"),
    variants=variants,
    paraphrase="the camera is turned about its optical axis from the start"))
