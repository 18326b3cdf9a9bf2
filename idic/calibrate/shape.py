"""Places of the points of a target: nominal ones, and displacements that are identified with the cameras.

A printed sheet is not flat, and its print is not square. An error of the target is common to all views: it moves the
cameras, and neither the residual of a view nor the scatter between views shows by how much. So the target's shape is
identified with the cameras, and its uncertainty enters theirs: J.-M. Lavest, M. Viala, M. Dhome, Do we really need an
accurate calibration pattern to achieve a reliable camera calibration?, ECCV 1998 (10.1007/BFb0055665); K. H. Strobl,
G. Hirzinger, More accurate pinhole camera calibration with imperfect planar target, ICCV Workshops 2011
(10.1109/ICCVW.2011.6130369).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

DEGREE = 4              # of the polynomial out of plane: a sheet with three half-waves
VISIBLE_SHARE = 0.01    # of the size of the target, as rms: a shape or a print as wrong as this is seen by eye
_ROUNDING = 1e-6        # of modes of rms 1
_RANK = 1e-8            # polynomials that the points of the target do not separate


@dataclass(frozen=True, eq=False)
class Target:
    """What is free of the places of the points.

    Attributes
    ----------
    modes : array (n_points, 3, n_modes)
        Displacement in mm per mm of each coefficient, rms 1 over the points; without rigid motion and scale, which
        are those of the poses and of the stated spacing.
    std_mm : array (n_modes,)
        Standard deviation of each coefficient about zero, before the images.
    rigid : array (3 n_points, 6)
        Orthonormal rigid motions of the points, which free points have in common with the poses.
    point_std_mm : float
        Standard deviation of every point in every direction, in addition; 0: none.
    """

    modes: np.ndarray
    std_mm: np.ndarray
    rigid: np.ndarray
    point_std_mm: float = 0.0

    @property
    def n_modes(self) -> int:
        return len(self.std_mm)

    @property
    def is_normal(self) -> np.ndarray:
        """Which modes are out of plane  # bool (n_modes,)"""
        return (np.abs(self.modes[:, :2]) < _ROUNDING).all(axis=(0, 1))

    @property
    def n_free_points(self) -> int:
        """Points with a displacement of their own: all or none."""
        return len(self.modes) if self.point_std_mm > 0.0 else 0

    @property
    def n_unknowns(self) -> int:
        """Coefficients of the modes, then x, y, z of the free points."""
        return self.n_modes + 3 * self.n_free_points

    @property
    def prior_std_mm(self) -> np.ndarray:
        """Standard deviation of every unknown before the images  # (n_unknowns,)"""
        return np.concatenate([self.std_mm, np.full(3 * self.n_free_points, self.point_std_mm)])

    def displacement_mm(self, unknowns_mm: np.ndarray) -> np.ndarray:
        """Of every point  # (n_unknowns,) -> (n_points, 3)"""
        by_modes = self.modes @ unknowns_mm[: self.n_modes]
        return by_modes + unknowns_mm[self.n_modes :].reshape(-1, 3) if self.n_free_points else by_modes

    def shape_mm(self, unknowns_mm: np.ndarray, covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Displacements without rigid motion, and their standard deviations  # (n_points, 3), (n_points, 3)"""
        slopes = self.modes.reshape(len(self.rigid), -1)
        if self.n_free_points:
            slopes = np.hstack([slopes, np.eye(len(slopes))])
        slopes = slopes - self.rigid @ (self.rigid.T @ slopes)
        variances = np.einsum("im,im->i", slopes @ covariance, slopes)
        return (slopes @ unknowns_mm).reshape(-1, 3), np.sqrt(variances).reshape(-1, 3)


def exact(points_mm: np.ndarray) -> Target:
    """All points are where they are said to be."""
    return _target(points_mm, [])


def out_of_plane(points_mm: np.ndarray) -> Target:
    """A sheet that may be bent: polynomials of degree 2 to `DEGREE` normal to it."""
    return _target(points_mm, [(2, power, degree - power) for degree in range(2, DEGREE + 1)
                               for power in range(degree + 1)])


def with_print(target: Target, points_mm: np.ndarray) -> Target:
    """Also another spacing along each axis, at the mean that is stated, and axes that are not perpendicular."""
    linear = _target(points_mm, [(axis, power, 1 - power) for axis in (0, 1) for power in (0, 1)])
    return replace(target, modes=np.concatenate([target.modes, linear.modes], axis=2),
                   std_mm=np.concatenate([target.std_mm, linear.std_mm]))


def _target(points_mm: np.ndarray, terms: list[tuple[int, int, int]]) -> Target:
    """Terms (axis, power of x, power of y), orthogonal to each other, to rigid motions and to a change of scale."""
    centred = points_mm - points_mm.mean(axis=0)
    size = float(np.sqrt((centred**2).sum(axis=1).mean()))
    x, y = centred[:, 0] / size, centred[:, 1] / size
    n, zero, unit = len(x), np.zeros_like(x), np.ones_like(x)
    gauge = [(unit, zero, zero), (zero, unit, zero), (zero, zero, unit), (zero, zero, x), (zero, zero, y),
             (-y, x, zero), (x, y, zero)]  # the last one is the scale
    basis = np.linalg.qr(np.array([np.column_stack(columns).ravel() for columns in gauge]).T)[0]
    columns_mm = np.zeros((n, 3, len(terms)))
    for k, (axis, power_x, power_y) in enumerate(terms):
        columns_mm[:, axis, k] = x**power_x * y**power_y
    columns_mm = columns_mm.reshape(3 * n, len(terms))
    vectors, values, _ = np.linalg.svd(columns_mm - basis @ (basis.T @ columns_mm), full_matrices=False)
    modes = vectors[:, values > _RANK] * np.sqrt(n)
    return Target(modes.reshape(n, 3, -1), np.full(modes.shape[1], VISIBLE_SHARE * size), basis[:, :6])
