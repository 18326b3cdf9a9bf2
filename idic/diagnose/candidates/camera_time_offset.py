"""Time offset between cameras: one of them takes its images earlier or later than the main one; the signature is the
velocity of the test, in the images of that camera alone.
"""

from __future__ import annotations

import numpy as np

from idic.diagnose.physics.candidate import Candidate, Situation, Variant, register
from idic.diagnose.physics.edits import further_dofs

PROBE_INTERVAL_SHARE = 0.05  # of the time between two frames


def variants(situation: Situation) -> tuple[Variant, ...]:
    experiment = situation.experiment
    if experiment.model.solver is not None:
        return ()
    probe = PROBE_INTERVAL_SHARE * float(np.median(np.diff(experiment.model.times)))
    main, proposals = experiment.recording.camera_name, []
    for camera in experiment.cameras:
        name = camera.time_offset
        if (edits := further_dofs(situation, name)) is not None:
            proposals.append(Variant(f"{camera.name} and {main} take their images at different times", edits, (name,),
                                     {name: 0.0}, {name: probe}, direct=True))
    return tuple(proposals)


register(Candidate(
    "camera_time_offset", "camera", "time offset between cameras", "images of all cameras at the same times",
    rivals={"stereo_angle": "an angle is wrong in the first image, too; a time offset follows the velocity",
            "frame_time_offset": "all cameras are late against the log, not one against the others"},
    separating_tests=("one trigger for all cameras", "a lamp that all cameras see, switched on during the test",
                      "start and stop the motion abruptly"),
    variants=variants,
    paraphrase="one camera shows another moment than the others"))
