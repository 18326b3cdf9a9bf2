"""Image noise from what a free displacement leaves unexplained.

The residual of pure noise has the variance sigma^2 (1/n_images + w^2) with the interpolator's w^2, less the part that
the displacement has fitted away: n - tr(2 S - S^2) degrees of freedom with S = (H + w D^T D)^-1 H.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from idic.correlation.frame import residual_map
from idic.correlation.reference import ReferenceImage
from idic.dic.frame import DicFrame
from idic.images.interpolate import Spline

_SAMPLED_DOFS = 96
_BEST_PART = 1 / 3  # frames that the noise is estimated from


@dataclass(frozen=True)
class ResidualNoise:
    """What one frame says about the noise.

    variance : GV^2, all pixels: sum r^2 / (1/n_images + w^2) per degree of freedom left
    local_variance : GV^2, median over the elements and free of each element's mean: blind to slow changes of lighting
    """

    variance: float
    local_variance: float


def fitted_dof(frame: DicFrame) -> float:
    """tr(2 S - S^2): how many degrees of freedom the displacement takes from the residual, from a sample of nodes."""
    factor, hessian = frame.factorisation, frame.hessian
    dofs = np.flatnonzero(np.repeat(factor.measured, 2))
    if len(dofs) == 0:
        return 0.0
    chosen = dofs[np.unique(np.linspace(0, len(dofs) - 1, min(_SAMPLED_DOFS, len(dofs))).astype(int))]
    unit = np.zeros((len(frame.u_px) * 2, len(chosen)))
    unit[chosen, np.arange(len(chosen))] = 1.0
    column = factor.lu.solve(np.ascontiguousarray(hessian @ unit))  # S e_i
    row = hessian @ factor.lu.solve(unit)  # S^T e_i
    own = column[chosen, np.arange(len(chosen))]
    part = np.mean(2 * own - np.einsum("ij,ij->j", row, column))
    return float(np.clip(part, 0.0, 1.0) * len(dofs))  # beyond: a frame that did not converge


def residual_noise(reference: ReferenceImage, spline: Spline, frame: DicFrame, brightness: str, dof: float) -> ResidualNoise:
    """Noise of one frame from its residual; dof: `fitted_dof`."""
    found = residual_map(reference, spline, frame.u_full_px, brightness, frame.brightness)
    start = reference.pixel_map.start[:-1]
    weight = np.where(found.valid, 1.0 / (1.0 / reference.n_images + found.noise_gain), 0.0)
    r = np.where(found.valid, found.r, 0.0).astype(float)
    count = np.add.reduceat(found.valid.astype(float), start)
    n = count.sum()
    square, total = np.add.reduceat(weight * r**2, start), np.add.reduceat(weight * r, start)
    left = max(n - dof - len(frame.brightness), 1.0)
    full = count >= max(0.5 * np.median(count), 8)  # elements at the rim say little
    if not full.any():
        return ResidualNoise(float(square.sum() / left), float(square.sum() / left))
    own = np.maximum(count - 1.0, 1.0)
    mean_weight = np.maximum(np.add.reduceat(weight, start), 1e-12)
    local = (square - total**2 / mean_weight) / own / (1.0 - 2.0 / (9.0 * own)) ** 3  # median of chi^2 to its mean
    return ResidualNoise(float(square.sum() / left), float(np.median(local[full]) * n / left))


def noise_of_frames(local_variance: np.ndarray) -> float:
    """Noise std from the best-explained frames; nan where there is none  # (n_frames,) GV^2, nan: not to be used"""
    values = np.sort(local_variance[np.isfinite(local_variance)])
    if len(values) == 0:
        return float("nan")
    return float(np.sqrt(np.median(values[: max(1, int(np.ceil(_BEST_PART * len(values))))])))
