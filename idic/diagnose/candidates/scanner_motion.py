"""Motion of a scanner: the specimen sits a little differently in every scan."""

from __future__ import annotations

import numpy as np

from idic.diagnose.physics.candidate import Candidate, Situation, Variant, register
from idic.images import RIGID, SCANNER, Scanner
from idic.model import Measured

PROBE_PX = 0.1  # at a corner of the mesh


def variants(situation: Situation) -> tuple[Variant, ...]:
    model = situation.experiment.model
    if not isinstance(model.camera, Scanner) or any(name.startswith(f"{SCANNER}.t_") for name in model.parameters.free):
        return ()
    if any(isinstance(entry.drive, Measured) for entry in model.prescribed):  # measured ends move with the specimen
        return ()
    frames = [k for k in range(model.reference + 1, model.n_frames) if k not in situation.experiment.recording.excluded]
    probe_mm = PROBE_PX * model.camera.pixel_size
    half_mm = 0.5 * float(np.linalg.norm(np.ptp(model.mesh.nodes, axis=0)))
    probe = {f"{SCANNER}.{name}_at[{k}]": probe_mm if name.startswith("t_") else float(np.degrees(probe_mm / half_mm))
             for k in frames for name in RIGID}
    return (Variant("the specimen sits differently in every scan", {"scanner.motion": "free"}, tuple(probe),
                    dict.fromkeys(probe, 0.0), probe, direct=True),)


register(Candidate(
    "scanner_motion", "camera", "motion between scans", "a specimen that sits alike in all scans",
    rivals={"grip_slip": "both shift the specimen in the volume: a slip strains it, too",
            "grip_rotation": "both turn it: a grip that turns bends it, too"},
    separating_tests=("scan a mark that is fixed to the stage", "scan the unloaded specimen twice, moved in between"),
    variants=variants, paraphrase="a rigid motion of every scan"))
