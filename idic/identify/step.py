"""One damped Gauss–Newton step on scaled unknowns: Levenberg–Marquardt, clipped per component, within bounds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from idic.identify.covariance import Scaled, Spectrum
from idic.parameters import ParameterSet

STEP_CLIP = 0.35  # per component in ln(parameter): with it the bulge trial converged from 60 % to 200 %


@dataclass(frozen=True)
class Step:
    """A proposed change of the free parameters.

    delta : (n,) scaled, after clipping; relative : the largest unclipped Gauss–Newton component over its standard
    deviation, by which convergence is judged; largest : that component itself; significance : `relative` of `delta`;
    predicted : decrease of phi that the quadratic model promises; pinned : what the undamped step carries over a bound.
    """

    delta: np.ndarray
    relative: float
    largest: float
    significance: float
    predicted: float
    clipped: bool
    pinned: tuple[str, ...]


def propose(scaled: Scaled, found: Spectrum, stds: np.ndarray, parameters: ParameterSet, damping: float,
            clip: float | None = None) -> Step:
    """The step from the present point; `damping` multiplies the diagonal of M (0 = Gauss–Newton).

    Components that would leave their bounds are pinned there and the others solved again.
    """
    free = parameters.with_free(scaled.names)
    low, high = (limits[[free.free.index(name) for name in scaled.names]] for limits in free.scaled_bounds())
    here = np.array([parameters[name].to_scaled() for name in scaled.names])
    judged, held = _bounded(scaled, found, 0.0, here, low, high)  # undamped: whether this is a minimum
    delta = judged if damping == 0.0 else _bounded(scaled, found, damping, here, low, high)[0]
    limit = STEP_CLIP if clip is None else clip
    clipped = np.clip(delta, -limit, limit)
    predicted = float(2.0 * scaled.b @ clipped - clipped @ scaled.M @ clipped)
    certain = np.where(stds > 0, stds, np.inf)
    pinned = tuple(name for name, at_bound in zip(scaled.names, held, strict=True) if at_bound)
    return Step(clipped, float((np.abs(judged) / certain).max(initial=0.0)), float(np.abs(judged).max(initial=0.0)),
                float((np.abs(clipped) / certain).max(initial=0.0)), predicted, bool(np.any(clipped != delta)), pinned)


def _bounded(scaled: Scaled, found: Spectrum, damping: float, here: np.ndarray, low: np.ndarray,
             high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The damped step with what would leave its bounds held there, and which components that is  # (n,), (n,) bool"""
    active, fixed = np.zeros(len(here), dtype=bool), np.zeros(len(here))
    slack = 1e-12 * np.maximum(1.0, np.abs(here))
    while True:
        delta = _solve(scaled, found, damping, active, fixed)
        beyond = ~active & ((here + delta < low - slack) | (here + delta > high + slack))
        if not beyond.any():
            return delta, active
        fixed[beyond] = (np.clip(here + delta, low, high) - here)[beyond]
        active |= beyond


def _solve(scaled: Scaled, found: Spectrum, damping: float, active: np.ndarray, fixed: np.ndarray) -> np.ndarray:
    """Damped solve over the determined directions with the active components fixed  # (n,)"""
    keep = ~active
    delta = fixed.copy()
    if not keep.any():
        return delta
    rhs = scaled.b[keep] - scaled.M[np.ix_(keep, active)] @ fixed[active]
    inner = scaled.M[np.ix_(keep, keep)]
    diagonal = np.diagonal(inner)
    weight = np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
    normal = inner / weight[:, None] / weight[None, :] + damping * np.eye(keep.sum())
    weak = found.vectors[:, ~found.determined][keep]  # (n_keep, n_weak) directions not to step along
    if weak.size:
        basis, _ = np.linalg.qr(weight[:, None] * _complement(weak))
        delta[keep] = basis @ np.linalg.solve(basis.T @ normal @ basis, basis.T @ (rhs / weight)) / weight
    else:
        delta[keep] = np.linalg.solve(normal, rhs / weight) / weight
    return delta


def _complement(weak: np.ndarray) -> np.ndarray:
    """Orthonormal basis of what is orthogonal to the columns of `weak`."""
    u, s, _ = np.linalg.svd(weak, full_matrices=True)
    rank = int((s > 1e-8).sum())
    return u[:, rank:]
