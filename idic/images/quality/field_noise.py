"""Noise of a measured field, from the stages themselves: its size, and how it is correlated between neighbours.

Subsets of a DIC overlap and filters smooth, so that neighbouring points share their noise. A stage is predicted from the
stages before and after it and from a polynomial of the second degree in the place; what is left is noise:

    v_t = a v_(t-1) + b v_(t+1) + polynomial + noise,      variance s² [1 + a² + b² + (1 - a - b)²/N]

(docs/method.md, equations 15.2 and 15.3). A course that is smooth in time and any field that grows in proportion are
taken out. The polynomial takes a part of correlated noise with it, most where points are few: with the projection P on what
is left, the covariance C is the one for which P C P has the products that are seen (equation 15.4). Noise that all of a stage
shares (a shift, a stretch) is not seen here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.spatial import cKDTree

from idic.images.stack import Stack

MAX_STAGES = 24  # looked at, spread over the test
MAX_LAG = 6  # distances of neighbours
MIN_CORRELATION = 0.05  # mean of a ring of neighbours, as seen; one ring more than those above it is fitted
MIN_POINTS = 40
SWEEPS = 30  # of the fit of C at most; each takes a part of the polynomial's share back
MIN_CHANGE = 1e-3  # of a sweep, in variances: below, the fit has ended; the scatter of the estimate is larger
MAX_VARIANCE_RATIO = 2.0  # of what is left of a stage to the median of the stages: more is motion


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
            variances.append(float(np.nanmean(found**2)))
            residuals.append(found)
    if not variances or not float(np.median(variances)) > 0.0:
        return None
    most = MAX_VARIANCE_RATIO * float(np.median(variances))
    kept = [residual for residual, variance in zip(residuals, variances, strict=True) if variance <= most]
    covariance = _Pairs.of(positions).covariance(kept)
    variance = float(covariance[MAX_LAG, MAX_LAG])
    correlation = covariance / variance
    return FieldNoise(float(np.sqrt(variance)), float(np.sqrt(variance * max(correlation.sum(), 1.0))), correlation)


def _smooth(positions: np.ndarray) -> np.ndarray:
    """Polynomials of the second degree  # (n, 6)"""
    x, y = (positions - positions.mean(axis=0)).T / max(float(np.ptp(positions, axis=0).max()), 1e-300)
    return np.column_stack([np.ones(len(x)), x, y, x * x, x * y, y * y])


def _left(stack: Stack, positions, before: int, now: int, after: int, reference: int,
          n_references: int) -> np.ndarray | None:
    """What the neighbours in time and a polynomial leave of a stage, as large as its own noise  # (n_points, 2)"""
    fields = [np.zeros((len(positions), 2)) if k == reference else np.asarray(stack.frame(k), float)
              for k in (before, now, after)]
    known = np.isfinite(np.hstack(fields)).all(axis=1)
    n = int(known.sum())
    if n < MIN_POINTS:
        return None
    smooth = _smooth(positions[known])
    zero = np.zeros_like(smooth)
    previous, value, following = (field[known].T.ravel() for field in fields)  # columns first, then rows
    neighbours = [column for column in (previous, following) if column.any()]
    columns = np.column_stack([np.vstack([smooth, zero]), np.vstack([zero, smooth]), *neighbours])
    scale = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    factors = np.linalg.lstsq(columns / scale, value, rcond=1e-10)[0] / scale
    left = value - columns @ factors
    shares = factors[12:]
    gain = 1.0 + float(shares @ shares) + (1.0 - float(shares.sum())) ** 2 / n_references
    whole = np.full((len(positions), 2), np.nan)
    whole[known] = left.reshape(2, n).T / np.sqrt(gain * (1.0 - len(shares) / (2 * n)))
    return whole


@dataclass(frozen=True, eq=False)
class _Pairs:
    """Points and their neighbours, themselves included; each pair once.

    first, second : (m,) numbers of the points; place : (m,) of their distance in rows and columns, in a square of
    2 MAX_LAG + 1; Q : (n, 6) orthonormal polynomials
    """

    first: np.ndarray
    second: np.ndarray
    place: np.ndarray
    Q: np.ndarray

    @classmethod
    def of(cls, positions: np.ndarray) -> _Pairs:
        n, size = len(positions), 2 * MAX_LAG + 1
        pairs = cKDTree(positions).query_pairs(MAX_LAG * 1.5, output_type="ndarray")
        both = np.concatenate([np.repeat(np.arange(n)[:, None], 2, axis=1), pairs])
        lag = np.rint(positions[both[:, 1]] - positions[both[:, 0]]).astype(int)
        near = (np.abs(lag) <= MAX_LAG).all(axis=1) & ((lag != 0).any(axis=1) | (both[:, 0] == both[:, 1]))
        both, lag = both[near], lag[near]
        place = (lag[:, 1] + MAX_LAG) * size + lag[:, 0] + MAX_LAG
        return cls(both[:, 0], both[:, 1], place, np.linalg.qr(_smooth(positions))[0])

    def covariance(self, residuals: Sequence[np.ndarray]) -> np.ndarray:
        """C by distance, zero beyond the rings that are fitted  # (2 L + 1, 2 L + 1)"""
        seen = self._means([residual[self.first] * residual[self.second] for residual in residuals])
        support = _support(seen.reshape(2 * MAX_LAG + 1, -1) / seen.max()).ravel()
        fitted = np.where(support, seen, 0.0)
        for _ in range(SWEEPS):
            change = np.where(support, seen - self._means([self._projected(fitted)[:, None]]), 0.0)
            fitted = fitted + change
            if np.abs(change).max() < MIN_CHANGE * fitted.max():
                break
        return fitted.reshape(2 * MAX_LAG + 1, -1)

    def _means(self, products: Sequence[np.ndarray]) -> np.ndarray:
        """Mean of products (m, c) by distance, NaN left out  # ((2 L + 1)²,)"""
        size = (2 * MAX_LAG + 1) ** 2
        total, count = np.zeros(size), np.zeros(size)
        for product in products:
            for column in product.T:
                known = np.isfinite(column)
                total += np.bincount(self.place[known], column[known], size)
                count += np.bincount(self.place[known], minlength=size)
        total, count = total + total[::-1], count + count[::-1]
        return total / np.maximum(count, 1.0)

    def _projected(self, covariance: np.ndarray) -> np.ndarray:
        """(P C P) of every pair, P = 1 - Q Qᵀ  # (m,)"""
        values, n, Q = covariance[self.place], len(self.Q), self.Q
        half = sparse.csr_array((values, (self.first, self.second)), shape=(n, n))
        CQ = half @ Q + half.T @ Q - values[:n, None] * Q  # the first n pairs are the points themselves
        crossed = CQ - 0.5 * Q @ (Q.T @ CQ)  # P C P = C - Q Rᵀ - R Qᵀ with R = C Q - Q (Qᵀ C Q) / 2
        i, j = self.first, self.second
        taken = np.einsum("mk,mk->m", Q[i], crossed[j])
        return values - taken - np.einsum("mk,mk->m", crossed[i], Q[j])


def _support(correlation: np.ndarray) -> np.ndarray:
    """The rings of equal distance up to one beyond those with a mean correlation above `MIN_CORRELATION`  # bool"""
    row, column = np.indices(correlation.shape) - MAX_LAG
    ring = np.maximum(np.abs(row), np.abs(column))
    above = [correlation[ring == k].mean() >= MIN_CORRELATION for k in range(1, MAX_LAG + 1)]
    last = above.index(False) if False in above else MAX_LAG - 1
    return ring <= (last + 1 if last else 0)
