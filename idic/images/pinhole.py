"""The pinhole camera: from a point of the mesh frame (mm) to (column, row) through a lens, and back.

Its equation stands at the head of `idic.images.pinhole_kernels`. Pixel centres are at integers, rows count downwards,
the camera looks along +Z of its own frame with X along columns and Y along rows. Distortion is that of normalised
coordinates (k1 without unit), not of pixels. Unlike the telecentric `Camera` it sees motion along its axis.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from idic.errors import InputError
from idic.images import pinhole_kernels as kernels

INTRINSIC_PARAMETERS = ("fx", "fy", "skew", "cx", "cy", "k1", "k2", "k3", "p1", "p2")
POSE_PARAMETERS = ("rotation_x", "rotation_y", "rotation_z", "t_x", "t_y", "t_z")
PINHOLE_PARAMETERS = INTRINSIC_PARAMETERS + POSE_PARAMETERS
PINHOLE_UNITS = (dict.fromkeys(("fx", "fy", "skew", "cx", "cy"), "px") | dict.fromkeys(("k1", "k2", "k3", "p1", "p2"),
         "1") | dict.fromkeys(POSE_PARAMETERS[:3], "deg") | dict.fromkeys(POSE_PARAMETERS[3:], "mm"))
MAX_ROTATION_ERROR = 1e-4  # of a rotation matrix: files print five digits


@dataclass(frozen=True, eq=False)
class PinholeCamera:
    """Central projection with skew, Brown distortion and pose.

    Attributes
    ----------
    fx, fy : float, px
        Focal length over the pixel pitch along columns and rows.
    skew : float, px
        Columns per unit of the normalised row coordinate.
    cx, cy : float, px
        Principal point (column, row).
    k1, k2, k3, p1, p2 : float
        Radial and tangential distortion of normalised coordinates.
    rotation : array (3, 3)
        From the mesh frame to the camera's frame, as calibrated (or as identified, see ``turned_deg``).
    translation_mm : array (3,)
        Position of the mesh origin in the camera's frame.
    turned_deg : array (3,)
        Rotation vector, in the camera's frame, by which the degrees of freedom ``rotation_x, rotation_y, rotation_z``
        have turned the calibrated rotation; ``rotation`` contains it.
    """

    fx: float
    fy: float
    cx: float
    cy: float
    skew: float = 0.0
    k1: float = 0.0
    k2: float = 0.0
    k3: float = 0.0
    p1: float = 0.0
    p2: float = 0.0
    rotation: np.ndarray = field(default_factory=partial(np.eye, 3))
    translation_mm: np.ndarray = field(default_factory=partial(np.zeros, 3))
    turned_deg: np.ndarray = field(default_factory=partial(np.zeros, 3))

    def __post_init__(self):
        for name, shape in (("rotation", (3, 3)), ("translation_mm", (3,)), ("turned_deg", (3,))):
            array = np.array(getattr(self, name), dtype=float)
            if array.shape != shape or not np.isfinite(array).all():
                raise InputError("not a usable camera", key=name, expected=f"finite numbers, shape {shape}",
                                 found=array.tolist(), remedy="correct this entry of the camera")
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        for name in INTRINSIC_PARAMETERS:
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
            If a point is not in front of the camera.
        """
        return self._in_front(kernels.project(_space(points), self.intrinsic, self.rotation, self.translation_mm))

    def jacobian(self, points: np.ndarray) -> np.ndarray:
        """d (column, row) / d (x, y, z)  # (n, 2|3) mm -> (n, 2, 3) px/mm"""
        return self._in_front(
            kernels.point_jacobian(_space(points), self.intrinsic, self.rotation, self.translation_mm))

    def parameter_jacobian(self, points: np.ndarray, name: str | None = None) -> np.ndarray:
        """d (column, row) of fixed points by `PARAMETERS`, or by one of them  # -> (n, 2, 16) or (n, 2), px per unit"""
        if name is not None and name not in PINHOLE_PARAMETERS:
            raise _no_such_parameter({name})
        columns = self._in_front(kernels.parameter_jacobian(
            _space(points), self.intrinsic, self.rotation, self.translation_mm, left_jacobian(self.turned_deg)))
        columns[:, :, 10:13] *= np.pi / 180.0
        return columns if name is None else columns[:, :, PINHOLE_PARAMETERS.index(name)]

    def normalised(self, pixels: np.ndarray) -> np.ndarray:
        """Undistorted directions (X / Z, Y / Z) of pixels in the camera's frame  # (n, 2) px -> (n, 2)

        NaN where the distortion polynomial has no inverse.
        """
        return kernels.undistort(np.ascontiguousarray(pixels, dtype=float), self.intrinsic)

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
        """fx, fy, skew, cx, cy, k1, k2, k3, p1, p2  # (10,)"""
        return np.array([getattr(self, name) for name in INTRINSIC_PARAMETERS])

    @property
    def matrix(self) -> np.ndarray:
        """The camera matrix K  # (3, 3)"""
        return np.array([[self.fx, self.skew, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    def placed(self, rotation: np.ndarray, translation_mm: np.ndarray) -> PinholeCamera:
        """The same lens and sensor at another pose."""
        return replace(self, rotation=rotation, translation_mm=translation_mm, turned_deg=np.zeros(3))

    # degrees of freedom ---------------------------------------------------------------------------
    def values(self) -> dict[str, float]:
        """The present values of `PARAMETERS`; `with_parameters(values())` changes nothing."""
        return (dict(zip(INTRINSIC_PARAMETERS, self.intrinsic.tolist(), strict=True))
                | dict(zip(POSE_PARAMETERS, [*self.turned_deg.tolist(), *self.translation_mm.tolist()], strict=True)))

    def with_parameters(self, values: Mapping[str, float]) -> PinholeCamera:
        """The camera with these of `PARAMETERS` set (absolute values; the rotation relative to the calibrated one)."""
        if set(values) - set(PINHOLE_PARAMETERS):
            raise _no_such_parameter(set(values) - set(PINHOLE_PARAMETERS))
        changed = self.values() | {name: float(value) for name, value in values.items()}
        turned = np.array([changed[name] for name in POSE_PARAMETERS[:3]])
        rotation = self.rotation
        if (turned != self.turned_deg).any():
            rotation = rotation_of(turned) @ rotation_of(self.turned_deg).T @ rotation
        return PinholeCamera(**{name: changed[name] for name in INTRINSIC_PARAMETERS}, rotation=rotation,
                             translation_mm=np.array([changed[name] for name in POSE_PARAMETERS[3:]]),
                             turned_deg=turned)

    def _in_front(self, array):
        bad = np.isnan(array).reshape(len(array), -1).any(axis=1)
        if bad.any():
            raise InputError("the mesh is behind the camera", key="rotation, translation_mm",
                             expected="every point in front of the camera (Z > 0)",
                             found=f"{bad.sum()} of {len(bad)} points behind it or not a number",
                             remedy="check the pose: camera frame = rotation @ mesh frame + translation_mm, "
                                    "with Z along the line of sight")
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


def _cross(w):
    return np.array([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]])


def _space(points):
    points = np.ascontiguousarray(points, dtype=float)
    if points.ndim != 2 or points.shape[1] not in (2, 3):
        raise ValueError(f"points must be (n, 2) or (n, 3), got {points.shape}")
    return points if points.shape[1] == 3 else np.column_stack([points, np.zeros(len(points))])


def _no_such_parameter(names):
    return InputError("no such camera parameter", key=", ".join(sorted(names)), expected=", ".join(PINHOLE_PARAMETERS),
                      remedy="use one of these names")
