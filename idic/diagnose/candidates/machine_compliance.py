"""Machine compliance: the log contains the deflection of the machine, in proportion to the force."""

from __future__ import annotations

import numpy as np

from idic.diagnose.physics.candidate import Candidate, Situation, Variant, register
from idic.diagnose.physics.edits import channel_unit, driven, with_correction

PROBE_PX = 0.2


def variants(situation: Situation) -> tuple[Variant, ...]:
    experiment = situation.experiment
    forces = [channel for channel in experiment.channels if channel.kind == "reaction"]
    found = []
    for number, nodes, component, drive in driven(situation):
        if any(entry["kind"] == "compliance" for entry in drive.get("corrections", ())):
            continue
        for force in forces:
            size = float(np.abs(force.values).max())
            if force.component != component or size == 0.0:
                continue
            name, logged = f"boundary.{nodes}.{component}.compliance", "column" in drive
            edits = with_correction(situation, number, component,
                                    {"kind": "compliance", "column": force.column}
                                    | channel_unit(situation, force.column))
            found.append(Variant(f"{nodes} gives way along {component} with {force.column}", edits, (name,),
                                 {name: 0.0},
                                 {name: PROBE_PX * experiment.camera.pixel_size / size}, sign=1 if logged else 0,
                                 exact=True))
    return tuple(found)


register(Candidate(
    "machine_compliance", "boundary", "machine compliance", "a compliance of zero",
    rivals={"force_scale": "both change the slope of force against motion",
            "grip_slip": "a missing motion that does not depend on the force",
            "plasticity": "in both the force lags behind the motion; the machine recovers it on unloading"},
    separating_tests=("measure the motion at the specimen: `measured` in [[boundary]]", "test a stiff bar",
               "unload to zero once"),
    variants=variants,
    paraphrase="the logged motion contains the deflection of the machine"))
