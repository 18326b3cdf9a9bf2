"""Grip slip: from its onset on the specimen moves less than the log says.

Without a slip there is no onset, so it is on a grid of times; the slip grows evenly with time from there, or jumps.
"""

from __future__ import annotations

import numpy as np

from idic.diagnose.physics.candidate import Candidate, Situation, Variant, register
from idic.diagnose.physics.edits import driven, with_correction

ONSETS = (0.0, 0.2, 0.4, 0.6, 0.8)  # of the test
PROBE_PX = 0.2


def variants(situation: Situation) -> tuple[Variant, ...]:
    experiment = situation.experiment
    first, probe = float(experiment.times[experiment.reference]), PROBE_PX * experiment.camera.pixel_size
    found = []
    for number, nodes, component, drive in driven(situation):
        if any(entry["kind"] == "slip" for entry in drive.get("corrections", ())):
            continue
        name, logged = f"boundary.{nodes}.{component}.slip", "column" in drive
        for onset in ONSETS:
            start = float(np.round(first + onset * situation.duration, 9))
            for course in ("ramp", "jump") if onset else ("ramp",):
                edits = with_correction(situation, number, component,
                                        {"kind": "slip", "start_s": start, "course": course})
                how = "at once" if course == "jump" else "slowly"
                found.append(Variant(f"{nodes} slips {how} along {component} from {start:.4g} s", edits, (name,),
                                     {name: 0.0}, {name: probe}, sign=1 if logged else 0, exact=True))
    return tuple(found)


register(Candidate(
    "grip_slip", "boundary", "grip slip", "a slip of zero",
    rivals={"plasticity": "in both the force lags behind the motion: near the grip only the place differs",
            "machine_compliance": "a motion that is missing in proportion to the force",
            "creep": "a motion that grows while the force is held"},
    separating_tests=("film the grips: pixels on both sides of the edge", "unload to zero once", "tighten the grip"),
    variants=variants, has_onset=True,
    paraphrase="the specimen slips in its grip"))
