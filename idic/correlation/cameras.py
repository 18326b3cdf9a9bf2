"""Several cameras: the rows of one frame joined before anything is eliminated.

The frame-local unknowns (the noise of a logged motion, the nodes of a measured edge) belong to the frame and are shared
by its cameras; brightness belongs to each camera, and so does the noise of its reference image.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from idic.correlation.system import CorrelationSystem, FrameRows, Weights


@dataclass(frozen=True)
class CameraPart:
    """What one camera adds: pixels in the sums and out of them; gram (k, k), rhs (k,) and rr of its own residual in
    the columns of all cameras."""

    n_pixels: int
    n_lost: int
    gram: np.ndarray
    rhs: np.ndarray
    rr: float

    def sums(self, step: np.ndarray) -> list[float]:
        """Pixels, lost pixels and the squared residuals that are left after this step  # step (k,)"""
        rr = self.rr - 2.0 * step @ self.rhs + step @ self.gram @ step
        return [self.n_pixels, self.n_lost, max(rr, 0.0)]


def joined_rows(rows: Sequence[FrameRows], weights: Sequence[Weights],
                pixels: Sequence[tuple[int, int]]) -> tuple[FrameRows, tuple[CameraPart, ...]]:
    """The rows of all cameras as those of one, in the weight and the noise of the first.

    Parameters
    ----------
    rows, weights : one per camera
    pixels : pixels in the sums, and lost ones, per camera

    Returns
    -------
    rows : brightness columns of the cameras one after the other, `shared` one below the other
    parts : each camera's own sums in those columns
    """
    main, first = rows[0], weights[0]
    n_fields = main.channels.d_global.shape[1] + main.channels.d_local.shape[1]
    ends = n_fields + np.cumsum([len(r.rhs) - n_fields for r in rows])
    size = int(ends[-1])
    gram, noise_gram, rhs, rr = np.zeros((size, size)), np.zeros((size, size)), np.zeros(size), 0.0
    shared, parts = [], []
    for r, w, end, (n_pixels, n_lost) in zip(rows, weights, ends, pixels, strict=True):
        place = np.concatenate([np.arange(n_fields), np.arange(end - (len(r.rhs) - n_fields), end)])
        own = CameraPart(n_pixels, n_lost, np.zeros((size, size)), np.zeros(size), r.rr)
        own.gram[np.ix_(place, place)] = r.gram
        own.rhs[place] = r.rhs
        weight = w.image / first.image
        noise = weight * w.image_noise / first.image_noise  # of the weighted residual
        gram += weight * own.gram
        rhs += weight * own.rhs
        rr += weight * r.rr
        noise_gram += noise**2 * r.kappa * own.gram
        wide = np.zeros((len(r.shared), size))
        wide[:, place] = noise * r.shared
        shared.append(wide)
        parts.append(own)
    return replace(main, gram=gram, rhs=rhs, rr=rr, shared=np.vstack(shared), noise_gram=noise_gram), tuple(parts)


def with_camera_sums(system: CorrelationSystem, parts: Sequence[CameraPart]) -> CorrelationSystem:
    """The system of one frame with what is left in each camera noted in its record."""
    record = system.frames[0]
    step = np.concatenate([np.zeros(len(system.names)), record.local_step, record.brightness])
    record = replace(record, cameras=np.array([part.sums(step) for part in parts]))
    return replace(system, frames=(record,))
