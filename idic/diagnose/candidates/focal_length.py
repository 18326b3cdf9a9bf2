"""Focal length of a camera with a lens: another one than the calibration says."""

from __future__ import annotations

from idic.diagnose.physics.candidate import Candidate, Situation, Variant, register
from idic.diagnose.physics.edits import further_dofs
from idic.images import PlacedCamera

PROBE_SHARE = 0.003  # of the focal length of the file


def variants(situation: Situation) -> tuple[Variant, ...]:
    proposals, views = [], situation.experiment.views
    for view in views:
        names = tuple(f"{view.recording.camera_name}.{axis}" for axis in ("fx", "fy"))
        if not isinstance(view.model.camera, PlacedCamera) or (edits := further_dofs(situation, *names)) is None:
            continue
        at = dict(zip(names, (view.model.camera.lens.fx, view.model.camera.lens.fy), strict=True))
        label = "another focal length" + (f" of {view.recording.camera_name}" if len(views) > 1 else "")
        proposals.append(Variant(label, edits, names, at, {n: (1.0 + PROBE_SHARE) * v for n, v in at.items()},
                                 direct=True))
    return tuple(proposals)


register(Candidate(
    "focal_length", "camera", "wrong focal length", "the focal length of the calibration",
    rivals={"placement": "a distance and a focal length both scale the image",
            "heterogeneity": "both change strain from place to place: a mesh of another size does not lie on the "
                             "specimen",
            "specimen_motion": "a scale that changes during the test, not one that is wrong from the start"},
    separating_tests=("calibrate again, with focus and aperture as in the test", "measure the specimen in the image"),
    variants=variants,
    paraphrase="the calibration scales the image wrongly"))
