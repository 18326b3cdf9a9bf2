"""Dust on lens or sensor: a spot of another grey value that is fixed in the image.

It has no column of a score: it is looked for, pixel by pixel, before everything else, and left out of the images
(`idic.diagnose.residual.spots`). Its test is one of the family: a pattern that is lost by six standard deviations of
noise in four pixels and two frames does not occur by chance in any number of pixels.
"""

from __future__ import annotations

from idic.diagnose.physics.candidate import Candidate, register

register(Candidate(
    "dust", "camera", "dust on lens or sensor", "the same pattern in the reference image and under it in every frame",
    rivals={"paint_loss": "both hide the pattern; dust stays in the image, lost paint goes with the specimen"},
    separating_tests=("clean lens and sensor, and record one image of an even surface",),
    variants=lambda situation: (),
    paraphrase="a spot that is fixed in the image"))
