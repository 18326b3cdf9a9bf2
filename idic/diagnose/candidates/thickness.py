"""Thickness: that of the file differs from the specimen's; with a free modulus and driven motion the two are one."""

from __future__ import annotations

from idic.diagnose.physics.candidate import Candidate, Situation, Variant, register
from idic.diagnose.physics.edits import further_dofs

NAME = "geometry.thickness"
PROBE_FACTOR = 1.02


def variants(situation: Situation) -> tuple[Variant, ...]:
    thickness = situation.experiment.model.thickness
    if thickness is None or (edits := further_dofs(situation, NAME)) is None:
        return ()
    probe = {NAME: PROBE_FACTOR * thickness}
    return (Variant("another thickness", edits, (NAME,), {NAME: thickness}, probe, exact=True),)


register(Candidate(
    "thickness", "force", "wrong thickness", "the thickness in the file",
    rivals={"force_scale": "a factor of the force: exactly the same in this test",
            "machine_compliance": "both change the slope of force against motion"},
    separating_tests=("measure the thickness at several places", "hang a dead weight on the load cell"),
    variants=variants,
    paraphrase="the thickness in the file is off by a factor"))
