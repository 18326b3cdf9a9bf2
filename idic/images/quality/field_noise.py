"""Noise of a measured field, from the stages themselves: its size, and how it is correlated between neighbours.

Subsets of a DIC overlap and filters smooth, so that neighbouring points share their noise. A stage is predicted from the
stages before and after it and from a polynomial of the second degree in the place; what is left is noise:

    v_t = a v_(t-1) + b v_(t+1) + polynomial + noise,      variance s² [1 + a² + b² + (1 - a - b)²/N]

(docs/method.md, equations 15.2 and 15.3). A course that is smooth in time and any field that grows in proportion are
taken out; noise that all of the stage shares (a shift, a stretch) is not seen here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from idic.images.stack import Stack

MAX_STAGES = 24  # looked at, spread over the test
MAX_LAG = 6  # distances of neighbours
MIN_CORRELATION = 0.05  # on a ring of neighbours; the sum ends at the first ring below
MIN_POINTS = 40
_BEST_PART = 0.5  # of the stages, those with the least left: the others may hold motion


@dataclass(frozen=True, eq=False)
class FieldNoise:
    """Noise of one component of a point.

    std : of a point; sum_std : of independent noise that scatters sums over many points as this one does;
    correlation : (2 L + 1, 2 L + 1) of points so many rows and columns apart, 1 in the middle
    """

    std: float
    sum_std: float
    correlation: np.ndarray


def field_noise(stack: Stack, positions: np.ndarray, frames: Sequence[int], reference: int,
                n_references: int = 1) -> FieldNoise | None:
    """Noise from the stages of a test; None where there are too few points or stages.

    Parameters
    ----------
    stack : frames of (n_points, 2), NaN where not measured
    positions : (n_points, 2) in distances of neighbours
    frames : stages that count, in order, the reference among them
    reference : the stage that displacements count from; n_references : stages averaged to it
    """
    frames = list(frames)
    if len(frames) < 3 or len(positions) < MIN_POINTS:
        return None
    middle = [k for k in range(1, len(frames) - 1) if frames[k] != reference]
    chosen = [middle[k] for k in np.unique(np.linspace(0, len(middle) - 1, min(MAX_STAGES, len(middle))).astype(int))]
    variances, residuals = [], []
    for k in chosen:
        found = _left(stack, positions, frames[k - 1], frames[k], frames[k + 1], reference, n_references)
        if found is not None:
            variances.append(found[0])
            residuals.append(found[1])
    if not variances:
        return None
    order = np.argsort(variances)[:max(1, int(np.ceil(_BEST_PART * len(variances))))]
    std = float(np.sqrt(np.median(np.array(variances)[order])))
    if not std > 0.0:
        return None
    correlation = _correlation(positions, [residuals[k] for k in order])
    return FieldNoise(std, std * float(np.sqrt(max(_sum_over_rings(correlation), 1.0))), correlation)


def _left(stack: Stack, positions, before: int, now: int, after: int, reference: int,
          n_references: int) -> tuple[float, np.ndarray] | None:
    """Variance of the noise of one stage by its residual, and the residual of unit variance  # (n_points, 2)"""
    fields = [np.zeros((len(positions), 2)) if k == reference else np.asarray(stack.frame(k), float)
              for k in (before, now, after)]
    known = np.isfinite(np.hstack(fields)).all(axis=1)
    n = int(known.sum())
    if n < MIN_POINTS:
        return None
    x, y = (positions[known] - positions[known].mean(axis=0)).T / np.ptp(positions, axis=0).max()
    smooth = np.column_stack([np.ones(n), x, y, x * x, x * y, y * y])
    zero = np.zeros_like(smooth)
    previous, value, following = (field[known].T.ravel() for field in fields)  # columns first, then rows
    neighbours = [column for column in (previous, following) if column.any()]
    columns = np.column_stack([np.vstack([smooth, zero]), np.vstack([zero, smooth]), *neighbours])
    scale = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    factors = np.linalg.lstsq(columns / scale, value, rcond=1e-10)[0] / scale
    left = value - columns @ factors
    shares = factors[12:]
    gain = 1.0 + float(shares @ shares) + (1.0 - float(shares.sum())) ** 2 / n_references
    variance = float(left @ left) / max(2 * n - columns.shape[1], 1) / gain
    if not variance > 0.0:
        return None
    whole = np.full((len(positions), 2), np.nan)
    whole[known] = left.reshape(2, n).T / np.sqrt(variance * gain)
    return variance, whole


def _correlation(positions: np.ndarray, residuals: Sequence[np.ndarray]) -> np.ndarray:
    """Mean product of points by their distance in columns and rows  # (2 L + 1, 2 L + 1)"""
    pairs = cKDTree(positions).query_pairs(MAX_LAG * 1.5, output_type="ndarray")
    lag = np.rint(positions[pairs[:, 1]] - positions[pairs[:, 0]]).astype(int)
    near = (np.abs(lag) <= MAX_LAG).all(axis=1)
    pairs, lag = pairs[near], lag[near]
    size = 2 * MAX_LAG + 1
    place = (lag[:, 1] + MAX_LAG) * size + lag[:, 0] + MAX_LAG
    total, count = np.zeros(size * size), np.zeros(size * size)
    for residual in residuals:
        product = residual[pairs[:, 0]] * residual[pairs[:, 1]]
        known = np.isfinite(product)
        total += sum(np.bincount(place[known[:, c]], product[known[:, c], c], size * size) for c in (0, 1))
        count += sum(np.bincount(place[known[:, c]], minlength=size * size) for c in (0, 1))
    one_sided = total.reshape(size, size), count.reshape(size, size)
    both, numbers = (part + part[::-1, ::-1] for part in one_sided)
    correlation = np.where(numbers > 0, both / np.maximum(numbers, 1), 0.0)
    correlation[MAX_LAG, MAX_LAG] = 1.0
    return correlation


def _sum_over_rings(correlation: np.ndarray) -> float:
    """Sum of the correlation over rings of equal distance, up to the first that is below `MIN_CORRELATION`."""
    row, column = np.indices(correlation.shape) - MAX_LAG
    ring = np.maximum(np.abs(row), np.abs(column))
    total = 1.0
    for k in range(1, MAX_LAG + 1):
        own = correlation[ring == k]
        if own.mean() < MIN_CORRELATION:
            break
        total += float(own.sum())
    return total
