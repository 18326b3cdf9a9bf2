"""Defocus: the images become blurred, by a variance that grows with time or load.

g_w = g + w/2 laplace(g): even in the width, hence one-sided in w. Where the pattern moves over the pixels, colour
filter and compression change the blur of a sharp image, too. They correlate its noise; where that is white and no
blocks of a compression show, no camera has done either. (A recording of 2 grey values of white noise that was
compressed at quality 70: 0.010 px² of blur, and noise that looks white.) What the pixels take from a fine pattern is
known (`idic.diagnose.residual.subpixel_columns`) and does not count.
"""

from __future__ import annotations

from idic.diagnose.candidates.illumination import courses
from idic.diagnose.physics.candidate import Candidate, Situation, Variant, register
from idic.images import compressed_at

MIN_BLUR_PX2 = 1.0 / 60.0  # a fifth of the variance of a pixel's area; demosaiced and compressed images: up to 0.015
MIN_BLUR_OF_WHITE_PX2 = 1.0 / 120.0  # of images with white noise; 31 clean drawn worlds: up to 0.0067
MIN_CORRELATION = 0.1  # between neighbouring pixels, of noise that a camera has processed


def variants(situation: Situation) -> tuple[Variant, ...]:
    experiment = situation.experiment
    if experiment.recording.quantity != "grey" or experiment.options.defocus != "none":
        return ()
    correlated_noise = experiment.recording.noise.correlated
    is_independent = correlated_noise is None or abs(correlated_noise.neighbour_correlation) < MIN_CORRELATION
    is_white = is_independent and compressed_at(experiment.recording.stack.frame(experiment.model.reference)) is None
    least = MIN_BLUR_OF_WHITE_PX2 if is_white else MIN_BLUR_PX2
    return tuple(Variant(f"blur grows with {name}", {"options.defocus": "frame"}, (), {}, sign=1,
                         pixels=("blur", course[None]), least=least) for name, course in courses(situation))


register(Candidate(
    "defocus", "camera", "defocus", "a blur of zero",
    rivals={"illumination": "both change contrast: a lamp in some places, focus everywhere",
            "magnification": "a motion out of the plane does both"},
    separating_tests=("stop down the lens", "a shorter exposure, where the blur is motion"),
    variants=variants,
    paraphrase="a blur that grows with time or load"))
