"""The record of every calibration file: cameras in one common frame, mm and px, distortion normalised."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy

from idic.errors import InputError
from idic.images import PinholeCamera

SKEW_UNITS = ("px", "deg")
DISTORTION_UNITS = ("normalised", "px")
ANGLE_ORDERS = ("xyz", "zyx")
MIN_DISTORTION_PX = 1e-3     # a distortion that moves no pixel by this much is not worth a coefficient: other unit
MAX_DISTORTION_SHARE = 0.5   # of the radius at the corner: no lens that a pinhole describes
MAX_SKEW_SHARE = 0.05        # of the focal length, 3 degrees: no sensor is that oblique
MAX_ROUNDING = 1e-3          # of a rotation matrix printed with few digits


@dataclass(frozen=True)
class Conventions:
    """Units and order of angles that a file does not state.

    Attributes
    ----------
    skew : "px" | "deg" | None
        Unit of the skew: entry (1, 2) of the camera matrix, or the angle whose tangent times fx is that entry.
        None: as the format has it.
    distortion : "normalised" | "px" | None
        Whether k1, k2, k3, p1, p2 multiply powers of the normalised radius, or of the radius in px. None: normalised,
        refused where that cannot be.
    angles : "xyz" | "zyx"
        Order in which the rotations about the three axes act: "xyz" is R = Rz Ry Rx, x first; "zyx" is R = Rx Ry Rz.
    """

    skew: str | None = None
    distortion: str | None = None
    angles: str = "xyz"

    def __post_init__(self):
        for name, allowed in (("skew", (None, *SKEW_UNITS)), ("distortion", (None, *DISTORTION_UNITS)),
                              ("angles", ANGLE_ORDERS)):
            if getattr(self, name) not in allowed:
                raise InputError("no such convention", key=name, found=getattr(self, name),
                                 expected=", ".join(str(word) for word in allowed if word),
                                 remedy="use one of these words")


@dataclass(frozen=True)
class CameraStd:
    """Standard deviations of the values of one camera, in the units of `PinholeCamera`; 0 where a value is held.

    Pose: relative to camera 0, rotation about the axes of this camera in degrees, shift in mm.
    """

    fx: float = 0.0
    fy: float = 0.0
    skew: float = 0.0
    cx: float = 0.0
    cy: float = 0.0
    k1: float = 0.0
    k2: float = 0.0
    k3: float = 0.0
    p1: float = 0.0
    p2: float = 0.0
    rotation_x: float = 0.0
    rotation_y: float = 0.0
    rotation_z: float = 0.0
    t_x: float = 0.0
    t_y: float = 0.0
    t_z: float = 0.0

    def of(self, name: str) -> float:
        """The one of a parameter of `PinholeCamera.parameters`."""
        return float(getattr(self, name))


@dataclass(frozen=True, eq=False)
class CameraRig:
    """Calibrated cameras.

    Attributes
    ----------
    cameras : tuple of PinholeCamera
        Their poses take points of one common frame: the frame of the file, or that of camera 0.
    image_size_px : tuple of (width, height) or None
        Per camera; None where the file does not tell.
    names : tuple of str
        What ``covariance`` is about: ``"0.fx"`` is fx of camera 0; pose parameters as of `PinholeCamera`.
    covariance : array (m, m) or None
        Of a calibration whose file holds it.
    """

    cameras: tuple[PinholeCamera, ...]
    image_size_px: tuple[tuple[int, int] | None, ...]
    names: tuple[str, ...] = ()
    covariance: np.ndarray | None = None

    @property
    def std(self) -> tuple[CameraStd, ...] | None:
        """Standard deviations per camera; None where the file holds no covariance."""
        if self.covariance is None:
            return None
        deviations = dict(zip(self.names, np.sqrt(np.diag(self.covariance)).tolist(), strict=True))
        return tuple(CameraStd(**{name: deviations.get(f"{number}.{name}", 0.0) for name in PinholeCamera.parameters})
                     for number in range(len(self.cameras)))

    def in_frame_of(self, camera: int = 0) -> CameraRig:
        """The same rig with points given in the frame of one of its cameras."""
        if self.covariance is not None and camera != 0:
            raise ValueError("the covariance holds for the frame of camera 0")
        home = self.cameras[camera]
        placed = []
        for pinhole in self.cameras:
            rotation = np.eye(3) if pinhole is home else pinhole.rotation @ home.rotation.T
            shift = np.zeros(3) if pinhole is home else pinhole.translation_mm - rotation @ home.translation_mm
            placed.append(pinhole.placed(rotation, shift))
        return replace(self, cameras=tuple(placed))


def camera_of(values: dict[str, float], conventions: Conventions, file, camera: int, image_size=None, rotation=None,
              translation_mm=None) -> PinholeCamera:
    """A camera of values as a file has them: fx, fy, cx, cy and any of skew, k1, k2, k3, p1, p2.

    Raises
    ------
    InputError
        Where a value is missing, or where a distortion or a skew cannot be in the unit it is read in.
    """
    missing = [name for name in ("fx", "fy", "cx", "cy") if name not in values]
    if missing:
        raise InputError("values of a camera are missing", file=file, key=f"camera {camera}",
                         expected="fx, fy, cx, cy", found=f"no {', '.join(missing)}",
                         remedy="export the calibration again")
    values = dict(values)
    if conventions.skew == "deg":
        values["skew"] = values["fx"] * float(np.tan(np.radians(values.get("skew", 0.0))))
    if conventions.distortion == "px":
        focal = float(np.sqrt(values["fx"] * values["fy"]))
        for name, power in (("k1", 2), ("k2", 4), ("k3", 6), ("p1", 1), ("p2", 1)):
            values[name] = values.get(name, 0.0) * focal**power
    try:
        pinhole = PinholeCamera(**values, rotation=np.eye(3) if rotation is None else nearest_rotation(rotation),
                                translation_mm=np.zeros(3) if translation_mm is None else translation_mm)
    except InputError as error:
        raise InputError(error.what, file=file, key=f"camera {camera}: {error.key}", expected=error.expected,
                         found=error.found, remedy=error.remedy) from None
    _check_units(pinhole, conventions, file, camera, image_size)
    return pinhole


def rotation_of_angles(angles_deg, conventions: Conventions) -> np.ndarray:
    """Rotation matrix of the angles about x, y, z in degrees, in the order of the conventions  # (3, 3)"""
    x, y, z = (scipy.spatial.transform.Rotation.from_euler(axis, angle, degrees=True).as_matrix()
               for axis, angle in zip("xyz", angles_deg, strict=True))
    return z @ y @ x if conventions.angles == "xyz" else x @ y @ z


def nearest_rotation(matrix) -> np.ndarray:
    """The rotation next to a matrix of few digits (its orthogonal polar factor); as it is where it is not one."""
    matrix = np.asarray(matrix, dtype=float)
    if matrix.shape != (3, 3) or not np.isfinite(matrix).all():
        return matrix
    u, _, vt = np.linalg.svd(matrix)
    rotation = u @ vt
    return rotation if np.abs(rotation - matrix).max() < MAX_ROUNDING else matrix


def _check_units(camera, conventions, file, number, image_size):
    width, height = image_size or (2.0 * max(camera.cx, 1.0), 2.0 * max(camera.cy, 1.0))
    corners = np.array([[x, y] for x in (0.0, width - 1.0) for y in (0.0, height - 1.0)])
    radius = np.sqrt((((corners - [camera.cx, camera.cy]) / [camera.fx, camera.fy]) ** 2).sum(axis=1)).max()
    radial = max(abs(camera.k1) * radius**2, abs(camera.k2) * radius**4, abs(camera.k3) * radius**6)
    tangential = 3.0 * max(abs(camera.p1), abs(camera.p2)) * radius
    share, distorted = max(radial, tangential), any((camera.k1, camera.k2, camera.k3, camera.p1, camera.p2))
    words = f"k1 = {camera.k1:g}, k2 = {camera.k2:g}, k3 = {camera.k3:g}, p1 = {camera.p1:g}, p2 = {camera.p2:g}"
    if distorted and conventions.distortion is None and share * radius * camera.fx < MIN_DISTORTION_PX:
        raise InputError("a distortion without effect: its coefficients are not of normalised coordinates",
                         file=file, key=f"camera {number}", found=words,
                         expected=f"more than {MIN_DISTORTION_PX} px at the corners of the image",
                         remedy='if they are per px², px⁴, px⁶: distortion = "px"; if they are intended: "normalised"')
    if share > MAX_DISTORTION_SHARE:
        raise InputError("a distortion larger than any lens has", file=file, key=f"camera {number}", found=words,
                         expected="less than half of the radius at the corners of the image",
                         remedy="check the unit of the coefficients and their sequence (k1, k2, p1, p2, k3 in OpenCV)")
    if abs(camera.skew) > MAX_SKEW_SHARE * camera.fx:
        raise InputError("a skew larger than any sensor has", file=file, key=f"camera {number}: skew",
                         found=f"{camera.skew:g} px", expected=f"less than {MAX_SKEW_SHARE} of the focal length",
                         remedy="check the unit of the skew (px or deg) and the entry of the camera matrix")
