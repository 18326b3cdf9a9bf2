"""Bundle adjustment: lenses, poses and what is free of the target, with the smallest reprojection error."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from idic.calibrate.levenberg import minimum
from idic.calibrate.projection import (
    Derivatives, derivatives, dot_shift, in_camera_0, magnification, moved, n_unknowns,
)
from idic.calibrate.records import Lens, State, Views
from idic.calibrate.shape import Target, exact
from idic.errors import InputError

SHIFT_PASSES = 3            # the shift of a dot's centroid depends on its pose: settled after the second
START_TOLERANCE = 1e-5
TOLERANCE = 1e-10           # of cost and step: far below the standard deviations


@dataclass(frozen=True, eq=False)
class Adjusted:
    """A state with its residuals.

    Attributes
    ----------
    state : State
    residuals_px : per view, per camera: array (n, 2) or None
    cofactor : array (m, m)
        (J^T J)^-1 of all unknowns, of pixels and of the prior of the target.
    n_carried : float
        Number of unknowns that the prior of the target carries instead of the pixels.
    """

    state: State
    residuals_px: tuple[tuple[np.ndarray | None, ...], ...]
    cofactor: np.ndarray
    n_carried: float

    @property
    def all_px(self) -> np.ndarray:
        """Every residual  # (n, 2)"""
        return np.vstack([r for row in self.residuals_px for r in row if r is not None])

    @property
    def noise_px(self) -> float:
        """Standard deviation of one seen coordinate, from the residuals and their degrees of freedom."""
        freedom = self.all_px.size - len(self.cofactor) + self.n_carried
        return float(np.sqrt((self.all_px**2).sum() / max(freedom, 1.0)))

    @property
    def rms_px(self) -> float:
        """Root mean square distance of seen and projected points."""
        return float(np.sqrt((self.all_px**2).sum(axis=1).mean()))


def adjust(state: State, views: Views, lens: Lens, target: Target | None = None,
           noise_px: Mapping[tuple[int, int], float] | None = None, rough: bool = False) -> Adjusted:
    """The state with the smallest sum of squared distances between seen and projected points.

    Parameters
    ----------
    state : State
        The start; its points are the numbers of the views' index (see `numbered`).
    views : Views
        With ``index`` (n, 1): numbers of target points.
    lens : Lens
    target : Target, optional
        What is free of the places of the points; by default nothing.
    noise_px : {(view, camera): float}, optional
        Standard deviation of a seen coordinate in every image: the weight of its points; by default 1.
    rough : bool
        To some thousandths of a pixel only: a start.

    Raises
    ------
    NotConverged
        The adjustment does not settle.
    """
    target = target or exact(state.points_mm)
    n_shape = target.n_unknowns
    known = np.zeros(n_shape)
    known[: len(state.shape_mm)] = state.shape_mm
    state = replace(state, shape_mm=known)
    places = tuple((v, c) for v, row in enumerate(views) for c, view in enumerate(row) if view is not None)
    radius = dot_radius(state, views, places)
    weights = {place: 1.0 / noise_px[place] if noise_px else 1.0 for place in places}
    for _ in range(SHIFT_PASSES if radius and not rough else 1):
        equations = _Equations(state, views, lens, places, radius, target, weights)
        step = minimum(equations.distances, equations.normal_equations, n_unknowns(state, lens, target),
                       START_TOLERANCE if rough else TOLERANCE)
        state = moved(state, lens, step, target)
    equations_at_end = _Equations(state, views, lens, places, radius, target, weights)
    zero_step = np.zeros(len(step))
    errors = equations_at_end.distances(zero_step)
    normal, _ = equations_at_end.normal_equations(zero_step, errors)
    residuals: list[list[np.ndarray | None]] = [[None] * len(row) for row in views]
    for (v, c), part in zip(places, equations_at_end.parts(errors), strict=True):
        residuals[v][c] = -part.reshape(-1, 2) / weights[v, c]
    scale = 1.0 / np.sqrt(np.diag(normal))
    cofactor = np.linalg.inv(normal * scale[:, None] * scale) * scale[:, None] * scale
    carried = float((np.diag(cofactor)[len(step) - n_shape :] / target.prior_std_mm**2).sum())
    return Adjusted(state, tuple(tuple(row) for row in residuals), cofactor, carried)


class _Equations:
    """Distances and their normal equations as functions of a step from a state; the shifts of the dots are those of
    the state."""

    def __init__(self, base, views, lens, places, radius_mm, target, weights):
        self.base, self.lens, self.places, self.target, self.weights = base, lens, places, target, weights
        self.prior = 1.0 / target.prior_std_mm
        self.numbers = {(v, c): views[v][c].index[:, 0] for v, c in places}
        self.pixels = {(v, c): views[v][c].points_px for v, c in places}
        if radius_mm:  # what is seen is the centroid
            for v, c in places:
                points = base.points_mm[self.numbers[v, c]]
                self.pixels[v, c] = self.pixels[v, c] - dot_shift(base.cameras[c], base.poses[v], points, radius_mm)

    def distances(self, step):
        """Projected minus seen in units of the noise, then the unknowns of the target in those of their prior."""
        try:
            moved_state = moved(self.base, self.lens, step, self.target)
            parts = [(moved_state.cameras[c].project(in_camera_0(moved_state.poses[v],
                                                                 moved_state.points_mm[self.numbers[v, c]]))
                      - self.pixels[v, c]).ravel() * self.weights[v, c] for v, c in self.places]
        except InputError:  # a trial step with a point behind a camera: it is cut
            return np.full(1, np.inf)
        return np.concatenate([*parts, moved_state.shape_mm * self.prior])

    def parts(self, distances):
        """The distances of each place."""
        ends = np.cumsum([2 * len(self.numbers[place]) for place in self.places])
        return np.split(distances[: ends[-1]], ends[:-1])

    def normal_equations(self, step, distances):
        """J^T J and J^T distances, one view of a camera after the other."""
        moved_state = moved(self.base, self.lens, step, self.target)
        n, n_shape = len(step), len(self.prior)
        normal, gradient = np.zeros((n, n)), np.zeros(n)
        for (v, c), part in zip(self.places, self.parts(distances), strict=True):
            slopes = derivatives(moved_state, self.lens, step, self.target, v, c, self.numbers[v, c])
            _add(normal, gradient, slopes, part, self.weights[v, c])
        prior = np.arange(n - n_shape, n)
        normal[prior, prior] += self.prior**2
        gradient[prior] += self.prior * distances[len(distances) - n_shape :]
        return normal, gradient


def _add(normal: np.ndarray, gradient: np.ndarray, slopes: Derivatives, distances: np.ndarray, weight: float) -> None:
    """Add the equations of an image to both  # (n, n), (n,), distances (2 n_points,) in the same weight"""
    columns, rows, points = slopes.columns, slopes.rows * weight, slopes.point_columns
    normal[np.ix_(columns, columns)] += rows.T @ rows
    gradient[columns] += rows.T @ distances
    if len(points):  # every point is its own in a view: blocks of 3 x 3
        by_point = slopes.by_point * weight
        normal[points[:, :, None], points[:, None, :]] += by_point.transpose(0, 2, 1) @ by_point
        gradient[points] += (by_point.transpose(0, 2, 1) @ distances.reshape(-1, 2, 1))[..., 0]
        cross = by_point.transpose(0, 2, 1) @ rows.reshape(len(points), 2, -1)  # (n_points, 3, k)
        normal[points[:, :, None], columns] += cross
        normal[columns[:, None, None], points] += cross.transpose(2, 0, 1)


def dot_radius(state: State, views: Views, places) -> float:
    """Radius of the dots in mm, the median of all; 0 for a chessboard."""
    radii = []
    for v, c in places:
        view = views[v][c]
        if view.areas_px is not None:
            space = in_camera_0(state.poses[v], state.points_mm[view.index[:, 0]])
            radii.append(np.sqrt(view.areas_px / magnification(state.cameras[c], state.poses[v], space) / np.pi))
    return float(np.nanmedian(np.concatenate(radii))) if radii else 0.0
