"""Magnification of a scanner: the size of a voxel changes, with time or from scan to scan."""

from __future__ import annotations

from idic.diagnose.physics.candidate import Candidate, Situation, Variant, register
from idic.diagnose.physics.edits import further_dofs
from idic.images import SCANNER, Scanner
from idic.model import knot_name

PROBE_MAGNIFICATION = 1e-3


def variants(situation: Situation) -> tuple[Variant, ...]:
    experiment, model = situation.experiment, situation.experiment.model
    stem = f"{SCANNER}.magnification"
    if not isinstance(model.camera, Scanner) or any(name.startswith(stem) for name in model.parameters.free):
        return ()
    proposals, drift = [], f"{stem}_drift"
    if model.has_times and (edits := further_dofs(situation, drift)) is not None:
        proposals.append(Variant("the voxels grow with time", edits, (drift,), {drift: 0.0},
                                 {drift: PROBE_MAGNIFICATION / situation.duration}, direct=True))
    names = tuple(knot_name(stem, k) for k in range(model.reference + 1, model.n_frames)
                  if k not in experiment.recording.excluded)
    if (edits := further_dofs(situation, *names)) is not None:
        proposals.append(Variant("voxels of another size in every scan", edits, names, dict.fromkeys(names, 0.0),
                                 dict.fromkeys(names, 0.0), direct=True, free_course=True))
    return tuple(proposals)


register(Candidate(
    "scanner_magnification", "camera", "change of magnification of the scanner", "voxels of one size in all scans",
    rivals={"thermal_expansion": "the same field: a uniform growth of all lengths",
            "poisson_ratio": "a contraction across the load"},
    separating_tests=("scan a body of known size with the specimen", "scan the unloaded specimen again at the end"),
    variants=variants, paraphrase="source, stage or detector move along the beam, or warm up"))
