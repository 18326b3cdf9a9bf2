"""Contrast that images lose where the motion of the model is off: it looks like light or blur, and is neither.

A motion error d changes the grey values by d.grad f + (d.grad)^2 f / 2. Motions explain the first part, of chi-square
D = sum (d.grad f)^2 / sigma^2. The second one is a blur, and a loss of contrast: its projection on the texture f
(without its mean, of chi-square C = sum f^2 / sigma^2) is -D / 2 C, by parts. A gain of that size shows by D^2 / 4 C.
"""

from __future__ import annotations

import numpy as np

from idic.diagnose.physics.candidate import Variant
from idic.diagnose.residual.heldout import Misfit
from idic.diagnose.residual.residual_evidence import ResidualEvidence
from idic.diagnose.residual.thinning import COPY_VARIANCE_FACTOR

MAX_LOST_CONTRAST_CHI2 = 25.0  # five standard deviations of a gain: more and effects of grey values wait for the motion

HIDDEN_BY_MOTION = ("the remaining motion reduces the contrast of the residual and looks the same: not tested while "
                    "it remains")


def lost_contrast_chi2(residual: ResidualEvidence, motions: Misfit) -> float:
    """Chi-square of the contrast that is lost by unexplained motion; motions : what free motions explain."""
    off = max(float(motions.gain.sum() - motions.rank.sum()), 0.0)
    contrast = [float(np.var(camera.grey_values)) / camera.context.weights.image_noise**2
                for camera in residual.cameras]
    texture = residual.evidence.n_pixels * float(np.mean(contrast))
    return off**2 / (4.0 * texture) if texture else 0.0


def reason_to_wait(variants: tuple[Variant, ...], residual: ResidualEvidence, motions: Misfit) -> str:
    """Why a candidate of grey values is not tested yet, "" where it is.

    residual : of the whole recording, where candidates are scored; motions : what free motions explain of one of its
    copies, half of what they explain of the whole
    """
    if not any(variant.pixels is not None for variant in variants):
        return ""
    lost = COPY_VARIANCE_FACTOR**2 * lost_contrast_chi2(residual, motions)
    return HIDDEN_BY_MOTION if lost > MAX_LOST_CONTRAST_CHI2 else ""
