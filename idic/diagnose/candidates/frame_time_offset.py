"""Time offset between images and log: every logged column is read earlier or later; the signature is the
velocity of the test.
"""

from __future__ import annotations

import numpy as np

from idic.diagnose.physics.candidate import Candidate, Situation, Variant, register
from idic.diagnose.physics.edits import further_dofs
from idic.parameters import PlausibleSize

PROBE_INTERVAL_SHARE = 0.05  # of the time between two frames


def variants(situation: Situation) -> tuple[Variant, ...]:
    experiment, name = situation.experiment, "time.offset"
    model = experiment.model
    rates = [*(drive.rates for drive in model.logged_drives), *(channel.rates for channel in model.channels)]
    if all(entry is None for entry in rates) or not model.has_times:
        return ()
    edits = further_dofs(situation, name)
    if edits is None:
        return ()
    probe = PROBE_INTERVAL_SHARE * float(np.median(np.diff(experiment.model.times)))
    return (Variant("log and images of different times", edits, (name,), {name: 0.0}, {name: probe}),)


register(Candidate(
    "frame_time_offset", "force", "time offset between images and log", "an offset of zero seconds",
    rivals={"viscoelasticity": "a force that lags behind the motion",
            "rate_dependence": "a force that depends on the velocity"},
    separating_tests=("a sync mark: a lamp that the log switches", "start and stop the motion abruptly",
               "repeat the test at another speed"),
    variants=variants,
    paraphrase="image and log entry are not of the same moment",
    size=PlausibleSize(20.0, "the time between two frames", "an estimate: image and log started by hand")))
