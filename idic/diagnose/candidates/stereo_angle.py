"""Angle between cameras with a lens: another one than the calibration says, after a blow or a screw that gave way."""

from __future__ import annotations

from idic.diagnose.physics.candidate import Candidate, Situation, Variant, register
from idic.diagnose.physics.edits import further_dofs
from idic.images import PLACED_TURNS, PlacedCamera

PROBE_DEG = 0.1


def variants(situation: Situation) -> tuple[Variant, ...]:
    proposals, main = [], situation.experiment.recording.camera_name
    for view in situation.experiment.views[1:]:
        if not isinstance(view.model.camera, PlacedCamera):
            continue
        names = tuple(f"{view.recording.camera_name}.{turn}" for turn in PLACED_TURNS)
        if (edits := further_dofs(situation, *names)) is None:
            continue
        at = dict(zip(names, view.model.camera.turn_deg.tolist(), strict=True))
        proposals.append(Variant(f"{view.recording.camera_name} is turned against {main}", edits, names, at,
                                 {name: value + PROBE_DEG for name, value in at.items()}, direct=True))
    return tuple(proposals)


register(Candidate(
    "stereo_angle", "camera", "camera turned about its own centre", "the angles of the calibration",
    rivals={"focal_length": "both change the lengths that one camera sees",
            "placement": "the mesh leans against the specimen before all cameras, not before one",
            "specimen_motion": "a motion along the line of sight during the test, not an angle wrong from the start"},
    separating_tests=("calibrate the pair again, as it stands", "shift the specimen, unloaded, through the view"),
    variants=variants,
    paraphrase="one camera has been turned since the calibration"))
