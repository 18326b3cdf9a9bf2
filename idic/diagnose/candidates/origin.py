"""Origin: the mesh lies beside the specimen in the image."""

from __future__ import annotations

from idic.diagnose.physics.candidate import Candidate, Situation, Variant, register
from idic.diagnose.physics.edits import further_dofs
from idic.images import Camera

PROBE_PX = 2.0


def variants(situation: Situation) -> tuple[Variant, ...]:
    stem = situation.experiment.recording.camera_name
    names = (f"{stem}.shift_col", f"{stem}.shift_row")
    edits = further_dofs(situation, *names)
    if edits is None or not isinstance(situation.experiment.model.camera, Camera):
        return ()
    at = dict(zip(names, (float(x) for x in situation.experiment.model.camera.shift_px), strict=True))
    return (Variant("the mesh lies beside the specimen", edits, names, at, {n: v + PROBE_PX for n, v in at.items()},
                    direct=True),)


register(Candidate(
    "origin", "camera", "wrong origin of the mesh in the image", "the origin in the file",
    rivals={"hole_geometry": "a misplaced hole: with the whole mesh, or alone",
            "heterogeneity": "both change strain from place to place",
            "pixel_size": "both misplace the mesh on the specimen"},
    separating_tests=("measure edges and holes of the specimen in the reference image",),
    variants=variants,
    paraphrase="the mesh is shifted against the specimen"))
