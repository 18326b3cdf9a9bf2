"""Seating: grips and couplings settle under the first load, so the log begins with a toe.

At a set that is held at a fixed value it counts along the axis.
"""

from __future__ import annotations

import numpy as np

from idic.model.records.experiment import Experiment
from idic.model.records.parts import Column, Prescribed
from idic.model.terms.corrections.correction_term import (
    Cause, CorrectedMotion, CorrectionTerm, Key, Probe, Required, Scale, against_motion, in_length, probe_length,
)

SEATED_SHARES = (0.05, 0.15, 0.4)  # of the largest force: all but 1/e of the way is gone


def course(motion: CorrectedMotion) -> np.ndarray:
    """u = u_log - s (1 - exp(-|F| / F_seated)): all but a 1/e of the way at `seated_at`"""
    settled = 1.0 - np.exp(-np.abs(motion.log(None)) / motion.keys["seated_at"])
    return against_motion(motion.drive) * settled


def probes(experiment: Experiment, motion: Prescribed) -> list[Probe]:
    if not isinstance(motion.drive, Column):
        return []
    forms = []
    for force in experiment.model.channels:
        size = float(np.abs(force.values).max())
        if force.kind == "reaction" and force.component == motion.component and size:
            forms += [Probe(label(motion.nodes, share * size, force.unit),
                            {"column": force.column, "seated_at": share * size}, probe_length(experiment.model), sign=1)
                      for share in SEATED_SHARES]
    return forms


def label(nodes: str, seated_at: float, unit: str) -> str:
    return f"{nodes} settles under the first {seated_at:.3g} {unit}"


SEATING = CorrectionTerm(
    "seating", course, in_length,
    Cause("seating", "machine seating", "a toe: grips and couplings settle under the first load",
          "no displacement lost under the first load",
          rivals={"machine_compliance": "a motion that is missing in proportion to the force, also at high load",
                  "grip_slip": "a permanently missing motion",
                  "force_offset": "both shift the beginning of the force",
                  "nonlinear_elasticity": "a stiffness that rises with the load"},
          separating_tests=("load to a tenth and unload a few times before the test",
                            "measure the motion at the specimen: `measured` in [[boundary]]")),
    probes, is_logged=True, keys=(Key("seated_at", above=0.0),), scale=Scale("seated_at", label),
    required=Required(("column", "seated_at"), "seating without its force",
                      "the measured force and the load at which the grips have seated",
                      '{ kind = "seating", column = "force_N", seated_at = 20.0 }'))
