"""The camera: from a point of the mesh to (column, row) in the image, and back; its parameters are degrees of freedom.

    p0 = origin + shift + matrix X / (1 + tilt . X)          scale, rotation, axes; perspective of a tilted sensor
    p  = centre + (1 + k1 |p0 - centre|^2) (p0 - centre)     radial distortion (Brown, first coefficient)

Pixel centres are at integers, rows count downwards. A 3D point is seen along z (telecentric): x and y count.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from idic.errors import InputError
from idic.images.camera_motion import CameraMotion
from idic.images.deflection import Deflection

_AXES = {"+col": (1.0, 0.0), "-col": (-1.0, 0.0), "+row": (0.0, 1.0), "-row": (0.0, -1.0)}


@dataclass(frozen=True)
class CameraParameter:
    """A degree of freedom of the camera.

    unit : mm stands for the unit of length; scale : (px from the middle to a corner of the image, pixel size in mm) ->
    change that moves the mesh at a corner by about three pixels; bends : straight lines of the specimen are curved or
    converge
    """

    unit: str
    scale: Callable[[float, float], float]
    bends: bool = False


_TILT = CameraParameter("1/mm", lambda half, size: 3.0 / (half * half * size), bends=True)
CAMERA_PARAMETERS: dict[str, CameraParameter] = {
    "pixel_size": CameraParameter("mm", lambda half, size: 3.0 * size / half),
    "rotation_deg": CameraParameter("deg", lambda half, size: float(np.degrees(3.0 / half))),
    "shift_col": CameraParameter("px", lambda half, size: 3.0),
    "shift_row": CameraParameter("px", lambda half, size: 3.0),
    "k1": CameraParameter("1/px^2", lambda half, size: 3.0 * half**-3, bends=True),
    "tilt_x": _TILT,
    "tilt_y": _TILT,
}


def rotation_matrix(degrees: float) -> np.ndarray:
    """Rotation of (column, row) vectors, counter-clockwise as seen (rows count downwards)  # (2, 2)"""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[c, s], [-s, c]])


@dataclass(frozen=True, eq=False)
class Camera:
    """Projection of mesh points (mm) into the image (px).

    Attributes
    ----------
    matrix : array (2, 2), px per mm
        Everything linear: scale, axes and ``rotation_deg``, already multiplied out; determinant of any sign.
    origin_px : array (2,)
        (column, row) of the mesh origin, before ``shift_px`` and distortion.
    k1 : float, 1/px^2
        Radial distortion about ``centre_px``.
    centre_px : array (2,)
    tilt : array (2,), 1/mm
        Relative fall of the magnification per mm along mesh x and y.
    rotation_deg : float
        The part of ``matrix`` that the degree of freedom ``rotation_deg`` stands for.
    shift_px : array (2,)
        The degrees of freedom ``shift_col``, ``shift_row``.
    motion : CameraMotion, optional
        How the camera moves from frame to frame; `at` gives the camera of a frame.
    frame, frame_map, frame_shift : number, linear map and shift (px) of the frame that this is the camera of
    deflection : of the sheet in that frame
    """

    matrix: np.ndarray
    origin_px: np.ndarray
    k1: float = 0.0
    centre_px: np.ndarray = field(default_factory=partial(np.zeros, 2))
    tilt: np.ndarray = field(default_factory=partial(np.zeros, 2))
    rotation_deg: float = 0.0
    shift_px: np.ndarray = field(default_factory=partial(np.zeros, 2))
    motion: CameraMotion | None = None
    frame: int | None = None
    frame_map: np.ndarray = field(default_factory=partial(np.eye, 2))
    frame_shift: np.ndarray = field(default_factory=partial(np.zeros, 2))
    deflection: Deflection | None = None

    def __post_init__(self):
        for name in ("matrix", "origin_px", "centre_px", "tilt", "shift_px", "frame_map", "frame_shift"):
            shape = (2, 2) if name in ("matrix", "frame_map") else (2,)
            array = np.array(getattr(self, name), dtype=float)
            if array.shape != shape or not np.isfinite(array).all():
                raise InputError("not a usable camera", key=name, expected=f"finite numbers, shape {shape}",
                                 found=array, remedy="correct this entry of the camera")
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        size = np.abs(self.matrix).max()
        if not (size > 0 and abs(np.linalg.det(self.matrix / size)) > 1e-12):
            raise InputError("the camera matrix is singular", key="matrix_px_per_unit",
                             expected="two directions that differ", found=self.matrix.tolist(),
                             remedy="correct pixel_size_mm, axes or matrix_px_per_unit")

    @classmethod
    def from_table(cls, pixel_size: float = 1.0, origin=(0.0, 0.0), axes=("+col", "-row"), rotation_deg: float = 0.0,
                   k1: float = 0.0, centre=(0.0, 0.0)) -> Camera:
        """The camera of the `[camera]` table: pixel size (mm), origin (px), axes, rotation (deg), distortion."""
        if len(axes) != 2 or any(axis not in _AXES for axis in axes) or axes[0][1:] == axes[1][1:]:
            raise InputError("not a pair of image axes", key="axes", found=list(axes),
                             expected='one of "+col", "-col" and one of "+row", "-row", in either order',
                             remedy="write one row axis and one column axis")
        if not pixel_size > 0:
            raise InputError("the pixel size must be positive", key="pixel_size_mm", expected="> 0", found=pixel_size,
                             remedy="give the size of a pixel in mm")
        base = np.column_stack([_AXES[axis] for axis in axes])
        return cls(rotation_matrix(rotation_deg) @ base / pixel_size, origin, k1, centre, rotation_deg=rotation_deg)

    @classmethod
    def from_matrix(cls, matrix_px_per_mm, origin=(0.0, 0.0), k1: float = 0.0, centre=(0.0, 0.0)) -> Camera:
        """The camera given by `matrix_px_per_unit` (converted to mm): ``(col, row) = origin + matrix (x, y)``."""
        return cls(matrix_px_per_mm, origin, k1, centre)

    def at(self, frame: int) -> Camera:
        """The camera of a frame; itself where it does not move."""
        if self.motion is None:
            return self
        linear, shift = self.motion.at(frame)
        origin = self.centre_px + linear @ (self.origin_px + self.shift_px - self.centre_px) + shift - self.shift_px
        return replace(self, matrix=linear @ self.matrix, origin_px=origin, frame=frame, frame_map=linear,
                       frame_shift=shift, deflection=self.motion.deflection(frame))

    # points ---------------------------------------------------------------------------------------
    def project(self, points: np.ndarray) -> np.ndarray:
        """(column, row) of mesh points  # points (n, 2|3) mm -> (n, 2) px"""
        x = _plane(points)
        return self._distort(self._bent(x, self._flat(self._face(x))[0]))

    def inverse(self, pixels: np.ndarray) -> np.ndarray:
        """Mesh coordinates x, y seen at image positions  # pixels (n, 2) px -> (n, 2) mm"""
        p0, bent = self._undistort(np.asarray(pixels, dtype=float)), self.deflection
        x = self._unflattened(p0)
        if bent is None:
            return x
        for _ in range(30):  # a step leaves a share of the size of the deflection
            flat = self.centre_px + (p0 - self.centre_px) / (1.0 + bent.ratio(x))[:, None]
            previous, x = x, self._unflattened(flat) + x - bent.face(x)
            if np.abs(x - previous).max(initial=0.0) < 1e-13 * (1.0 + np.abs(x).max(initial=0.0)):
                break
        return x

    @property
    def is_affine(self) -> bool:
        """Whether the Jacobian is the same everywhere."""
        return self.k1 == 0.0 and not self.tilt.any() and self.deflection is None

    def jacobian(self, points: np.ndarray) -> np.ndarray:
        """d (column, row) / d (x, y)  # points (n, 2|3) mm -> (n, 2, 2) px/mm"""
        x = _plane(points)
        if self.is_affine:
            return np.tile(self.matrix, (len(x), 1, 1))
        flat, w = self._flat(self._face(x))
        jacobian = self._flat_jacobian(flat, w)
        if self.deflection is not None:
            grown = 1.0 + self.deflection.ratio(x)
            jacobian = grown[:, None, None] * jacobian @ self.deflection.face_jacobian(x) \
                + (flat - self.centre_px)[:, :, None] * self.deflection.gradient(x)[:, None, :]
        return self._distortion_jacobian(self._bent(x, flat)) @ jacobian

    # degrees of freedom ---------------------------------------------------------------------------
    def values(self) -> dict[str, float]:
        """The present values of `CAMERA_PARAMETERS`; `with_parameters(values())` changes nothing."""
        return {
            "pixel_size": self.pixel_size, "rotation_deg": float(self.rotation_deg),
            "shift_col": float(self.shift_px[0]), "shift_row": float(self.shift_px[1]),
            "k1": float(self.k1), "tilt_x": float(self.tilt[0]), "tilt_y": float(self.tilt[1]),
        }

    @property
    def key(self) -> tuple:
        """What decides where the pixels of the reference frame lie on the mesh; hashable."""
        return (self.matrix.tobytes(), self.origin_px.tobytes(), self.shift_px.tobytes(), self.tilt.tobytes(), self.k1,
                self.centre_px.tobytes())

    @property
    def pixel_size(self) -> float:
        """mm per px: the side of the square that has the area of one pixel on the specimen."""
        return float(1.0 / np.sqrt(abs(np.linalg.det(self.matrix))))

    def with_parameters(self, values: Mapping[str, float]) -> Camera:
        """The camera with these of `CAMERA_PARAMETERS` set (absolute values, not changes)."""
        unknown = set(values) - set(CAMERA_PARAMETERS)
        if unknown:
            raise InputError("no such camera parameter", key=", ".join(sorted(unknown)),
                             expected=", ".join(CAMERA_PARAMETERS), remedy="use one of these names")
        changed = self.values() | {name: float(value) for name, value in values.items()}
        matrix = self.matrix
        if "rotation_deg" in values:
            matrix = rotation_matrix(changed["rotation_deg"] - self.rotation_deg) @ matrix
        if "pixel_size" in values:
            matrix = matrix * (self.pixel_size / changed["pixel_size"])
        return replace(self, matrix=matrix, k1=changed["k1"], tilt=np.array([changed["tilt_x"], changed["tilt_y"]]),
                       rotation_deg=changed["rotation_deg"],
                       shift_px=np.array([changed["shift_col"], changed["shift_row"]]))

    def parameter_jacobian(self, points: np.ndarray, name: str) -> np.ndarray:
        """d (column, row) of fixed mesh points by one of `CAMERA_PARAMETERS`  # (n, 2|3) mm -> (n, 2) px per unit"""
        x = _plane(points)
        flat, w = self._flat(self._face(x))
        p0 = self._bent(x, flat)
        if name == "k1":
            d = p0 - self.centre_px
            return d * (d**2).sum(axis=1, keepdims=True)
        if self.motion is not None and self.frame is not None and name in self.motion.names:
            dp0 = self._motion_slope(self.motion, self.frame, name, x, flat, w)
        else:
            dp0 = self._still_slope(name, self._face(x), flat, w)
            dp0 = dp0 if self.deflection is None else (1.0 + self.deflection.ratio(x))[:, None] * dp0
        return dp0 if self.k1 == 0.0 else np.einsum("nij,nj->ni", self._distortion_jacobian(p0), dp0)

    def _still_slope(self, name: str, x: np.ndarray, flat: np.ndarray, w: np.ndarray) -> np.ndarray:
        """Derivative of the position on a flat sheet by a parameter of the camera itself  # (n, 2) px per unit"""
        centred = flat - self.origin_px - self.shift_px  # matrix X / w
        if name == "pixel_size":
            return -centred / (self.pixel_size * np.sqrt(np.linalg.det(self.frame_map)))
        if name == "rotation_deg":
            return np.radians(1.0) * centred @ np.array([[0.0, -1.0], [1.0, 0.0]])  # (col, row) -> (row, -col)
        if name in ("shift_col", "shift_row"):
            return np.broadcast_to(self.frame_map[:, 0 if name == "shift_col" else 1], centred.shape)
        if name in ("tilt_x", "tilt_y"):
            return -centred * (x[:, [0 if name == "tilt_x" else 1]] / w[:, None])
        raise InputError("no such camera parameter", key=name, expected=", ".join(CAMERA_PARAMETERS),
                         remedy="use one of these names")

    def _motion_slope(self, motion: CameraMotion, frame: int, name: str, x: np.ndarray, flat: np.ndarray,
                      w: np.ndarray) -> np.ndarray:
        """Derivative of the ideal position by an amplitude of the motion of this frame  # (n, 2) px per unit"""
        shape = motion.shape(name, frame)
        grown = 1.0 if self.deflection is None else (1.0 + self.deflection.ratio(x))[:, None]
        if shape is None or self.deflection is None:
            return grown * motion.slope(name, frame, flat - self.centre_px - self.frame_shift, self.frame_map)
        ratio, face = self.deflection.change(shape[0], x)
        moved = np.einsum("nij,nj->ni", self._flat_jacobian(flat, w), face)
        return shape[1] * (ratio[:, None] * (flat - self.centre_px) + grown * moved)

    # parts ----------------------------------------------------------------------------------------
    def _face(self, x):
        return x if self.deflection is None else self.deflection.face(x)

    def _flat(self, x):
        w = 1.0 + x @ self.tilt
        return self.origin_px + self.shift_px + (x @ self.matrix.T) / w[:, None], w

    def _flat_jacobian(self, flat, w):
        centred = flat - self.origin_px - self.shift_px
        return (self.matrix - centred[:, :, None] * self.tilt) / w[:, None, None]

    def _unflattened(self, p0):
        d = p0 - self.origin_px - self.shift_px  # (n, 2)
        a = self.matrix - d[:, :, None] * self.tilt  # (n, 2, 2)
        return np.linalg.solve(a, d[:, :, None])[:, :, 0]

    def _bent(self, x, flat):
        if self.deflection is None:
            return flat
        return self.centre_px + (1.0 + self.deflection.ratio(x))[:, None] * (flat - self.centre_px)

    def _distort(self, p0):
        d = p0 - self.centre_px
        return self.centre_px + (1.0 + self.k1 * (d**2).sum(axis=1, keepdims=True)) * d

    def _undistort(self, p):
        """Solve (1 + k1 s^2) s = |p - centre| for the ideal radius s: Newton, monotonic for usable distortions."""
        if self.k1 == 0.0:
            return p
        d = p - self.centre_px
        radius = np.sqrt((d**2).sum(axis=1, keepdims=True))
        s = radius.copy()
        for _ in range(30):
            step = (s + self.k1 * s**3 - radius) / (1.0 + 3.0 * self.k1 * s**2)
            s = s - step
            if np.abs(step).max(initial=0.0) < 1e-13 * (1.0 + radius.max(initial=0.0)):
                break
        return self.centre_px + d * np.divide(s, radius, out=np.ones_like(s), where=radius > 0)

    def _distortion_jacobian(self, p0):
        d = p0 - self.centre_px
        scale = 1.0 + self.k1 * (d**2).sum(axis=1)
        return scale[:, None, None] * np.eye(2) + 2.0 * self.k1 * d[:, :, None] * d[:, None, :]

    def fixed_pixel_sensitivity(self, points: np.ndarray, u: np.ndarray, gradient: np.ndarray,
                                name: str, later: Camera | None = None) -> np.ndarray:
        """Change of the deformed pixel position at a fixed reference pixel by a camera parameter.

        The parameter moves the material point that a reference pixel shows as well as its image after deformation:
        ``phi = c(X + u) - J(X + u) F J(X)^-1 c(X)`` with ``c = d camera / d parameter`` and ``J = d camera / d X``.
        A pure shift of a rigid body therefore changes nothing, and at ``u = 0`` no parameter has an effect
        (docs/method.md, equation 5.6).

        Parameters
        ----------
        points : array (n, 2|3), mm
            Mesh points (the nodes).
        u : array (n, 2|3), mm
            Their displacement.
        gradient : array (n, 2, 2)
            In-plane deformation gradient F = dx/dX at the points, in mesh coordinates.
        name : str
            One of `CAMERA_PARAMETERS`, or of the camera's motion.
        later : Camera, optional
            The camera of the deformed frame, where it moves.

        Returns
        -------
        phi : array (n, 2), px per unit of the parameter
        """
        x = _plane(points)
        y = x + _plane(u)
        later = self if later is None else later
        changed = later.parameter_jacobian(y, name)
        if self.motion is not None and name in self.motion.names:
            return changed  # the reference frame does not move
        at_reference = np.linalg.solve(self.jacobian(x), self.parameter_jacobian(x, name)[:, :, None])
        return changed - (later.jacobian(y) @ np.asarray(gradient)[:, :2, :2] @ at_reference)[:, :, 0]

    def normal_sign(self) -> float:
        """+1 where the third axis of the mesh points along the normal of measured points, -1 against it.

        Both systems are right-handed; rows count downwards.
        """
        return -float(np.sign(np.linalg.det(self.jacobian(np.zeros((1, 2)))[0])))


def _plane(points):
    points = np.asarray(points, dtype=float)
    if points.ndim != 2 or points.shape[1] not in (2, 3):
        raise ValueError(f"points must be (n, 2) or (n, 3), got {points.shape}")
    return points[:, :2]
