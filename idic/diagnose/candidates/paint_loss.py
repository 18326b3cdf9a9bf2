"""Paint loss: a place of the specimen whose pattern is gone from some frame on; found as dust is
(`idic.diagnose.residual.spots`)."""

from __future__ import annotations

from idic.diagnose.physics.candidate import Candidate, register

register(Candidate(
    "paint_loss", "camera", "paint loss", "the pattern of the reference image in every frame",
    rivals={"dust": "both hide the pattern; dust stays in the image, lost paint goes with the specimen"},
    separating_tests=("look at the place after the test",),
    variants=lambda situation: (),
    has_onset=True,
    paraphrase="a place of the specimen that loses its pattern"))
