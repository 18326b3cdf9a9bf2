"""Image noise from the residual of a free displacement (docs/method.md, equation 13.5).

The residual of pure noise has the variance sigma^2 (1/n_images + w^2) with the interpolator's w^2, less the part that
the displacement has fitted away: n - tr(2 S - S^2) degrees of freedom with S = (H + w D^T D)^-1 H.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from idic.correlation import ReferenceImage, residual_map
from idic.measure.dic.frame import DicFrame, gradient_share
from idic.images import Spline

_N_SAMPLED_DOFS = 96  # degrees of freedom that the trace is estimated from
_BEST_FRAMES_PART = 1 / 3  # of the frames: the noise is estimated from those with the smallest residual


@dataclass(frozen=True)
class ResidualNoise:
    """Noise estimated from one frame.

    variance : GV^2, all pixels: sum r^2 / (1/n_images + w^2) per degree of freedom left
    local_variance : GV^2, median over the elements and free of each element's mean, and so of slow changes of light
    """

    variance: float
    local_variance: float


def fitted_dof(frame: DicFrame) -> float:
    """tr(2 S - S^2): how many degrees of freedom the displacement takes from the residual, from a sample of nodes."""
    factor, hessian = frame.factorisation, frame.hessian
    dofs = np.flatnonzero(np.repeat(factor.measured, 2))
    if len(dofs) == 0:
        return 0.0
    chosen = dofs[np.unique(np.linspace(0, len(dofs) - 1, min(_N_SAMPLED_DOFS, len(dofs))).astype(int))]
    unit = np.zeros((len(frame.u_px) * 2, len(chosen)))
    unit[chosen, np.arange(len(chosen))] = 1.0
    column = factor.lu.solve(np.ascontiguousarray(hessian @ unit))  # S e_i
    row = hessian @ factor.lu.solve(unit)  # S^T e_i
    diagonal = column[chosen, np.arange(len(chosen))]
    part = np.mean(2 * diagonal - np.einsum("ij,ij->j", row, column))
    return float(np.clip(part, 0.0, 1.0) * len(dofs))  # beyond: a frame that did not converge


def residual_noise(reference: ReferenceImage, spline: Spline, frame: DicFrame, brightness: str,
                   dof: float) -> ResidualNoise:
    """Noise of one frame from its residual; dof: `fitted_dof`.

    A low-pass correlates the noise: a displacement takes `gradient_share` / gain of a pixel's variance from it, a mean
    1 / gain (gain: variance of a blurred pixel).
    """
    residual = residual_map(reference, spline, frame.u_full_px, brightness, frame.brightness)
    start = reference.pixel_map.start[:-1]
    gain = residual.still_gain
    weight = np.where(residual.valid, 1.0 / (residual.reference_gain / reference.n_images + residual.noise_gain), 0.0)
    r = np.where(residual.valid, residual.r, 0.0).astype(float)
    count = np.add.reduceat(residual.valid.astype(float), start)
    n = count.sum()
    square, total = np.add.reduceat(weight * r**2, start), np.add.reduceat(weight * r, start)
    remaining_dof = max(n - (dof * gradient_share(reference) + len(frame.brightness)) / gain, 1.0)
    full = count >= max(0.5 * np.median(count), 8 / gain)  # elements at the rim have few pixels
    if not full.any():
        return ResidualNoise(float(square.sum() / remaining_dof), float(square.sum() / remaining_dof))
    local_dof = np.maximum(count - 1.0 / gain, 1.0)
    mean_weight = np.maximum(np.add.reduceat(weight, start), 1e-12)
    local = (square - total**2 / mean_weight) / local_dof
    local /= (1.0 - 2.0 / (9.0 * local_dof * gain)) ** 3  # median of chi^2 to its mean
    return ResidualNoise(float(square.sum() / remaining_dof), float(np.median(local[full]) * n / remaining_dof))


def noise_of_frames(local_variance: np.ndarray) -> float:
    """Noise std from the best-explained frames; nan where there is none  # (n_frames,) GV^2, nan: not to be used"""
    values = np.sort(local_variance[np.isfinite(local_variance)])
    if len(values) == 0:
        return float("nan")
    return float(np.sqrt(np.median(values[: max(1, int(np.ceil(_BEST_FRAMES_PART * len(values))))])))
