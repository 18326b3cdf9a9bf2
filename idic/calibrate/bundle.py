"""Bundle adjustment: lenses, poses and what is free of the target, with the smallest reprojection error."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from idic.calibrate.levenberg import minimum
from idic.calibrate.projection import (
    Derivatives, N_POSE, derivatives, dot_shift, in_camera_0, magnification, moved, n_unknowns,
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
    shape_mm = np.zeros(n_shape)
    shape_mm[: len(state.shape_mm)] = state.shape_mm
    state = replace(state, shape_mm=shape_mm)
    cameras_points = seen_points(views)
    radius = dot_radius(state, views)
    weights = [np.repeat([1.0 / noise_px[v, c] if noise_px else 1.0 for v in points.views], points.sizes)
               for c, points in enumerate(cameras_points)]
    for _ in range(SHIFT_PASSES if radius and not rough else 1):
        equations = _Equations(state, cameras_points, lens, radius, target, weights)
        step = minimum(equations.distances, equations.normal_equations, n_unknowns(state, lens, target),
                       START_TOLERANCE if rough else TOLERANCE)
        state = moved(state, lens, step, target)
    equations_at_end = _Equations(state, cameras_points, lens, radius, target, weights)
    zero_step = np.zeros(len(step))
    errors = equations_at_end.distances(zero_step)
    normal, _ = equations_at_end.normal_equations(zero_step, errors)
    residuals: list[list[np.ndarray | None]] = [[None] * len(row) for row in views]
    for c, (points, part) in enumerate(zip(cameras_points, equations_at_end.parts(errors), strict=True)):
        for v, error in zip(points.views, points.split(-part / weights[c][:, None]), strict=True):
            residuals[v][c] = error
    scale = 1.0 / np.sqrt(np.diag(normal))
    cofactor = np.linalg.inv(normal * scale[:, None] * scale) * scale[:, None] * scale
    carried = float((np.diag(cofactor)[len(step) - n_shape :] / target.prior_std_mm**2).sum())
    return Adjusted(state, tuple(tuple(row) for row in residuals), cofactor, carried)


@dataclass(frozen=True, eq=False)
class SeenPoints:
    """The points that one camera sees, one view after the other.

    Attributes
    ----------
    views : tuple of int
        Numbers of the views in which it sees the target.
    sizes : tuple of int
        Points of each.
    numbers : int array (n,)
        Of the target points.
    points_px : array (n, 2)
    """

    views: tuple[int, ...]
    sizes: tuple[int, ...]
    numbers: np.ndarray
    points_px: np.ndarray

    @property
    def view_of(self) -> np.ndarray:
        """The view of every point  # int (n,)"""
        return np.repeat(self.views, self.sizes)

    def split(self, array: np.ndarray) -> list[np.ndarray]:
        """An array over the points, one part per view."""
        return np.split(array, np.cumsum(self.sizes)[:-1])


def seen_points(views: Views) -> list[SeenPoints]:
    """Per camera."""
    cameras = []
    for c in range(len(views[0])):
        chosen = {v: view for v, row in enumerate(views) if (view := row[c]) is not None}
        cameras.append(SeenPoints(tuple(chosen), tuple(view.n for view in chosen.values()),
                                  np.concatenate([view.index[:, 0] for view in chosen.values()]),
                                  np.vstack([view.points_px for view in chosen.values()])))
    return cameras


class _Equations:
    """Distances and their normal equations as functions of a step from a state; the shifts of the dots are those of
    the state."""

    def __init__(self, base, cameras_points, lens, radius_mm, target, weights):
        self.base, self.points, self.lens, self.target, self.weights = base, cameras_points, lens, target, weights
        self.prior = 1.0 / target.prior_std_mm
        self.view_of = [points.view_of for points in cameras_points]
        self.pixels = [points.points_px for points in cameras_points]
        if radius_mm:  # what is seen is the centroid
            self.pixels = [points.points_px - np.vstack([
                dot_shift(base.cameras[c], base.poses[v], base.points_mm[numbers], radius_mm)
                for v, numbers in zip(points.views, points.split(points.numbers), strict=True)])
                for c, points in enumerate(cameras_points)]

    def distances(self, step):
        """Projected minus seen in units of the noise, then the unknowns of the target in those of their prior."""
        try:
            state, parts = moved(self.base, self.lens, step, self.target), []
            for c, points in enumerate(self.points):
                space = np.vstack([in_camera_0(state.poses[v], state.points_mm[numbers]) for v, numbers
                                   in zip(points.views, points.split(points.numbers), strict=True)])
                parts.append((state.cameras[c].project(space) - self.pixels[c]) * self.weights[c][:, None])
        except InputError:  # a trial step with a point behind a camera: it is cut
            return np.full(1, np.inf)
        return np.concatenate([*(part.ravel() for part in parts), state.shape_mm * self.prior])

    def parts(self, distances):
        """The distances of the points of each camera  # (n, 2)"""
        ends = np.cumsum([2 * len(points.numbers) for points in self.points])
        return [part.reshape(-1, 2) for part in np.split(distances[: ends[-1]], ends[:-1])]

    def normal_equations(self, step, distances):
        """J^T J and J^T distances."""
        state = moved(self.base, self.lens, step, self.target)
        n, n_shape, n_poses = len(step), len(self.prior), N_POSE * len(state.poses)
        normal, gradient = np.zeros((n, n)), np.zeros(n)
        for c, (points, part) in enumerate(zip(self.points, self.parts(distances), strict=True)):
            slopes = derivatives(state, self.lens, step, self.target, c, self.view_of[c], points.numbers)
            _add(normal, gradient, slopes, points, part, self.weights[c], n - n_shape - n_poses,
                 n - n_shape + self.target.n_modes if self.target.n_free_points else None)
        prior = np.arange(n - n_shape, n)
        normal[prior, prior] += self.prior**2
        gradient[prior] += self.prior * distances[len(distances) - n_shape :]
        return normal, gradient


def _add(normal: np.ndarray, gradient: np.ndarray, slopes: Derivatives, points: SeenPoints, distances: np.ndarray,
         weights: np.ndarray, first_pose: int, first_point: int | None) -> None:
    """Add the equations of a camera to both  # (n, n), (n,), distances (n_points, 2) in the same weights (n_points,)

    The unknowns of a pose move the points of its view alone, those of a free point this point alone.
    """
    columns = slopes.columns
    common = slopes.common * weights[:, None, None]
    flat = common.reshape(-1, len(columns))
    normal[np.ix_(columns, columns)] += flat.T @ flat
    gradient[columns] += flat.T @ distances.ravel()
    for v, numbers, rows, pose, by_point, part in zip(
            points.views, *map(points.split, (points.numbers, common, slopes.pose * weights[:, None, None],
                                              slopes.by_point * weights[:, None, None], distances)), strict=True):
        at = slice(first_pose + N_POSE * v, first_pose + N_POSE * (v + 1))
        pose = pose.reshape(-1, N_POSE)
        normal[at, at] += pose.T @ pose
        gradient[at] += pose.T @ part.ravel()
        cross = rows.reshape(-1, len(columns)).T @ pose
        normal[columns, at] += cross
        normal[at, columns] += cross.T
        if first_point is not None:
            places = first_point + 3 * numbers[:, None] + np.arange(3)
            moves = np.r_[columns, np.arange(at.start, at.stop)]
            _add_points(normal, gradient, by_point, part, places, moves,
                        np.concatenate([rows, pose.reshape(-1, 2, N_POSE)], axis=2))


def _add_points(normal, gradient, by_point, distances, places, moves, by_moves):
    """Add the equations of free points, blocks of 3 x 3, and those with the unknowns ``moves`` that move them all."""
    transposed = by_point.transpose(0, 2, 1)
    normal[places[:, :, None], places[:, None, :]] += transposed @ by_point
    gradient[places] += (transposed @ distances[:, :, None])[..., 0]
    cross = transposed @ by_moves  # (n_points, 3, k)
    normal[places[:, :, None], moves] += cross
    normal[moves[:, None, None], places] += cross.transpose(2, 0, 1)


def dot_radius(state: State, views: Views) -> float:
    """Radius of the dots in mm, the median of all; 0 for a chessboard."""
    radii = []
    for v, row in enumerate(views):
        for c, view in enumerate(row):
            if view is not None and view.areas_px is not None:
                space = in_camera_0(state.poses[v], state.points_mm[view.index[:, 0]])
                radii.append(np.sqrt(view.areas_px / magnification(state.cameras[c], state.poses[v], space) / np.pi))
    return float(np.nanmedian(np.concatenate(radii))) if radii else 0.0
