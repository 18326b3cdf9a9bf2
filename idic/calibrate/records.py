"""Input and result of a calibration."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial

import numpy as np
from scipy.spatial import ConvexHull

from idic.images import PinholeCamera
from idic.readers import CameraRig, TargetView

SIGNIFICANCE = 1e-3  # of a scatter between views: one of a thousand clean calibrations is called scattered

Views = tuple[tuple[TargetView | None, ...], ...]  # per image number: what every camera sees


@dataclass(frozen=True)
class Lens:
    """Which intrinsic values are identified; the others are zero, and fy = fx where only fx is.

    Attributes
    ----------
    identified : tuple of str
        Names of `PinholeCamera.intrinsics`.
    """

    identified: tuple[str, ...] = ("fx", "fy", "cx", "cy", "k1", "k2")

    @property
    def square(self) -> bool:
        """One focal length for both directions."""
        return "fx" in self.identified and "fy" not in self.identified


@dataclass(frozen=True, eq=False)
class Pose:
    """Target frame to the frame of camera 0: ``rotation @ x + translation_mm``."""

    rotation: np.ndarray
    translation_mm: np.ndarray


@dataclass(frozen=True, eq=False)
class State:
    """All that the bundle adjustment identifies.

    Attributes
    ----------
    cameras : tuple of PinholeCamera
        Camera 0 at the origin, the others relative to it.
    poses : tuple of Pose
        Of the target in every view.
    points_mm : array (n_points, 3)
        Target points in the target's frame.
    shape_mm : array (m,)
        Unknowns of the target that moved its points from their nominal places; empty where these hold.
    """

    cameras: tuple[PinholeCamera, ...]
    poses: tuple[Pose, ...]
    points_mm: np.ndarray
    shape_mm: np.ndarray = field(default_factory=partial(np.zeros, 0))


@dataclass(frozen=True)
class Scatter:
    """A scatter against that of the points within a view.

    Attributes
    ----------
    ratio : float
        Mean square between views over that within them; 1 without errors common to a view.
    probability : float
        Of a ratio as large by chance.
    """

    ratio: float
    probability: float

    @property
    def is_significant(self) -> bool:
        return self.probability < SIGNIFICANCE


@dataclass(frozen=True, eq=False)
class Between:
    """Scatter between the views of a calibration.

    Attributes
    ----------
    covariance : array (m, m)
        Of the shared unknowns (cameras, then target), with the scatter between views where it is
        significant, else with that of the points of each view.
    within_px : float
        Standard deviation of a coordinate of a point about the best cameras for its view alone.
    all_views : Scatter
    by_camera : tuple of Scatter
        Of each camera by itself, with poses of its own.
    pairs : Scatter or None
        Of the relative place of two cameras, of pairs.
    """

    covariance: np.ndarray
    within_px: float
    all_views: Scatter
    by_camera: tuple[Scatter, ...]
    pairs: Scatter | None


@dataclass(frozen=True, eq=False)
class Shape:
    """Where the points of a target are, other than stated, as identified with the cameras.

    Attributes
    ----------
    index : int array (n_points, 2)
        (column, row) of every point on the target.
    displacement_mm : array (n_points, 3)
        From the nominal place, in the target's frame: along its columns and rows, and away from the cameras.
    std_mm : array (n_points, 3)
        Standard deviations of these.
    out_of_plane, in_plane : float
        Probability of a shape as large by chance; 1 where it is not identified.
    """

    index: np.ndarray
    displacement_mm: np.ndarray
    std_mm: np.ndarray
    out_of_plane: float = 1.0
    in_plane: float = 1.0

    @property
    def is_bent(self) -> bool:
        return self.out_of_plane < SIGNIFICANCE

    @property
    def is_distorted(self) -> bool:
        """The spacings along both axes differ, or these are not perpendicular."""
        return self.in_plane < SIGNIFICANCE


@dataclass(frozen=True, eq=False)
class Calibration:
    """The result.

    Attributes
    ----------
    rig : CameraRig
        With covariance.
    poses : tuple of Pose
    residuals_px : tuple over views of tuple over cameras of array (n, 2) or None
        Seen minus projected.
    views : tuple over views of tuple over cameras of TargetView or None
    points_mm : array (n_points, 3)
    rms_px : float
        Root mean square distance between seen and projected points.
    noise_px : float
        Standard deviation of one coordinate of a point, from the residuals and their degrees of freedom.
    n_left_out : int
        Points with an outlying residual.
    between : Between
        Scatter between the views against that of the points within them.
    shape : Shape
        Of the target.
    notes : tuple of str
        What the calibration does not determine well, with the remedy.
    """

    rig: CameraRig
    poses: tuple[Pose, ...]
    residuals_px: tuple[tuple[np.ndarray | None, ...], ...]
    views: Views
    points_mm: np.ndarray
    rms_px: float
    noise_px: float
    n_left_out: int
    between: Between
    shape: Shape
    notes: tuple[str, ...] = field(default=())

    def coverage(self, camera: int) -> float:
        """Share of the image inside the convex hull of the points of all views."""
        width, height = self.rig.image_size_px[camera]
        points = np.vstack([row[camera].points_px for row in self.views if row[camera] is not None])
        return float(ConvexHull(points).volume / (width * height))

    @property
    def tilts_deg(self) -> np.ndarray:
        """Angle between the normal of the target and the line of sight of camera 0, per view; NaN where not seen."""
        middle, angles = self.points_mm.mean(axis=0), []
        for pose in self.poses:
            if pose is None:
                angles.append(np.nan)
                continue
            sight = pose.rotation @ middle + pose.translation_mm
            angles.append(np.degrees(np.arccos(min(abs(pose.rotation[:, 2] @ sight) / np.linalg.norm(sight), 1.0))))
        return np.array(angles)
