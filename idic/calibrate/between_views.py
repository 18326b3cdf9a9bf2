"""Scatter between views: what a view alone would change in the cameras, beyond the scatter of its points.

Errors common to a view (focus, a bent target, exposure in motion, cameras that are not simultaneous) move all its
points together. Each view's equations are reduced by its pose, as in a Schur complement; what remains of its residuals
is a score g and a matrix A of the shared unknowns. Leaving the view out would change these by -(sum A - A)^-1 g, the
linearised jackknife (B. Efron, The Jackknife, the Bootstrap and Other Resampling Plans, 1982, chapter 3).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2, f as f_distribution, t as t_distribution

from idic.calibrate.projection import N_POSE
from idic.calibrate.records import Between, Lens, SIGNIFICANCE, Scatter

NORMAL_95 = 1.959964  # standard deviations of an interval of 95 %
_RANK = 1e-10  # of the largest eigenvalue: unknowns that a single view does not determine


@dataclass(frozen=True, eq=False)
class _Reduced:
    """Equations of a view without its pose: score (m,), matrix (m, m), the sum of squares behind it, their number."""

    score: np.ndarray
    matrix: np.ndarray
    squares: float
    number: int

    def explained(self) -> tuple[float, int]:
        """Squares that cameras of its own would explain, and how many unknowns of these it determines."""
        values, vectors = np.linalg.eigh(self.matrix)
        good = values > _RANK * max(float(values[-1]), 1e-300)
        return float(((vectors[:, good].T @ self.score)**2 / values[good]).sum()), int(good.sum())


def between_views(rows: dict[tuple[int, int], np.ndarray], errors: dict[tuple[int, int], np.ndarray], n_cameras: int,
                  lens: Lens, n_shared: int, prior: np.ndarray) -> Between:
    """The scatter between views of an adjustment at its end.

    Parameters
    ----------
    rows : {(view, camera): array (2 n, n_shared + 6)}
        Derivatives of the projected coordinates by the shared unknowns, then by the pose of the view.
    errors : {(view, camera): array (2 n,)}
        Seen minus projected, px.
    n_shared : int
        Unknowns of all cameras and free target points.
    prior : array (n_shared, n_shared)
        Weight of the prior of free target points, in units of the matrices.
    """
    views = sorted({view for view, _ in rows})
    cameras_of = {view: [camera for camera in range(n_cameras) if (view, camera) in rows] for view in views}
    scale = 1.0 / np.sqrt(sum((part[:, :n_shared]**2).sum(axis=0) for part in rows.values()) + np.diag(prior))
    lens_columns = [slice(c * len(lens.identified) + N_POSE * max(c - 1, 0),
                          (c + 1) * len(lens.identified) + N_POSE * max(c - 1, 0)) for c in range(n_cameras)]
    singles = {(view, camera): _reduced(part[:, :n_shared] * scale, part[:, n_shared:], errors[view, camera])
               for (view, camera), part in rows.items()}
    own_lenses = {key: _Reduced(single.score[lens_columns[key[1]]],
                                single.matrix[lens_columns[key[1]], lens_columns[key[1]]], single.squares,
                                single.number)
                  for key, single in singles.items()}
    noise = {key: _noise(single) for key, single in own_lenses.items()}
    joint = {view: _joint(view, cameras_of[view], rows, errors, noise, n_shared, scale) for view in views}
    equal = {view: _joint(view, cameras_of[view], rows, errors, dict.fromkeys(noise, 1.0), n_shared, scale)
             for view in views}  # in px, as the adjustment weights them
    all_views = _scatter(list(joint.values()), n_shared)
    covariance, total = _within(equal, cameras_of, noise, prior * (scale[:, None] * scale))
    if all_views.is_significant:
        covariance = _with_scatter(covariance, list(equal.values()), total)
    by_camera = tuple(_camera_scatter([own_lenses[key] for key in own_lenses if key[1] == c],
                                      [noise[key] for key in own_lenses if key[1] == c]) for c in range(n_cameras))
    paired = [view for view in views if len(cameras_of[view]) == n_cameras == 2]
    pairs = _pair_scatter(paired, joint, singles, noise) if len(paired) > 1 else None
    within = float(np.sqrt(np.mean([value**2 for value in noise.values()])))
    return Between(covariance * scale[:, None] * scale, within, all_views, by_camera, pairs)


def _reduced(shared: np.ndarray, pose: np.ndarray, errors: np.ndarray) -> _Reduced:
    """The equations of a view after its pose has taken what it can."""
    basis, _ = np.linalg.qr(pose)
    shared, rest_px = shared - basis @ (basis.T @ shared), errors - basis @ (basis.T @ errors)
    return _Reduced(shared.T @ rest_px, shared.T @ shared, float(rest_px @ rest_px), len(errors) - pose.shape[1])


def _noise(single: _Reduced) -> float:
    """Standard deviation of a coordinate about the best lens and pose for one image alone, px."""
    squares, number = single.explained()
    return float(np.sqrt(max(single.squares - squares, 1e-30) / max(single.number - number, 1)))


def _joint(view: int, cameras: list[int], rows, errors, noise, n_shared: int, scale: np.ndarray) -> _Reduced:
    """The images of a view with their common pose, each in units of its noise."""
    stacked = np.vstack([rows[view, c] / noise[view, c] for c in cameras])
    return _reduced(stacked[:, :n_shared] * scale, stacked[:, n_shared:],
                    np.concatenate([errors[view, c] / noise[view, c] for c in cameras]))


def _within(equal: dict[int, _Reduced], cameras_of: dict[int, list[int]], noise: dict[tuple[int, int], float],
            prior: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The covariance by the noise of the points of each view, and the matrix of all views."""
    variances = {view: float(np.mean([noise[view, c]**2 for c in cameras_of[view]])) for view in equal}
    if not _differ(list(equal.values()), list(variances.values())):
        common = _Reduced(sum((view.score for view in equal.values()), np.zeros(len(prior))),
                          sum((view.matrix for view in equal.values()), prior), 0.0, 0)
        squares = sum(view.squares for view in equal.values()) - common.explained()[0]
        pooled = squares / max(sum(view.number for view in equal.values()) - len(prior), 1)
        variances = dict.fromkeys(variances, pooled)
    total = sum((view.matrix for view in equal.values()), prior)
    middle = sum((variances[number] * view.matrix for number, view in equal.items()),
                 prior * float(np.mean(list(variances.values()))))
    inverse = np.linalg.inv(total)
    return inverse @ middle @ inverse, total


def _differ(views: list[_Reduced], variances: list[float]) -> bool:
    """Whether some views are noisier than others: Bartlett's test (M. S. Bartlett, Proc. R. Soc. A 160, 1937)."""
    freedom = np.array([max(view.number, 1) for view in views], dtype=float)
    pooled = float(freedom @ variances) / freedom.sum()
    statistic = float(freedom.sum() * np.log(pooled) - freedom @ np.log(variances))
    return bool(chi2.sf(statistic, max(len(views) - 1, 1)) < SIGNIFICANCE)


def _scatter(views: list[_Reduced], n_common: int) -> Scatter:
    """What cameras of every view's own explain, per unknown, in squares of its noise."""
    explained = [view.explained() for view in views]
    common = _Reduced(sum((view.score for view in views), np.zeros_like(views[0].score)),
                      sum((view.matrix for view in views), np.zeros_like(views[0].matrix)), 0.0, 0)
    squares = sum(part for part, _ in explained) - common.explained()[0]
    number = max(sum(n for _, n in explained) - n_common, 1)
    return _compared(squares, number, sum(view.number for view in views) - number)


def _camera_scatter(images: list[_Reduced], noise: list[float]) -> Scatter:
    scaled = [_Reduced(image.score / s**2, image.matrix / s**2, image.squares / s**2, image.number)
              for image, s in zip(images, noise, strict=True)]
    return _scatter(scaled, len(scaled[0].score))


def _pair_scatter(paired: list[int], joint, singles, noise) -> Scatter:
    """What poses of each camera's own explain beyond those common to both."""
    squares = sum(joint[view].squares - sum(singles[view, c].squares / noise[view, c]**2 for c in (0, 1))
                  for view in paired)
    number = N_POSE * (len(paired) - 1)
    return _compared(squares, number, sum(singles[view, c].number for view in paired for c in (0, 1)))


def _compared(squares: float, number: int, n_within: int) -> Scatter:
    ratio = max(squares, 0.0) / number
    return Scatter(ratio, float(f_distribution.sf(ratio, number, max(n_within, 1))))


def _with_scatter(covariance: np.ndarray, views: list[_Reduced], total: np.ndarray) -> np.ndarray:
    """The covariance with the variances of the jackknife, widened for their few views, where these are larger.

    The correlations are those of the larger of both in every direction, so that the matrix stays positive definite
    where there are fewer views than unknowns.
    """
    n = len(views)
    changes = np.array([np.linalg.lstsq(total - view.matrix, view.score, rcond=1e-12)[0] for view in views])
    jackknife = (n - 1) / n * changes.T @ changes
    widening = float(t_distribution.ppf(0.975, n - 1)) / NORMAL_95
    variances = np.maximum(np.diag(jackknife) * widening**2, np.diag(covariance))
    root = np.linalg.cholesky(covariance)
    inverse_root = np.linalg.inv(root)
    values, vectors = np.linalg.eigh(inverse_root @ jackknife @ inverse_root.T)
    larger = root @ (vectors * np.maximum(values, 1.0)) @ vectors.T @ root.T
    size = np.sqrt(variances / np.diag(larger))
    return larger * size[:, None] * size
