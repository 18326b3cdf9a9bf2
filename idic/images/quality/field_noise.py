"""Noise of a measured field, from its stages: standard deviation, and correlation between neighbours.

Subsets of a DIC overlap and filters smooth, so that neighbouring points share their noise. A stage is predicted from
the stages before and after it and from a quadratic polynomial of the position; the rest is noise:

    v_t = a v_(t-1) + b v_(t+1) + polynomial + noise,      variance s² [1 + a² + b² + (1 - a - b)²/N]

(docs/method.md, equations 15.2 and 15.3). This removes motion that is smooth in time and fields that grow in
proportion. The fit also removes a part of correlated noise, most where points are few: with the projection P onto the
residual of the fit, the covariance C is the one for which P C P reproduces the observed sums of products (equation
15.4). Noise that a whole stage shares (a shift, a stretch) is not visible here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from scipy import sparse

from idic.images.stack import Stack

MAX_STAGES = 24  # looked at, spread over the test
MAX_LAG = 6  # distances of neighbours
LENGTHS = 0.5 * 2.0 ** (0.25 * np.arange(17))  # of a smoothing filter, in distances of neighbours: 0.5 to 8
SUBSET_LENGTHS = 3.0  # of these: width of a subset whose noise is correlated about as far
MAX_LENGTH_PART = 0.25  # of the shorter side of the field: longer waves are those of the fit
MIN_CORRELATION = 0.05  # of next neighbours: below, noise is independent from point to point
MIN_GAIN = 9.0  # chi-square by a further term
MIN_POINTS, MIN_STAGES = 40, 3
MAX_VARIANCE_RATIO = 2.0  # of what is left of a stage to the median of the stages: more is motion


@dataclass(frozen=True, eq=False)
class FieldNoise:
    """Noise of one component of a point.

    std : of a point; sum_std : of independent noise that gives sums against a uniform strain the same scatter;
    correlation : (2 L + 1, 2 L + 1) of points so many rows and columns apart, 1 in the middle
    """

    std: float
    sum_std: float
    correlation: np.ndarray

    @classmethod
    def of(cls, stack: Stack, positions: np.ndarray, frames: Sequence[int], reference: int,
           n_references: int = 1) -> FieldNoise | None:
        """Noise from the stages of a test; None where there are too few points or stages.

        Parameters
        ----------
        stack : frames of (n_points, c), NaN where not measured
        positions : (n_points, 2) in distances of neighbours
        frames : stages that count, in order, the reference among them
        reference : the stage that displacements count from; n_references : stages averaged to it
        """
        frames = list(frames)
        if len(frames) < MIN_STAGES or len(positions) < MIN_POINTS:
            return None
        middle = [k for k in range(1, len(frames) - 1) if frames[k] != reference]
        places = np.linspace(0, len(middle) - 1, min(MAX_STAGES, len(middle)))
        chosen = [middle[k] for k in np.unique(places.astype(int))]
        residuals = [_stage_residual(stack, positions, frames[k - 1], frames[k], frames[k + 1], reference, n_references)
                     for k in chosen]
        stages = [stage for stage in residuals if stage is not None]
        variances = [float(np.mean(stage.noise[stage.measured] ** 2)) for stage in stages]
        if not variances or not float(np.median(variances)) > 0.0:
            return None
        most = MAX_VARIANCE_RATIO * float(np.median(variances))
        quiet_stages = [stage for stage, variance in zip(stages, variances, strict=True) if variance <= most]
        covariance = _covariance(positions, quiet_stages)
        variance = float(covariance[MAX_LAG, MAX_LAG])
        if not variance > 0.0:  # computed fields
            return None
        correlation = covariance / variance
        sum_variance = variance * _sum_ratio(positions, correlation)
        return cls(float(np.sqrt(variance)), float(np.sqrt(sum_variance)), correlation)


def _sum_ratio(positions: np.ndarray, correlation: np.ndarray) -> float:
    """Variance of a sum against a uniform strain over that of independent noise, the mean of both axes.

    It is smaller than the sum of the correlation (by a quarter for overlaps of three distances on 12 x 18 points):
    points at an edge, which count most, have neighbours on one side only. positions : (n_points, 2), correlation as in
    `FieldNoise`.
    """
    pairs, place = _pairs(positions)
    shared = np.zeros(int(_lags().max()) + 1)
    shared[_lags().ravel()] = correlation.ravel()
    strains = positions - positions.mean(axis=0)
    products = shared[place] @ (strains[pairs[:, 0]] * strains[pairs[:, 1]])
    return max(float(np.mean(products / np.maximum((strains**2).sum(axis=0), 1e-300))), 1.0)


@dataclass(frozen=True, eq=False)
class _Stage:
    """What the fit of a stage leaves.

    noise : (n_points, c), as large as the stage's own noise, 0 where it is not measured; measured : (n_points,) bool;
    fitted : (n_points, c, k) orthonormal columns of the fit, all components of all points together
    """

    noise: np.ndarray
    measured: np.ndarray
    fitted: np.ndarray


def _smooth(positions: np.ndarray) -> np.ndarray:
    """Polynomials of the second degree  # (n, 6)"""
    x, y = (positions - positions.mean(axis=0)).T / max(float(np.ptp(positions, axis=0).max()), 1e-300)
    return np.column_stack([np.ones(len(x)), x, y, x * x, x * y, y * y])


def _stage_residual(stack: Stack, positions, previous_frame: int, frame: int, next_frame: int, reference: int,
          n_references: int) -> _Stage | None:
    """What the neighbours in time and a polynomial leave of a stage."""
    field = np.asarray(stack.frame(frame), float)
    c = field.shape[1]
    fields = [field if k == frame else np.zeros_like(field) if k == reference else np.asarray(stack.frame(k), float)
              for k in (previous_frame, frame, next_frame)]
    measured = np.isfinite(np.hstack(fields)).all(axis=1)
    n = int(measured.sum())
    if n < MIN_POINTS:
        return None
    smooth = _smooth(positions[measured])
    previous, value, following = (field[measured].T.ravel() for field in fields)  # columns first, then rows
    neighbours = [column for column in (previous, following) if column.any()]
    columns = np.column_stack([np.kron(np.eye(c), smooth), *neighbours])
    columns = columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    factors = np.linalg.lstsq(columns, value, rcond=1e-10)[0]
    shares = factors[c * smooth.shape[1]:] / [max(float(np.linalg.norm(column)), 1e-300) for column in neighbours]
    gain = 1.0 + float(shares @ shares) + (1.0 - float(shares.sum())) ** 2 / n_references
    basis, size, _ = np.linalg.svd(columns, full_matrices=False)
    basis = basis[:, size > 1e-10 * size[0]]
    noise, fitted = np.zeros((len(positions), c)), np.zeros((len(positions), c, basis.shape[1]))
    noise[measured] = (value - columns @ factors).reshape(c, n).T / np.sqrt(gain)
    fitted[measured] = basis.reshape(c, n, -1).transpose(1, 0, 2)
    return _Stage(noise, measured, fitted)


def _covariance(positions: np.ndarray, stages: Sequence[_Stage]) -> np.ndarray:
    """C by distance, zero beyond the rings that are fitted  # (2 L + 1, 2 L + 1)

    With the matrix S_d of all pairs at a distance d, C = sum_d c_d S_d and

        z^T S_e z = sum_d c_d tr(P S_e P S_d)

        tr(P S_e P S_d) = tr(S_e S_d) - 2 (S_e Q)·(S_d Q) + (Q^T S_e Q)·(Q^T S_d Q)

    summed over the stages.
    """
    pairs, place = _pairs(positions)
    n, n_lags = len(positions), int(_lags().max()) + 1
    pair_matrix = sparse.csr_array((np.ones(len(pairs)), (place * n + pairs[:, 0], pairs[:, 1])), shape=(n_lags * n, n))
    matrix, pair_sums = np.zeros((n_lags, n_lags)), np.zeros(n_lags)
    for stage in stages:
        def across(fields: np.ndarray, measured: np.ndarray = stage.measured) -> np.ndarray:
            """S_d times fields  # (n, m) -> (n_lags, n, m)"""
            return (pair_matrix @ fields).reshape(n_lags, n, -1) * measured[:, None]

        pair_sums += np.einsum("ic,dic->d", stage.noise, across(stage.noise))
        n_pairs = across(stage.measured[:, None].astype(float)).sum(axis=(1, 2))
        matrix[np.diag_indices(n_lags)] += stage.noise.shape[1] * n_pairs
        inner = np.zeros((n_lags, *[stage.fitted.shape[2]] * 2))
        for k, column in enumerate(np.moveaxis(stage.fitted, 2, 0)):  # one by one: all of them would be large
            moved = across(column).reshape(n_lags, -1)
            inner[:, :, k] = moved @ stage.fitted.reshape(stage.noise.size, -1)
            matrix -= 2.0 * moved @ moved.T
        inner = inner.reshape(n_lags, -1)
        matrix += inner @ inner.T
    shorter = float(np.ptp(positions, axis=0).min()) + 1.0
    return _fitted(matrix, pair_sums, LENGTHS[: max(int((MAX_LENGTH_PART * shorter >= LENGTHS).sum()), 1)])


def _lags() -> np.ndarray:
    """Number of the distance of every place of the square of 2 L + 1 rows and columns, opposite ones alike."""
    size = 2 * MAX_LAG + 1
    flat = np.arange(size**2)
    return ((size**2 - 1) // 2 - np.minimum(flat, flat[::-1])).reshape(size, size)


def _pairs(positions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of points, in both orders, themselves included  # (m, 2), and the number of their distance (m,)"""
    neighbour_pairs = scipy.spatial.cKDTree(positions).query_pairs(MAX_LAG * 1.5, output_type="ndarray")
    self_pairs = np.repeat(np.arange(len(positions))[:, None], 2, axis=1)
    pairs = np.concatenate([self_pairs, neighbour_pairs, neighbour_pairs[:, ::-1]])
    lag = np.rint(positions[pairs[:, 1]] - positions[pairs[:, 0]]).astype(int)
    inside = (np.abs(lag) <= MAX_LAG).all(axis=1) & ((lag != 0).any(axis=1) | (pairs[:, 0] == pairs[:, 1]))
    return pairs[inside], _lags()[lag[inside, 1] + MAX_LAG, lag[inside, 0] + MAX_LAG]


def _fitted(matrix: np.ndarray, pair_sums: np.ndarray, lengths: np.ndarray) -> np.ndarray:
    """The covariance by independent noise and up to two smooth parts, as few as do  # (2 L + 1, 2 L + 1)

    A part is that of a Gaussian filter, or the overlap of square subsets. Waves about as long as the field are mostly
    taken by its fit: they follow from the shape of the near neighbours.
    """
    number = _lags()
    lags = np.zeros((len(pair_sums), 2))
    lags[number.ravel()] = (np.indices(number.shape) - MAX_LAG).reshape(2, -1).T
    squared = (lags**2).sum(axis=1)
    # products of n independent pairs scatter by its root
    weight = 1.0 / np.sqrt(2.0 * np.maximum(np.diagonal(matrix), 1.0))
    white = (squared == 0.0).astype(float)[:, None]
    overlaps = np.clip(1.0 - np.abs(lags)[:, :, None] / (SUBSET_LENGTHS * lengths), 0.0, None).prod(axis=1)
    shapes = np.hstack([np.exp(-squared[:, None] / (4.0 * lengths**2)), overlaps])

    def fit(columns: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        """Squares that are left, covariance by distance, columns."""
        amplitudes, residual_norm = scipy.optimize.nnls(weight[:, None] * (matrix @ columns), weight * pair_sums)
        return residual_norm**2, columns @ amplitudes, columns

    def wider(columns: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        """With one more part, the best one."""
        return min((fit(np.column_stack([columns, candidate])) for candidate in shapes.T),
                   key=lambda candidate: candidate[0])

    best = min(fit(white), wider(white[:, :0]), key=lambda candidate: candidate[0])
    wider_fit = wider(white)
    best = wider_fit if _is_needed(wider_fit, best, number) else best
    if best[2].shape[1] == 2:
        wider_fit = wider(best[2])
        best = wider_fit if _is_needed(wider_fit, best, number) else best
    covariance = best[1]
    return (covariance
            if covariance[squared == 1.0].mean() > MIN_CORRELATION * covariance[0] else fit(white)[1])[number]


def _is_needed(wider_fit: tuple, narrower_fit: tuple, number: np.ndarray) -> bool:
    """Whether a fit gains on another one more than noise; products of correlated noise scatter together."""
    return narrower_fit[0] - wider_fit[0] > MIN_GAIN * float((wider_fit[1][number] ** 2).sum())
