"""Grip slip: from its onset on the specimen moves less than the log says.

Without a slip there is no onset, so it is on a grid of times; the slip grows evenly with time from there, or jumps. At
a set that is held at a fixed value it counts along the axis.
"""

from __future__ import annotations

import numpy as np

from idic.model.records.experiment import Experiment
from idic.model.records.parts import Column, Prescribed
from idic.model.terms.corrections.correction_term import (
    Cause, CorrectedMotion, CorrectionTerm, Probe, against_motion, in_length, probe_length, probe_starts, timed_course,
)
from idic.parameters import PlausibleSize


def course(motion: CorrectedMotion) -> np.ndarray:
    """1 at its end: the specimen has moved so much less than the log says."""
    values = motion.drive.values if isinstance(motion.drive, Column) else motion.times
    return against_motion(motion.drive) * timed_course(motion, values)


def probes(experiment: Experiment, motion: Prescribed) -> list[Probe]:
    is_logged, forms = isinstance(motion.drive, Column), []
    for keys in probe_starts(experiment.model):
        speed = "at once" if keys["course"] == "jump" else "slowly"
        forms.append(Probe(f"{motion.nodes} slips {speed} along {motion.component} from {keys['start_s']:.4g} s", keys,
                           probe_length(experiment.model), sign=1 if is_logged else 0))
    return forms


SLIP = CorrectionTerm(
    "slip", course, in_length,
    Cause("grip_slip", "grip slip", "the specimen slips in its grip", "a slip of zero",
          rivals={"plasticity": "in both the force lags behind the motion: near the grip only the place differs",
                  "machine_compliance": "a motion that is missing in proportion to the force",
                  "creep": "a motion that grows while the force is held"},
          separating_tests=("film the grips: pixels on both sides of the edge", "unload to zero once",
                            "tighten the grip"),
          has_onset=True, size=PlausibleSize(
              0.1, "0.1 mm", "an estimate: the teeth of a jaw bite into the specimen", in_probes=False)),
    probes, is_timed=True, free_sign=against_motion, stays=True, jumps="slips")
