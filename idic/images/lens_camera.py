"""A camera with a lens: from a point of the mesh frame (mm) to (column, row) by central projection, and back.

    (X, Y, Z) = R x + t,   a = X / Z,   b = Y / Z
    (a', b') = distortion of the lens model (a, b)
    column = fx a' + skew b' + cx,   row = fy b' + cy

A lens model is a file of `idic.images.lenses`. Pixel centres are at integers, rows count downwards, the camera looks
along +Z of its own frame with X along columns and Y along rows. Distortion is that of normalised coordinates (k1
without unit), not of pixels. Unlike the telecentric `Camera` it sees motion along its axis.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, ClassVar, Self

import numpy as np

from idic.errors import InputError

SENSOR_PARAMETERS = ("fx", "fy", "skew", "cx", "cy")
POSE_PARAMETERS = ("rotation_x", "rotation_y", "rotation_z", "t_x", "t_y", "t_z")
MAX_ROTATION_ERROR = 1e-4  # of a rotation matrix: files print five digits
MAX_NEWTON_STEPS = 50
NEWTON_STEP = 1e-15  # of one plus the position: it has converged


@dataclass(frozen=True, eq=False)
class LensCamera(ABC):
    """Central projection, distortion by the lens model, sensor with skew, and pose.

    A model declares ``coefficients``, each a field with the default at which it has no effect, ``example`` (plausible
    values), ``leading`` (the coefficient by which the diagnosis looks for a wrong distortion, that of the third power
    of the radius) and, where calibration files give it, ``is_calibrated``. From them follow ``intrinsics`` and
    ``parameters``, names in the order of derivatives, and their ``units``.

    Attributes
    ----------
    fx, fy : float, px
        Focal length over the pixel pitch along columns and rows.
    skew : float, px
        Columns per unit of the normalised row coordinate.
    cx, cy : float, px
        Principal point (column, row).
    rotation : array (3, 3)
        From the mesh frame to the camera's frame, as calibrated (or as identified, see ``turned_deg``).
    translation_mm : array (3,)
        Position of the mesh origin in the camera's frame.
    turned_deg : array (3,)
        Rotation vector, in the camera's frame, by which the degrees of freedom ``rotation_x, rotation_y, rotation_z``
        have turned the calibrated rotation; ``rotation`` contains it.
    """

    coefficients: ClassVar[tuple[str, ...]] = ()
    example: ClassVar[Mapping[str, float]] = {}
    leading: ClassVar[str] = "k1"
    is_calibrated: ClassVar[bool] = False
    intrinsics: ClassVar[tuple[str, ...]] = SENSOR_PARAMETERS
    parameters: ClassVar[tuple[str, ...]] = SENSOR_PARAMETERS + POSE_PARAMETERS
    units: ClassVar[Mapping[str, str]] = {}

    fx: float
    fy: float
    cx: float
    cy: float
    skew: float = 0.0
    rotation: np.ndarray = field(default_factory=partial(np.eye, 3))
    translation_mm: np.ndarray = field(default_factory=partial(np.zeros, 3))
    turned_deg: np.ndarray = field(default_factory=partial(np.zeros, 3))

    def __init_subclass__(cls, **keywords: Any) -> None:
        super().__init_subclass__(**keywords)
        cls.intrinsics = (*SENSOR_PARAMETERS, *cls.coefficients)
        cls.parameters = (*cls.intrinsics, *POSE_PARAMETERS)
        cls.units = (dict.fromkeys(SENSOR_PARAMETERS, "px") | dict.fromkeys(cls.coefficients, "1")
                     | dict.fromkeys(POSE_PARAMETERS[:3], "deg") | dict.fromkeys(POSE_PARAMETERS[3:], "mm"))

    # the lens model -------------------------------------------------------------------------------
    @abstractmethod
    def distort(self, ideal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Distorted normalised positions, and their derivative by the ideal ones  # (n, 2) -> (n, 2), (n, 2, 2)

        NaN where the lens has no image of a direction, and of NaN.
        """

    @abstractmethod
    def coefficient_slopes(self, ideal: np.ndarray) -> np.ndarray:
        """d (distorted position) / d coefficients, in their order  # (n, 2) -> (n, 2, n_coefficients)"""

    def undistort(self, target: np.ndarray, allowed_px: np.ndarray) -> np.ndarray:
        """Ideal positions of distorted ones by Newton's method  # (n, 2) -> (n, 2)

        NaN beyond a fold of the distortion. allowed_px : (n,) miss on the sensor where the method circles in the last
        bit. A model may have a faster one, or an explicit one, equal but for rounding.
        """
        ideal, moving = target.copy(), np.arange(len(target))
        has_converged = np.zeros(len(target), dtype=bool)
        for _ in range(MAX_NEWTON_STEPS):
            at = ideal[moving]
            position, m = self.distort(at)
            miss, determinant, is_unfolded = position - target[moving], *_unfolded(m)
            with np.errstate(divide="ignore", invalid="ignore"):
                step = np.column_stack([(m[:, 1, 1] * miss[:, 0] - m[:, 0, 1] * miss[:, 1]) / determinant,
                                        (m[:, 0, 0] * miss[:, 1] - m[:, 1, 0] * miss[:, 0]) / determinant])
            at, step, moving = at[is_unfolded] - step[is_unfolded], step[is_unfolded], moving[is_unfolded]
            ideal[moving] = at
            is_small = np.abs(step).sum(axis=1) <= NEWTON_STEP * (1.0 + np.abs(at[:, 0]) + np.abs(at[:, 1]))
            has_converged[moving[is_small]] = True
            moving = moving[~is_small]
            if not len(moving):
                break
        circling = np.flatnonzero(~has_converged)
        position, m = self.distort(ideal[circling])
        miss_px = np.abs(position - target[circling]) @ np.array([self.fx, self.fy])
        ideal[circling[~((miss_px < allowed_px[circling]) & _unfolded(m)[1])]] = np.nan
        return ideal

    def __post_init__(self):
        for name, shape in (("rotation", (3, 3)), ("translation_mm", (3,)), ("turned_deg", (3,))):
            array = np.array(getattr(self, name), dtype=float)
            if array.shape != shape or not np.isfinite(array).all():
                raise InputError("not a usable camera", key=name, expected=f"finite numbers, shape {shape}",
                                 found=array.tolist(), remedy="correct this entry of the camera")
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        for name in self.intrinsics:
            value = float(getattr(self, name))
            if not np.isfinite(value) or (name in ("fx", "fy") and value <= 0.0):
                raise InputError("not a usable camera", key=name, found=value,
                                 expected="a focal length > 0 px" if name in ("fx", "fy") else "a finite number",
                                 remedy="correct this entry of the camera")
            object.__setattr__(self, name, value)
        error = np.abs(self.rotation @ self.rotation.T - np.eye(3)).max()
        if error > MAX_ROTATION_ERROR or np.linalg.det(self.rotation) < 0.0:
            raise InputError("not a rotation matrix", key="rotation", found=self.rotation.tolist(),
                             expected="three orthonormal rows, right-handed (determinant +1)",
                             remedy="correct the matrix; a mirrored image needs its columns flipped back first")

    # points ---------------------------------------------------------------------------------------
    def project(self, points: np.ndarray) -> np.ndarray:
        """(column, row) of points of the mesh frame  # (n, 2|3) mm -> (n, 2) px

        Raises
        ------
        InputError
            If a point is not in front of the camera, or its distortion gives it no image.
        """
        _, depth, ideal = self._in_camera(points)
        return self._seen(self._on_sensor(self.distort(ideal)[0]), depth)

    def jacobian(self, points: np.ndarray) -> np.ndarray:
        """d (column, row) / d (x, y, z)  # (n, 2|3) mm -> (n, 2, 3) px/mm"""
        _, depth, ideal = self._in_camera(points)
        c, r = self._camera_slopes(depth, ideal, self.distort(ideal)[1]), self.rotation
        return self._seen(c[:, :, 0, None] * r[0] + c[:, :, 1, None] * r[1] + c[:, :, 2, None] * r[2], depth)

    def parameter_jacobian(self, points: np.ndarray, name: str | None = None) -> np.ndarray:
        """d (column, row) of fixed points by `parameters`, or by one of them
        # -> (n, 2, n_parameters) or (n, 2), px per unit
        """
        if name is not None and name not in self.parameters:
            raise self._no_such_parameter({name})
        centred, depth, ideal = self._in_camera(points)
        (position, slope), n = self.distort(ideal), len(self.intrinsics)
        columns = np.zeros((len(ideal), 2, n + 6))
        columns[:, 0, 0], columns[:, 1, 1], columns[:, 0, 2] = position[:, 0], position[:, 1], position[:, 1]
        columns[:, 0, 3] = columns[:, 1, 4] = 1.0
        by_coefficient = self.coefficient_slopes(ideal)
        columns[:, 0, 5:n] = self.fx * by_coefficient[:, 0] + self.skew * by_coefficient[:, 1]
        columns[:, 1, 5:n] = self.fy * by_coefficient[:, 1]
        c, (x, y, z) = self._camera_slopes(depth, ideal, slope), centred
        for k, (wx, wy, wz) in enumerate(left_jacobian(self.turned_deg).T):
            arm = (wy * z - wz * y, wz * x - wx * z, wx * y - wy * x)
            columns[:, :, n + k] = (c[:, :, 0] * arm[0][:, None] + c[:, :, 1] * arm[1][:, None]
                                    + c[:, :, 2] * arm[2][:, None])
        columns[:, :, n : n + 3] *= np.pi / 180.0
        columns[:, :, n + 3 :] = c
        return self._seen(columns if name is None else columns[:, :, self.parameters.index(name)], depth)

    def normalised(self, pixels: np.ndarray) -> np.ndarray:
        """Undistorted directions (X / Z, Y / Z) of pixels in the camera's frame  # (n, 2) px -> (n, 2)

        NaN where the distortion has no inverse.
        """
        pixels = np.asarray(pixels, dtype=float)
        b = (pixels[:, 1] - self.cy) / self.fy
        target = np.column_stack([(pixels[:, 0] - self.cx - self.skew * b) / self.fx, b])
        return self.undistort(target, 1e-11 * (1.0 + np.abs(pixels[:, 0]) + np.abs(pixels[:, 1])))

    def rays(self, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Centre of the camera (3,) and unit directions (n, 3) of the rays of pixels, in the mesh frame, mm"""
        ideal = self.normalised(pixels)
        direction = np.column_stack([ideal, np.ones(len(ideal))]) @ self.rotation
        return self.centre_mm, direction / np.linalg.norm(direction, axis=1, keepdims=True)

    def inverse(self, pixels: np.ndarray, z_mm: float = 0.0) -> np.ndarray:
        """Mesh coordinates x, y where the rays of pixels meet the plane z = ``z_mm``  # (n, 2) px -> (n, 2) mm

        NaN where a ray does not meet the plane in front of the camera.
        """
        centre, direction = self.rays(pixels)
        with np.errstate(divide="ignore", invalid="ignore"):
            length = (z_mm - centre[2]) / direction[:, 2]
        hit = centre[:2] + length[:, None] * direction[:, :2]
        hit[~(length > 0.0)] = np.nan
        return hit

    @property
    def centre_mm(self) -> np.ndarray:
        """The projection centre in the mesh frame  # (3,)"""
        return -self.rotation.T @ self.translation_mm

    @property
    def intrinsic(self) -> np.ndarray:
        """The values of `intrinsics`: fx, fy, skew, cx, cy, then the coefficients  # (n,)"""
        return np.array([getattr(self, name) for name in self.intrinsics])

    @property
    def matrix(self) -> np.ndarray:
        """The camera matrix K  # (3, 3)"""
        return np.array([[self.fx, self.skew, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    def placed(self, rotation: np.ndarray, translation_mm: np.ndarray) -> Self:
        """The same lens and sensor at another pose."""
        return replace(self, rotation=rotation, translation_mm=translation_mm, turned_deg=np.zeros(3))

    # degrees of freedom ---------------------------------------------------------------------------
    def values(self) -> dict[str, float]:
        """The present values of `parameters`; `with_parameters(values())` changes nothing."""
        return (dict(zip(self.intrinsics, self.intrinsic.tolist(), strict=True))
                | dict(zip(POSE_PARAMETERS, [*self.turned_deg.tolist(), *self.translation_mm.tolist()], strict=True)))

    def with_parameters(self, values: Mapping[str, float]) -> Self:
        """The camera with these of `parameters` set (absolute values; the rotation relative to the calibrated one)."""
        if set(values) - set(self.parameters):
            raise self._no_such_parameter(set(values) - set(self.parameters))
        changed = self.values() | {name: float(value) for name, value in values.items()}
        turned = np.array([changed[name] for name in POSE_PARAMETERS[:3]])
        rotation = self.rotation
        if (turned != self.turned_deg).any():
            rotation = rotation_of(turned) @ rotation_of(self.turned_deg).T @ rotation
        return type(self)(**{name: changed[name] for name in self.intrinsics}, rotation=rotation,
                          translation_mm=np.array([changed[name] for name in POSE_PARAMETERS[3:]]),
                          turned_deg=turned)

    def _in_camera(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Points turned into the camera's frame about the mesh origin (3, n), their depth (n,) mm, and their ideal
        normalised positions (n, 2), NaN where they are not in front of the camera."""
        (x, y, z), r, t = _space(points).T, self.rotation, self.translation_mm
        at = np.array([r[k, 0] * x + r[k, 1] * y + r[k, 2] * z + t[k] for k in range(3)])
        at[:, ~(at[2] > 0.0)] = np.nan
        return at - t[:, None], at[2], np.column_stack([at[0] / at[2], at[1] / at[2]])

    def _on_sensor(self, position: np.ndarray) -> np.ndarray:
        return np.column_stack([self.fx * position[:, 0] + self.skew * position[:, 1] + self.cx,
                                self.fy * position[:, 1] + self.cy])

    def _camera_slopes(self, depth: np.ndarray, ideal: np.ndarray, slope: np.ndarray) -> np.ndarray:
        """d (column, row) by the point in the camera's frame  # (n, 2, 3) px/mm"""
        c = np.empty((len(ideal), 2, 3))
        c[:, 0, :2] = (self.fx * slope[:, 0] + self.skew * slope[:, 1]) / depth[:, None]
        c[:, 1, :2] = self.fy * slope[:, 1] / depth[:, None]
        c[:, :, 2] = -(c[:, :, 0] * ideal[:, 0, None] + c[:, :, 1] * ideal[:, 1, None])
        return c

    def _no_such_parameter(self, names: set[str]) -> InputError:
        return InputError("no such camera parameter", key=", ".join(sorted(names)),
                          expected=", ".join(self.parameters), remedy="use one of these names")

    def _seen(self, array: np.ndarray, depth: np.ndarray) -> np.ndarray:
        """The same, of points that all have an image."""
        in_front, has_image = depth > 0.0, np.isfinite(array).reshape(len(array), -1).all(axis=1)
        if not in_front.all():
            raise InputError("the mesh is behind the camera", key="rotation, translation_mm",
                             expected="every point in front of the camera (Z > 0)",
                             found=f"{(~in_front).sum()} of {len(array)} points behind it or not a number",
                             remedy="check the pose: camera frame = rotation @ mesh frame + translation_mm, "
                                    "with Z along the line of sight")
        if not has_image.all():
            raise InputError("the lens has no image of a part of the mesh", key=", ".join(self.coefficients),
                             expected="every point within the angle of view at which the distortion folds back",
                             found=f"{(~has_image).sum()} of {len(array)} points beyond it",
                             remedy="check the coefficients (of normalised coordinates, not of pixels) and the pose")
        return array


def rotation_of(vector_deg: np.ndarray) -> np.ndarray:
    """Rotation by a rotation vector in degrees (Rodrigues)  # (3,) -> (3, 3)"""
    w = np.radians(np.asarray(vector_deg, dtype=float))
    angle, cross = np.linalg.norm(w), _cross(w)
    # sin(x)/x and (1 - cos x)/x² through sinc keep their digits at small angles
    return np.eye(3) + np.sinc(angle / np.pi) * cross + 0.5 * np.sinc(0.5 * angle / np.pi) ** 2 * cross @ cross


def left_jacobian(vector_deg: np.ndarray) -> np.ndarray:
    """Infinitesimal rotation (rad) by the change of a rotation vector (rad), at a vector in degrees  # (3, 3)

    J = I + (1 - cos x) / x² [w] + (x - sin x) / x³ [w]², x = |w|.
    """
    w = np.radians(np.asarray(vector_deg, dtype=float))
    angle, cross = np.linalg.norm(w), _cross(w)
    third = (angle - np.sin(angle)) / angle**3 if angle > 1e-2 else 1.0 / 6.0 - angle**2 / 120.0 + angle**4 / 5040.0
    return np.eye(3) + 0.5 * np.sinc(0.5 * angle / np.pi) ** 2 * cross + third * cross @ cross


def _unfolded(slope: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Determinant of the derivative of a distortion, and whether it is in front of a fold  # (n, 2, 2) -> (n,), (n,)"""
    determinant = slope[:, 0, 0] * slope[:, 1, 1] - slope[:, 0, 1] * slope[:, 1, 0]
    return determinant, (slope[:, 0, 0] > 0.0) & (determinant > 0.0)


def _cross(w):
    return np.array([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]])


def _space(points):
    points = np.ascontiguousarray(points, dtype=float)
    if points.ndim != 2 or points.shape[1] not in (2, 3):
        raise ValueError(f"points must be (n, 2) or (n, 3), got {points.shape}")
    return points if points.shape[1] == 3 else np.column_stack([points, np.zeros(len(points))])
