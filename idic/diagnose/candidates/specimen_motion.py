"""Motion of the specimen as a rigid body before cameras with a lens: approach and tilt, with time or with the load.

Before a camera without a known lens the tilt alone; an approach is another magnification there.
"""

from __future__ import annotations

import numpy as np

from idic.diagnose.candidates.magnification import changing_columns
from idic.diagnose.candidates.sheet_bending import LEANING, deflections
from idic.diagnose.physics.candidate import Candidate, Situation, Variant, register
from idic.diagnose.physics.edits import camera_key, further_dofs
from idic.images import PLACEMENT_STEM, PlacedCamera

KINDS = ("t_z", "rotation_x", "rotation_y")  # what no motion within a plane shows
PROBE_PX = 0.3  # in the corner of the image, at the end or at the largest load


def variants(situation: Situation) -> tuple[Variant, ...]:
    experiment, camera = situation.experiment, situation.experiment.model.camera
    if not isinstance(camera, PlacedCamera):
        return deflections(situation, LEANING)
    half = 0.5 * float(np.hypot(*experiment.recording.image_shape))
    depth = float(camera.depths(camera.pivot_mm[None])[0])
    growth = PROBE_PX / half  # of the image, by an approach; a tilt makes it over half of the image
    turn = float(np.degrees(growth * depth / (half * camera.pixel_size)))
    ends = dict(zip(KINDS, (growth * depth, turn, turn), strict=True))
    proposals = []
    if experiment.model.has_times:
        proposals += _course(situation, "drift", "time", {}, {k: v / situation.duration for k, v in ends.items()})
    for column in changing_columns(situation):
        proposals += _course(situation, "load", column, {camera_key(situation, "motion_column"): column}, ends)
    return tuple(proposals)


def _course(situation, ending, course, more, ends) -> list[Variant]:
    names = {kind: f"{PLACEMENT_STEM}.{kind}_{ending}" for kind in KINDS}
    edits = further_dofs(situation, *names.values())
    if edits is None:
        return []
    probe = {names[kind]: end for kind, end in ends.items()}
    return [Variant(f"the specimen approaches and tilts with {course}", edits | more, tuple(probe),
                    dict.fromkeys(probe, 0.0), probe, direct=True)]


register(Candidate(
    "specimen_motion", "camera", "approach and tilt of the specimen", "a specimen that stays in its plane",
    rivals={"poisson_ratio": "an approach stretches the image in both directions, as another contraction does",
            "thermal_expansion": "the same field: a uniform growth of all lengths",
            "sheet_bending": "a sheet that bends comes nearer in parts",
            "heterogeneity": "a strain that differs from one side to the other",
            "focal_length": "a scale that is wrong from the start, not one that changes"},
    separating_tests=("a second camera at an angle", "record still frames of the unloaded specimen over the same time"),
    variants=variants,
    paraphrase="the specimen moves along the line of sight, or leans"))
