"""Bundle adjustment: lenses, poses and, on demand, target points that minimise the reprojection error."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from idic.calibrate.levenberg import minimum
from idic.calibrate.projection import derivatives, dot_shift, in_camera_0, magnification, moved, n_unknowns
from idic.calibrate.records import Lens, State, Views
from idic.errors import InputError

SHIFT_PASSES = 3            # the shift of a dot's centroid depends on its pose: settled after the second
START_TOLERANCE = 1e-5
OUTLIER = 6.0               # robust standard deviations: no Gaussian error of a point in any calibration
TOLERANCE = 1e-10           # of cost and step: far below the standard deviations


@dataclass(frozen=True, eq=False)
class Adjusted:
    """A state with its residuals.

    Attributes
    ----------
    state : State
    residuals_px : per view, per camera: array (n, 2) or None
    cofactor : array (m, m)
        (J^T J)^-1 of all unknowns, of pixels and, with free points, their prior.
    n_carried : float
        Number of unknowns that the prior of the points carries instead of the pixels.
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


def adjust(state: State, views: Views, lens: Lens, prior_mm: float = 0.0, noise_px: float = 1.0,
           rough: bool = False) -> Adjusted:
    """The state with the smallest sum of squared distances between seen and projected points.

    Parameters
    ----------
    state : State
        The start; its points are the numbers of the views' index (see `numbered`).
    views : Views
        With ``index`` (n, 1): numbers of target points.
    lens : Lens
    prior_mm : float
        Standard deviation of a target point from its place in ``state``; 0: the points are exact.
    noise_px : float
        Standard deviation of a seen coordinate, the weight of the prior.
    rough : bool
        To some thousandths of a pixel only: a start.

    Raises
    ------
    NotConverged
        The adjustment does not settle.
    """
    weight = noise_px / prior_mm if prior_mm > 0.0 else 0.0
    places = tuple((v, c) for v, row in enumerate(views) for c, view in enumerate(row) if view is not None)
    radius = dot_radius(state, views, places)
    nominal = state.points_mm
    for _ in range(SHIFT_PASSES if radius and not rough else 1):
        equations = _Equations(state, views, lens, places, radius, weight, nominal)
        step = minimum(equations.distances, equations.slopes, n_unknowns(state, lens, weight > 0.0),
                       START_TOLERANCE if rough else TOLERANCE)
        state = moved(state, lens, step, weight > 0.0)
    equations_at_end = _Equations(state, views, lens, places, radius, weight, nominal)
    zero_step = np.zeros(len(step))
    errors, jacobian = equations_at_end.distances(zero_step), equations_at_end.slopes(zero_step)
    residuals: list[list[np.ndarray | None]] = [[None] * len(row) for row in views]
    at = 0
    for v, c in places:
        n = views[v][c].n
        residuals[v][c] = -errors[at : at + 2 * n].reshape(n, 2)
        at += 2 * n
    normal = jacobian.T @ jacobian
    scale = 1.0 / np.sqrt(np.diag(normal))
    cofactor = np.linalg.inv(normal * scale[:, None] * scale) * scale[:, None] * scale
    carried = float(np.diag(cofactor)[-state.points_mm.size :].sum()) * weight**2
    return Adjusted(state, tuple(tuple(row) for row in residuals), cofactor, carried)


class _Equations:
    """Distances and their Jacobian as functions of a step from a state; the shifts of the dots are those of the
    state."""

    def __init__(self, base, views, lens, places, radius_mm, weight, nominal):
        self.base, self.lens, self.places, self.weight, self.nominal = base, lens, places, weight, nominal
        self.numbers = {(v, c): views[v][c].index[:, 0] for v, c in places}
        self.pixels = {(v, c): views[v][c].points_px for v, c in places}
        if radius_mm:  # what is seen is the centroid
            for v, c in places:
                points = base.points_mm[self.numbers[v, c]]
                self.pixels[v, c] = self.pixels[v, c] - dot_shift(base.cameras[c], base.poses[v], points, radius_mm)

    def distances(self, step):
        """Projected minus seen, then the points' distance from their places in the weight of the prior."""
        try:
            moved_state = moved(self.base, self.lens, step, self.weight > 0.0)
            parts = [(moved_state.cameras[c].project(in_camera_0(moved_state.poses[v],
                                                                 moved_state.points_mm[self.numbers[v, c]]))
                      - self.pixels[v, c]).ravel() for v, c in self.places]
        except InputError:  # a trial step with a point behind a camera: it is cut
            return np.full(1, np.inf)
        if self.weight:
            parts.append((moved_state.points_mm - self.nominal).ravel() * self.weight)
        return np.concatenate(parts)

    def slopes(self, step):
        """Derivatives of `distances`."""
        points_free = self.weight > 0.0
        moved_state = moved(self.base, self.lens, step, points_free)
        parts = [derivatives(moved_state, self.lens, step, points_free, v, c, self.numbers[v, c])
                 for v, c in self.places]
        if points_free:
            rows = np.zeros((self.nominal.size, len(step)))
            rows[:, -self.nominal.size :] = np.eye(self.nominal.size) * self.weight
            parts.append(rows)
        return np.vstack(parts)


def dot_radius(state: State, views: Views, places) -> float:
    """Radius of the dots in mm, the median of all; 0 for a chessboard."""
    radii = []
    for v, c in places:
        view = views[v][c]
        if view.areas_px is not None:
            space = in_camera_0(state.poses[v], state.points_mm[view.index[:, 0]])
            radii.append(np.sqrt(view.areas_px / magnification(state.cameras[c], state.poses[v], space) / np.pi))
    return float(np.nanmedian(np.concatenate(radii))) if radii else 0.0


def without_outliers(adjusted: Adjusted, views: Views) -> tuple[Views, int]:
    """The views without points that lie further off than errors of detection do, and how many these are."""
    deviation = 1.4826 * np.median(np.abs(adjusted.all_px))
    inlying_views, n_left_out = [], 0
    for row, errors in zip(views, adjusted.residuals_px, strict=True):
        inlying_row = []
        for view, error in zip(row, errors, strict=True):
            if view is not None:
                good = np.abs(error).max(axis=1) <= OUTLIER * deviation
                n_left_out += int((~good).sum())
                view = subset(view, good)
            inlying_row.append(view)
        inlying_views.append(tuple(inlying_row))
    return tuple(inlying_views), n_left_out


def subset(view, good):
    """The view with some of its points."""
    areas = None if view.areas_px is None else view.areas_px[good]
    return type(view)(view.index[good], view.points_px[good], areas, view.unique)
