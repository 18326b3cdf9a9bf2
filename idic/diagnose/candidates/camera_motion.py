"""Camera motion: the whole image shifts and turns from frame to frame."""

from __future__ import annotations

import numpy as np

from idic.diagnose.physics.candidate import Candidate, Situation, Variant, register
from idic.diagnose.physics.edits import camera_key
from idic.images import Camera

MAX_TESTED_FRAMES = 12  # that are tested; the refit frees all of them
PROBE_PX = 0.1


def variants(situation: Situation) -> tuple[Variant, ...]:
    experiment = situation.experiment
    stem = f"{experiment.recording.camera_name}."
    if not isinstance(experiment.model.camera, Camera):
        return ()
    if any(name.startswith((f"{stem}col_at[", f"{stem}row_at[")) for name in experiment.model.parameters):
        return ()
    frames = [k for k in range(experiment.model.reference + 1, experiment.model.n_frames)
              if k not in experiment.recording.excluded]
    if len(frames) > MAX_TESTED_FRAMES:
        frames = [frames[i] for i in np.unique(np.linspace(0, len(frames) - 1, MAX_TESTED_FRAMES).astype(int))]
    half = 0.5 * float(np.hypot(*experiment.recording.image_shape))
    probe = {}
    for k in frames:
        probe |= {f"{stem}col_at[{k}]": PROBE_PX, f"{stem}row_at[{k}]": PROBE_PX,
                  f"{stem}turn_at[{k}]": float(np.degrees(PROBE_PX / half))}
    return (Variant("the camera moves from frame to frame", {camera_key(situation, "motion"): "free"}, tuple(probe),
                    dict.fromkeys(probe, 0.0), probe, direct=True),)


register(Candidate(
    "camera_motion", "camera", "camera motion", "a camera at rest",
    rivals={"grip_slip": "both shift the specimen in the image: a slip strains it, too",
            "grip_rotation": "both turn it: a grip that turns bends it, too"},
    separating_tests=("record a mark next to the specimen", "record still frames",
                      "fix the camera to the machine's frame"),
    variants=variants,
    paraphrase="the whole image shifts and turns from frame to frame"))
