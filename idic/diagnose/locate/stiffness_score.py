"""How the residual asks for another stiffness in every element, of the whole test at once, and with which period.

The adjoint source map (`idic.diagnose.locate.adjoint_sources`) tells windows of frames apart. A stiffness that differs
from the start moves the images as the load does: with u_t = c_t u of the frame with the largest motion, the scores of
all frames are one adjoint solution of sum_t c_t p_t there. That is enough to find a pattern; its significance is tested
along the whole path.

The Fourier transform of the scores is the score of every plane wave of stiffness. The motion by a wave falls as its
period, and so does its noise: |k| |G(k)| compares waves. A window that fades to the ends of the body keeps what its
ends cut off, a bending, out of short waves.
"""

from __future__ import annotations

import numpy as np

from idic.diagnose.locate.adjoint_sources import element_scores, recorded_residual
from idic.diagnose.locate.tangents import tangents
from idic.diagnose.residual.residual_evidence import ResidualEvidence
from idic.diagnose.residual.score import null_model
from idic.identification import Identification

WINDOW_MARGIN = 0.05  # of the body, beyond its ends, where the window becomes zero


def stiffness_score(identification: Identification, residual: ResidualEvidence) -> np.ndarray:
    """Score of a relative change of the stiffness of every element  # (n_elements,)

    Positive where the recording asks for more. The identified parameters and the unknowns of every frame are projected
    out.

    Raises
    ------
    NotConverged
        If a law finds no answer along the path of the identified model.
    """
    evidence, null = residual.evidence, null_model(residual.evidence, residual.null)
    motion = residual.solved_u.reshape(len(residual.u), -1)
    peak = int(np.argmax((motion**2).sum(axis=1)))
    course = motion @ motion[peak] / ((motion[peak] @ motion[peak]) or 1.0)
    parts = [evidence.residual(part) for part in evidence.parts]
    step = null.remaining
    q = np.array([images - null.weighed.fields[t] @ step for t, (images, _) in enumerate(parts)])
    channels = np.array([readings - null.weighed.channels[t] @ step for t, (_, readings) in enumerate(parts)])
    p = np.einsum("t,tij->ij", course, recorded_residual(evidence, q[..., None]))
    (tangent,) = tangents(identification, residual, only=peak)
    return element_scores(residual, tangent, p, (course @ channels)[:, None])[:, 0]


def wave_scores(score: np.ndarray, centres: np.ndarray, waves: np.ndarray) -> np.ndarray:
    """|k| G(k) of plane waves about the middle of the elements; its phase is that of the stiffest place  # (n,) complex

    Parameters
    ----------
    score : (n_elements,); centres : (n_elements, 2) mm; waves : (n, 2) wave vectors, periods per mm
    """
    low, size = centres.min(axis=0), np.maximum(np.ptp(centres, axis=0), 1e-300)
    way = (centres - low + WINDOW_MARGIN * size) / ((1.0 + 2.0 * WINDOW_MARGIN) * size)
    windowed = score * np.prod(np.sin(np.pi * way) ** 2, axis=1)
    along = []  # per axis: the waves along it, each once, and which of them every wave has
    for axis, place in enumerate((centres - (low + 0.5 * size)).T):
        once, index = np.unique(waves[:, axis], return_inverse=True)
        along.append((np.exp(2j * np.pi * np.outer(once, place)), index))
    (x, of_x), (y, of_y) = along
    return np.linalg.norm(waves, axis=1) * ((x * windowed) @ y.T)[of_x, of_y]
