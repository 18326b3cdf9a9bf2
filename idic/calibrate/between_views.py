"""Scatter between views: what a view alone would change in the cameras, beyond the scatter of its points.

Errors common to a view (focus, exposure in motion, cameras that are not simultaneous) move all its points together.
Each view's equations are reduced by its pose, as in a Schur complement; what remains of its residuals is a score g and
a matrix A of the shared unknowns. Leaving the view out would change these by -(sum A - A)^-1 g, the linearised
jackknife (B. Efron, The Jackknife, the Bootstrap and Other Resampling Plans, 1982, chapter 3).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.stats import f as f_distribution, t as t_distribution

from idic.calibrate.image_noise import Image, Linear, lens_columns
from idic.calibrate.projection import N_POSE
from idic.calibrate.records import Between, Lens, Scatter

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

    def over(self, noise: float) -> _Reduced:
        """In units of a noise."""
        return _Reduced(self.score / noise**2, self.matrix / noise**2, self.squares / noise**2, self.number)


def between_views(images: Mapping[Image, Linear], noise: Mapping[Image, float], n_cameras: int, lens: Lens,
                  prior: np.ndarray) -> Between:
    """The scatter between views of an adjustment at its end.

    Parameters
    ----------
    images : {(view, camera): Linear}
    noise : {(view, camera): float}
        Standard deviation of a coordinate by which the adjustment weighted each image, px.
    prior : array (m,)
        Weight (one over the variance) of the prior of each shared unknown.
    """
    scale, joint = _views(images, noise, prior)
    single = {key: _reduced(image.shared * scale, image.pose, image.errors_px).over(noise[key])
              for key, image in images.items()}
    lens_alone = {key: _Reduced(part.score[lens_columns(key[1], lens)],
                                part.matrix[lens_columns(key[1], lens)][:, lens_columns(key[1], lens)],
                                part.squares, part.number) for key, part in single.items()}
    all_views = _scatter(list(joint.values()), len(prior))
    covariance = _covariance(list(joint.values()), np.diag(prior * scale**2), all_views)
    by_camera = tuple(_scatter([lens_alone[key] for key in lens_alone if key[1] == c], len(lens.identified))
                      for c in range(n_cameras))
    paired = [view for view in joint if n_cameras == 2 and (view, 0) in images and (view, 1) in images]
    pairs = _pair_scatter(paired, joint, single) if len(paired) > 1 else None
    within = float(np.sqrt(np.mean([value**2 for value in noise.values()])))
    return Between(covariance * scale[:, None] * scale, within, all_views, by_camera, pairs)


def by_points(images: Mapping[Image, Linear], noise: Mapping[Image, float], prior: np.ndarray
              ) -> tuple[np.ndarray, np.ndarray]:
    """The change of the shared unknowns that the linearised equations ask for, and its covariance by the points of the
    views alone  # (m,), (m, m)
    """
    scale, joint = _views(images, noise, prior)
    every = _sum(list(joint.values()))
    inverse = np.linalg.inv(every.matrix + np.diag(prior * scale**2))
    return scale * (inverse @ every.score), inverse * scale[:, None] * scale


def _views(images: Mapping[Image, Linear], noise: Mapping[Image, float], prior: np.ndarray
           ) -> tuple[np.ndarray, dict[int, _Reduced]]:
    """A unit of every shared unknown, and the equations of every view in these: its images with their common pose, each
    in units of its noise.
    """
    scale = 1.0 / np.sqrt(sum((image.shared**2).sum(axis=0) / noise[key]**2 for key, image in images.items()) + prior)
    views: dict[int, list[Image]] = {}
    for view, camera in sorted(images):
        views.setdefault(view, []).append((view, camera))
    return scale, {view: _reduced(np.vstack([images[key].shared / noise[key] for key in keys]) * scale,
                                  np.vstack([images[key].pose / noise[key] for key in keys]),
                                  np.concatenate([images[key].errors_px / noise[key] for key in keys]))
                   for view, keys in views.items()}


def _reduced(shared: np.ndarray, pose: np.ndarray, errors: np.ndarray) -> _Reduced:
    """The equations of a view after its pose has taken what it can."""
    basis, _ = np.linalg.qr(pose)
    shared, rest_px = shared - basis @ (basis.T @ shared), errors - basis @ (basis.T @ errors)
    return _Reduced(shared.T @ rest_px, shared.T @ shared, float(rest_px @ rest_px), len(errors) - pose.shape[1])


def _scatter(views: list[_Reduced], n_common: int) -> Scatter:
    """What cameras of every view's own explain, per unknown, in squares of its noise."""
    explained = [view.explained() for view in views]
    squares = sum(part for part, _ in explained) - _sum(views).explained()[0]
    number = max(sum(n for _, n in explained) - n_common, 1)
    return _compared(squares, number, sum(view.number for view in views) - number)


def _sum(views: list[_Reduced]) -> _Reduced:
    return _Reduced(np.sum([view.score for view in views], axis=0), np.sum([view.matrix for view in views], axis=0),
                    sum(view.squares for view in views), sum(view.number for view in views))


def _pair_scatter(paired: list[int], joint: Mapping[int, _Reduced], single: Mapping[Image, _Reduced]) -> Scatter:
    """What poses of each camera's own explain beyond those common to both."""
    squares = sum(joint[view].squares - sum(single[view, c].squares for c in (0, 1)) for view in paired)
    number = N_POSE * (len(paired) - 1)
    return _compared(squares, number, sum(single[view, c].number for view in paired for c in (0, 1)))


def _compared(squares: float, number: int, n_within: int) -> Scatter:
    ratio = max(squares, 0.0) / number
    return Scatter(ratio, float(f_distribution.sf(ratio, number, max(n_within, 1))))


def _covariance(views: list[_Reduced], prior: np.ndarray, all_views: Scatter) -> np.ndarray:
    """Of the shared unknowns, with the scatter between views where it is significant."""
    every = _sum(views)
    inverse = np.linalg.inv(every.matrix + prior)
    if all_views.is_significant:
        return _with_scatter(inverse, views, every.matrix + prior)
    squares = every.squares - every.explained()[0]
    return inverse * squares / max(every.number - len(prior), 1)


def _with_scatter(covariance: np.ndarray, views: list[_Reduced], total: np.ndarray) -> np.ndarray:
    """The covariance by the points, and by the directions in which the views scatter more than these say.

    The changes of the jackknife in units of the covariance by the points are noise of one variance and some directions
    with more: probabilistic principal components (M. E. Tipping, C. M. Bishop, J. R. Stat. Soc. B 61, 1999), those
    beyond the edge of noise (V. A. Marchenko, L. A. Pastur, Math. USSR Sb. 1, 1967), each without what noise adds to
    it (D. Paul, Stat. Sinica 17, 2007). The variance of a direction is known from the views alone: the interval of
    every unknown is widened as Student's, by the degrees of freedom of F. E. Satterthwaite (Biometrics 2, 1946).
    """
    n, m = len(views), len(total)
    root = np.linalg.cholesky(covariance)
    changes = np.array([_without_view(view, total) for view in views])
    changes = np.sqrt((n - 1) / n) * np.linalg.solve(root, (changes - changes.mean(axis=0)).T)  # (m, n)
    vectors, sizes, _ = np.linalg.svd(changes, full_matrices=False)
    squares, ratio = sizes**2, m / (n - 1)
    noise, n_directions = 1.0, 1
    for _ in range(n):
        n_directions = max(int((squares > noise * (1.0 + np.sqrt(ratio))**2).sum()), 1)
        noise = max(float(squares[n_directions:].sum()) / max(m - n_directions, 1), 1.0)
    excess = np.array([_without_noise(square / noise, ratio) for square in squares[:n_directions]]) * noise
    directions = (root @ vectors[:, :n_directions]) * np.sqrt(excess)
    parts = directions**2  # (m, n_directions): of the variance of every unknown
    variances = noise * np.diag(covariance) + parts.sum(axis=1)
    freedom = (n - 1) * variances**2 / np.maximum((parts**2).sum(axis=1), 1e-300)
    widening = t_distribution.ppf(0.975, np.minimum(freedom, 1e6)) / NORMAL_95
    return (noise * covariance + directions @ directions.T) * widening[:, None] * widening


def _without_view(view: _Reduced, total: np.ndarray) -> np.ndarray:
    """Change of the unknowns where the view is left out; none in what the view alone determines."""
    values, vectors = np.linalg.eigh(total - view.matrix)
    good = values > _RANK * float(values[-1])
    return vectors[:, good] @ (vectors[:, good].T @ view.score / values[good])


def _without_noise(square: float, ratio: float) -> float:
    """The variance of a direction beyond that of noise, from its mean square in units of noise."""
    middle = square + 1.0 - ratio
    root = middle**2 - 4.0 * square
    return max(0.5 * (middle + np.sqrt(root)) - 1.0 if root > 0.0 else np.sqrt(ratio), 0.0)
