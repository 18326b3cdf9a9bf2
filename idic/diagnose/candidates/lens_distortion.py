"""Lens distortion: radial, fixed in the image, seen where the specimen moves through it."""

from __future__ import annotations

import numpy as np

from idic.diagnose.physics.candidate import Candidate, Situation, Variant, register
from idic.diagnose.physics.edits import further_dofs
from idic.images import PlacedCamera, Scanner
from idic.parameters import PlausibleSize

PROBE_PX = 3.0  # in the corner of the image


def variants(situation: Situation) -> tuple[Variant, ...]:
    camera, half = situation.experiment.model.camera, 0.5 * float(np.hypot(*situation.experiment.recording.image_shape))
    if isinstance(camera, Scanner):
        return ()
    if isinstance(camera, PlacedCamera):  # a coefficient of a lens counts in tangents of the angle of view
        coefficient, value = camera.lens.leading, camera.lens.values()[camera.lens.leading]
        probe = PROBE_PX * camera.lens.fx**2 / half**3
    else:
        coefficient, value, probe = "k1", camera.k1, PROBE_PX / half**3
    name = f"{situation.experiment.recording.camera_name}.{coefficient}"
    edits = further_dofs(situation, name)
    if edits is None:
        return ()
    return (Variant("radial distortion about the centre of the image", edits, (name,), {name: value},
                    {name: value + probe}, direct=True),)


register(Candidate(
    "lens_distortion", "camera", "lens distortion", "the radial distortion that the file gives",
    rivals={"heterogeneity": "both distort a field that should be uniform",
            "magnification": "both change lengths in the image"},
    separating_tests=("shift the specimen through the field of view, unloaded", "record a calibration grid"),
    variants=variants,
    paraphrase="radial, fixed in the image",
    size=PlausibleSize(1.0, "3 px in the corner of the image",
                       "an estimate: lenses of machine vision distort by up to 1 %")))
