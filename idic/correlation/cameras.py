"""Several cameras: the equations of one frame joined before anything is eliminated.

Frame-local unknowns (the noise of a logged motion, the nodes of a measured edge) belong to the frame and are shared
by its cameras. Brightness belongs to each camera, and so does the noise of its reference image (docs/method.md,
equation 2.6).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from idic.correlation.image_equations.equations import BasisEquations, FrameEquations, Weights
from idic.correlation.image_equations.system import CorrelationSystem


@dataclass(frozen=True)
class CameraPart:
    """Contribution of one camera to a frame.

    n_pixels, n_lost : pixels in the sums, and lost ones; gram (k, k), rhs (k,) and rr : of its own residual in the
    columns of all cameras; n_brightness : of these columns that are its own.
    """

    n_pixels: int
    n_lost: int
    gram: np.ndarray
    rhs: np.ndarray
    rr: float
    n_brightness: int

    def sums(self, step: np.ndarray) -> list[float]:
        """A row of `FrameRecord.cameras` after this step  # step (k,)"""
        rr = self.rr - 2.0 * step @ self.rhs + step @ self.gram @ step
        return [self.n_pixels, self.n_lost, max(rr, 0.0), self.n_brightness]


def joined_equations(equations: Sequence[FrameEquations], weights: Sequence[Weights],
                pixels: Sequence[tuple[int, int]]) -> tuple[FrameEquations, tuple[CameraPart, ...]]:
    """The equations of all cameras as those of one, their weights and their noise multiplied in.

    To be eliminated with weight and noise 1 (`unit_weights`).

    Parameters
    ----------
    equations, weights : one per camera
    pixels : pixels in the sums, and lost ones, per camera

    Returns
    -------
    equations : brightness columns of the cameras one after the other, `shared` one below the other
    parts : each camera's own sums in those columns
    """
    main, first = equations[0], weights[0]
    n_fields = main.channels.d_global.shape[1] + main.channels.d_local.shape[1]
    ends = n_fields + np.cumsum([len(r.rhs) - n_fields for r in equations])
    size = int(ends[-1])
    gram, noise_gram, rhs, rr = np.zeros((size, size)), np.zeros((size, size)), np.zeros(size), 0.0
    shared, bases, parts = [], [], []
    for r, w, end, (n_pixels, n_lost) in zip(equations, weights, ends, pixels, strict=True):
        nb = len(r.rhs) - n_fields
        place = np.concatenate([np.arange(n_fields), np.arange(end - nb, end)])
        part = CameraPart(n_pixels, n_lost, np.zeros((size, size)), np.zeros(size), r.rr, nb)
        part.gram[np.ix_(place, place)] = r.gram
        part.rhs[place] = r.rhs
        noise = w.image * w.image_noise  # of the weighted residual
        gram += w.image * part.gram
        rhs += w.image * part.rhs
        rr += w.image * r.rr
        noise_sums = np.zeros((size, size))
        noise_sums[np.ix_(place, place)] = r.kappa * r.gram if r.noise_gram is None else r.noise_gram
        noise_gram += noise**2 * noise_sums
        wide = np.zeros((len(r.shared), size))
        wide[:, place] = noise / first.image_noise * r.shared  # the covariance multiplies it by the noise of the first
        shared.append(wide)
        if r.basis is not None:
            bases.append(_widened(r.basis, noise / first.image_noise, place, size))
        parts.append(part)
    joined = replace(main, gram=gram, rhs=rhs, rr=rr, shared=np.vstack(shared), noise_gram=noise_gram,
                     basis=_stacked(bases) if len(bases) == len(equations) else None)
    return joined, tuple(parts)


def _widened(basis: BasisEquations, factor: float, place: np.ndarray, size: int) -> BasisEquations:
    """One camera's equations in the columns of all; factor : its noise after weighting over that of the first."""
    product = np.zeros((len(basis.product), size))
    product[:, place] = factor * basis.product
    return replace(basis, rhs=factor * basis.rhs, product=product)


def _stacked(bases: Sequence[BasisEquations]) -> BasisEquations:
    return BasisEquations(*(np.concatenate([getattr(basis, f.name) for basis in bases])
                            for f in fields(BasisEquations)))


def unit_weights(weights: Weights) -> Weights:
    """The weights for joined equations: those of the channels."""
    return replace(weights, image=1.0, image_noise=1.0)


def with_camera_sums(system: CorrelationSystem, parts: Sequence[CameraPart],
                     weights: Sequence[Weights]) -> CorrelationSystem:
    """The system of one frame, with the squared residual of each camera in its record."""
    record = system.frames[0]
    step = np.concatenate([np.zeros(len(system.names)), record.local_step, record.brightness])
    cameras = np.array([part.sums(step) for part in parts])
    scale = np.array([(weights[0].image_noise / w.image_noise) ** 2 for w in weights])
    return replace(system, frames=(replace(record, cameras=cameras, rr=float(scale @ cameras[:, 2])),))
