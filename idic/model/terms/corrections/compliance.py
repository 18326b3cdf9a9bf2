"""Machine compliance: the log contains the deflection of the machine, in proportion to the force.

At a set that is held at a fixed value it counts along the axis.
"""

from __future__ import annotations

import numpy as np

from idic.model.records.experiment import Experiment
from idic.model.records.parts import Column, Prescribed
from idic.model.terms.corrections.correction_term import (
    Cause, CorrectedMotion, CorrectionTerm, Probe, Required, against_motion_with, probe_length,
)


def course(motion: CorrectedMotion) -> np.ndarray:
    """u = u_log - C F"""
    force = motion.log("N")
    return against_motion_with(motion.drive, force) * force


def probes(experiment: Experiment, motion: Prescribed) -> list[Probe]:
    is_logged, forms = isinstance(motion.drive, Column), []
    for force in (channel for channel in experiment.model.channels if channel.kind == "reaction"):
        size = float(np.abs(force.values).max())
        if force.component == motion.component and size != 0.0:
            forms.append(Probe(f"{motion.nodes} gives way along {motion.component} with {force.column}",
                               {"column": force.column}, probe_length(experiment.model) / size,
                               sign=1 if is_logged else 0))
    return forms


COMPLIANCE = CorrectionTerm(
    "compliance", course, lambda motion: f"{motion.length_unit}/N",
    Cause("machine_compliance", "machine compliance", "the logged motion contains the deflection of the machine",
          "a compliance of zero",
          rivals={"force_scale": "both change the slope of force against motion",
                  "grip_slip": "a missing motion that does not depend on the force",
                  "plasticity": "in both the force lags behind the motion; the machine recovers it on unloading"},
          separating_tests=("measure the motion at the specimen: `measured` in [[boundary]]", "test a stiff bar",
                            "unload to zero once")),
    probes, is_logged=True,
    required=Required(("column",), "machine compliance without a force", 'the measured force, e.g. column = "force_N"',
                      '{ kind = "compliance", column = "force_N" }'))
