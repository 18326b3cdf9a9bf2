"""The pose of the mesh by least squares of what the reference images show, and its covariance.

The residuals (`idic.experiment_file.placing.observations`) depend on each other within pieces of a contour, which all
cameras share: the covariance of the robust fit is H^-1 (sum_pieces g g^T) H^-1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from idic.experiment_file.placing.contours import on_circle
from idic.experiment_file.placing.observations import Evidence, Observations
from idic.errors import InputError
from idic.images import PlacedCamera, RIGID, rotation_of

MIN_STD_PX = 0.02       # of a contour point or a match
N_WEIGHTINGS = 2
MAX_STEPS = 60  # of a fit
MIN_EIGENVALUE = 1e-8   # of the smallest over the largest one of H, in units of px: below, the pose is open


@dataclass(frozen=True, eq=False)
class Pose:
    """Rotation (3, 3) and translation (3,) mm from the mesh frame to that of the calibration.

    covariance : (6, 6) of rotation vector (deg) and translation (mm) about the pivot, in mesh axes (``placement.*``);
    rims : per contour the rms distance from the mesh (px; of a hole with the radius found), the offset (px) and of
    holes the radius (mm); rms_click_px, rms_surface_mm : NaN where there are none; cost : of the fit
    """

    rotation: np.ndarray
    translation_mm: np.ndarray
    covariance: np.ndarray
    rims: tuple[tuple[float, float, float], ...]
    rms_click_px: float
    rms_surface_mm: float
    cost: float

    @property
    def std(self) -> np.ndarray:
        """Standard deviations of the six numbers  # (6,) deg, mm"""
        return np.sqrt(np.diag(self.covariance))

    def step_to(self, target: Pose, pivot_mm: np.ndarray) -> np.ndarray:
        """The six numbers that bring this pose to another one  # (6,) deg, mm"""
        turn = self.rotation.T @ target.rotation
        shift = self.rotation.T @ (target.translation_mm - self.translation_mm) - pivot_mm + turn @ pivot_mm
        return np.append(scipy.spatial.transform.Rotation.from_matrix(turn).as_rotvec(degrees=True), shift)


def fitted_pose(cameras: Sequence[PlacedCamera], evidence: Evidence) -> Pose:
    """Least squares from the present place of the cameras.

    Raises
    ------
    InputError
        What is seen leaves a rigid motion of the mesh open.
    """
    observations = Observations(cameras, evidence)
    z = np.concatenate([np.zeros(6), observations.start])
    for weighting in range(N_WEIGHTINGS + 1):
        z = _minimised(observations, z)
        if weighting < N_WEIGHTINGS:
            raw = observations.raw(z)
            for name in observations.std.keys() & raw.keys():
                floor = MIN_STD_PX * (1.0 if name != "surface" else 1.0 / observations.per_mm.mean())
                observations.std[name] = max(floor, 1.4826 * float(np.median(np.abs(raw[name]))))
    return _made(observations, z)


def reselected(cameras: Sequence[PlacedCamera], evidence: Evidence) -> Evidence:
    """The same with the points of a hole that lie on a circle of the mesh: three unknowns where the ellipse had five.

    cameras : at a place that is nearly right
    """
    full_evidence = replace(evidence, rims=[replace(rim, contour=replace(rim.contour, px=rim.contour.every))
                                            for rim in evidence.rims])
    observations, rims = Observations(cameras, full_evidence), []
    for k, rim in enumerate(evidence.rims):
        if rim.along is None:
            at = observations.flat(k) * observations.per_mm[rim.camera]
            rim = replace(rim, contour=replace(rim.contour, px=rim.contour.every[on_circle(at)]))
        rims.append(rim)
    return replace(evidence, rims=rims)


def _minimised(observations: Observations, z: np.ndarray) -> np.ndarray:
    """The least sum of 2 (sqrt(1 + r²) - 1)."""
    return scipy.optimize.least_squares(observations.residuals, z, observations.slopes, loss="soft_l1", x_scale="jac",
                                        max_nfev=MAX_STEPS).x


def _cost(residual: np.ndarray) -> float:
    return float(2.0 * (np.sqrt(1.0 + residual**2) - 1.0).sum())


def _made(observations: Observations, z: np.ndarray) -> Pose:
    raw, residual = observations.raw(z), observations.residuals(z)
    weight = 1.0 / np.sqrt(1.0 + residual**2)  # of soft_l1
    slopes = observations.slopes(z)
    bend = (slopes * weight[:, None]).T @ slopes
    _check_closed(bend, observations.evidence)
    pieces = observations.pieces(z)
    score = slopes * (weight * residual)[:, None]
    n_pieces = int(pieces.max(initial=-1)) + 1
    summed = np.zeros((n_pieces, len(z)))
    np.add.at(summed, pieces[pieces >= 0], score[pieces >= 0])
    few = n_pieces / max(n_pieces - len(z), 1)
    independent = slopes[pieces < 0]
    inverse = np.linalg.inv(bend)
    covariance = inverse @ (few * summed.T @ summed + independent.T @ independent) @ inverse
    six = observations.unit[:, None] * covariance[:6, :6] * observations.unit[None, :]
    camera, place = observations.cameras[0], z[:6] * observations.unit
    turn = rotation_of(place[:3])
    shift = camera.rotation @ (camera.pivot_mm - turn @ camera.pivot_mm + place[3:]) + camera.translation_mm
    at_mesh = observations.raw(observations.without_shifts(z))
    rims = tuple((float(np.sqrt(np.mean(at_mesh[f"rim {k}"] ** 2))), float(z[6 + k]), _found_radius(observations, k, z))
                 for k in range(len(observations.evidence.rims)))
    clicks = [offset for name, offset in raw.items() if name.startswith("points")]
    return Pose(camera.rotation @ turn, shift, six, rims,
                float(np.sqrt(2.0 * np.mean(np.concatenate(clicks) ** 2))) if clicks else float("nan"),
                float(np.sqrt(np.mean(raw["surface"] ** 2))) if "surface" in raw else float("nan"),
                _cost(residual))


def _found_radius(observations: Observations, k: int, z: np.ndarray) -> float:
    rim = observations.evidence.rims[k]
    return (rim.radius_mm or 0.0) + z[6 + k] / observations.per_mm[rim.camera] if rim.along is None else float("nan")


def _check_closed(bend: np.ndarray, evidence: Evidence) -> None:
    values, vectors = np.linalg.eigh(bend)
    if values[0] > MIN_EIGENVALUE * values[-1]:
        return
    open_one = RIGID[int(np.argmax(np.abs(vectors[:6, 0])))]
    raise InputError("the alignment leaves the place of the mesh open",
                     expected="two holes, or one hole and an edge, on a measured surface; without one, three "
                              "points, two holes with radius_mm, or two edges and a hole with radius_mm",
                     found=f"{sum(rim.along is None for rim in evidence.rims)} contours of holes, "
                           f"{sum(rim.along is not None for rim in evidence.rims)} of edges; the mesh can still "
                           f"move in {open_one}", remedy="add a hole, an edge, or clicked points")
