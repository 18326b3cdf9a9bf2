"""Tilted camera: the magnification falls from one side of the image to the other (parallax)."""

from __future__ import annotations

import numpy as np

from idic.diagnose.physics.candidate import Candidate, Situation, Variant, register
from idic.diagnose.physics.edits import further_dofs
from idic.images import Camera

PROBE_PX = 3.0  # in the corner of the image


def variants(situation: Situation) -> tuple[Variant, ...]:
    experiment = situation.experiment
    names = tuple(f"{experiment.recording.camera_name}.{axis}" for axis in ("tilt_x", "tilt_y"))
    edits = further_dofs(situation, *names)
    if edits is None or not isinstance(situation.experiment.model.camera, Camera):
        return ()
    at = dict(zip(names, (float(x) for x in experiment.model.camera.tilt), strict=True))
    half = 0.5 * float(np.hypot(*experiment.recording.image_shape))
    step = PROBE_PX / (half * half * experiment.model.camera.pixel_size)
    probe = {name: value + step for name, value in at.items()}
    return (Variant("the camera looks at an angle", edits, names, at, probe, direct=True),)


register(Candidate(
    "parallax", "camera", "parallax of a tilted camera", "a camera that looks along the normal of the specimen",
    rivals={"heterogeneity": "a gradient of strain from one side to the other",
            "lens_distortion": "both distort a field that should be uniform",
            "grip_rotation": "more strain on one side than on the other"},
    separating_tests=("photograph a calibration grid in the plane of the specimen",
                      "shift the unloaded specimen through the field of view"),
    variants=variants,
    paraphrase="the magnification falls from one side of the image to the other"))
