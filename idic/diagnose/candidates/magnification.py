"""Change of magnification: motion out of the plane or a warming lens, with time or with the load."""

from __future__ import annotations

import numpy as np

from idic.diagnose.physics.candidate import Candidate, Situation, Variant, register
from idic.diagnose.physics.edits import camera_key, further_dofs
from idic.images import Camera
from idic.parameters import PlausibleSize

PROBE_MAGNIFICATION = 1e-3  # relative magnification at the end, or at the largest load


def variants(situation: Situation) -> tuple[Variant, ...]:
    experiment, stem = situation.experiment, situation.experiment.recording.camera_name
    if not isinstance(experiment.model.camera, Camera):  # before a lens the specimen moves: `specimen_motion`
        return ()
    if any(name.startswith(f"{stem}.magnification_knot[") for name in experiment.model.parameters.free):
        return ()
    proposals, drift = [], f"{stem}.magnification_drift"
    if experiment.model.has_times and (edits := further_dofs(situation, drift)) is not None:
        proposals.append(Variant("the image grows with time", edits, (drift,), {drift: 0.0},
                                 {drift: PROBE_MAGNIFICATION / situation.duration}, direct=True))
    load = f"{stem}.magnification_load"
    for column in changing_columns(situation):
        if (edits := further_dofs(situation, load)) is not None:
            proposals.append(Variant(f"the image grows with {column}",
                                     edits | {camera_key(situation, "magnification_column"): column}, (load,),
                                     {load: 0.0}, {load: PROBE_MAGNIFICATION}, direct=True))
    return tuple(proposals)


def changing_columns(situation: Situation) -> list[str]:
    """The forces and motions of the log that change."""
    model = situation.experiment.model
    logged = [(channel.column, channel.values) for channel in model.channels]
    logged += [(drive.column, drive.values) for drive in model.logged_drives]
    return list(dict(column for column in logged if float(np.ptp(column[1])) > 0.0))


register(Candidate(
    "magnification", "camera", "change of magnification", "a magnification that stays",
    rivals={"thermal_expansion": "the same field: a uniform growth of all lengths",
            "poisson_ratio": "a contraction across the load",
            "lens_distortion": "both change lengths in the image"},
    separating_tests=("record still frames of the unloaded specimen over the same time", "use a telecentric lens",
               "a second camera from another side"),
    variants=variants,
    paraphrase="motion out of the plane, or a lens that warms",
    size=PlausibleSize(1.0, "0.1 % over the test", "an estimate: 0.5 mm towards a camera at half a metre")))
