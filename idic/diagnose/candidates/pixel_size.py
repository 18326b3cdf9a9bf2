"""Pixel size: the specimen is larger or smaller in the image than the file says."""

from __future__ import annotations

from idic.diagnose.physics.candidate import Candidate, Situation, Variant, register
from idic.diagnose.physics.edits import further_dofs
from idic.images import Camera
from idic.parameters import PlausibleSize

PROBE_SHARE = 0.02  # of the pixel size of the file


def variants(situation: Situation) -> tuple[Variant, ...]:
    experiment = situation.experiment
    name = f"{experiment.recording.camera_name}.pixel_size"
    edits = further_dofs(situation, name)
    if edits is None or not isinstance(situation.experiment.model.camera, Camera):
        return ()
    value = experiment.model.camera.pixel_size
    return (Variant("another pixel size", edits, (name,), {name: value}, {name: (1.0 + PROBE_SHARE) * value},
                    direct=True),)


register(Candidate(
    "pixel_size", "camera", "wrong pixel size", "the pixel size in the file",
    rivals={"heterogeneity": "both change strain from place to place: a mesh of another size does not lie on the "
                             "specimen",
            "hole_geometry": "a hole of another size in the image",
            "force_scale": "both change the ratio of force and strain",
            "magnification": "a scale that changes during the test, not one that is wrong from the start"},
    separating_tests=("photograph a scale or a calibration grid in the plane of the specimen",
                      "measure the width of the specimen in the image"),
    variants=variants,
    paraphrase="millimetres per pixel differ from the file",
    size=PlausibleSize(0.5, "1 %", "an estimate: a scale that is read from one photograph")))
