"""The mesh placed before calibrated cameras by clicked points: the pose with the least reprojection error in all
images.

One camera: the pose of n points (PnP), started from a plane or a general solution by direct linear transformation. More
cameras of a rig: the same six unknowns, fitted to the clicks of all of them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy

from idic.errors import InputError
from idic.experiment_file.pinhole.baseline import other_baseline
from idic.experiment_file.pinhole.clicks import Clicks
from idic.images import PlacedCamera, rotation_of

MAX_CLICK_ERROR_PX = 5.0   # rms: more is another point, another image, or left and right swapped
NOTED_CLICK_ERROR_PX = 1.0
N_REFINED_STARTS = 8
MIN_SPREAD = 1e-3          # second over first singular value of the points: below, they lie on a line


def aligned(clicks: Sequence[Clicks], file,
            max_error_px: float = MAX_CLICK_ERROR_PX) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Rotation (3, 3) and translation (3,) mm from the mesh frame to that of the rig, and notes.

    max_error_px : rms; of places that are only near the points, more

    Raises
    ------
    InputError
        The points lie on a line, or no pose brings them near their clicks.
    """
    points = np.concatenate([c.points_mm for c in clicks])
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    if not spread[1] > MIN_SPREAD * spread[0]:
        raise InputError("the points of the alignment lie on a line", file=file, key=clicks[0].key,
                         expected="three points or more that span a plane", found=f"{len(points)} points",
                         remedy="click corners and holes that lie far apart")
    starts = sorted(_starts(clicks), key=lambda start: _click_error(clicks, *start))[:N_REFINED_STARTS]
    best = min((_refined(clicks, start) for start in starts), key=lambda pose: pose[2])
    rotation, shift, error = best
    far_off = error > max_error_px  # then the pose that each camera sees alone is the nearer start
    baseline = other_baseline(clicks, [_of_one_camera(c) for c in clicks] if far_off else [(rotation, shift)], error)
    if error > max_error_px:
        worst, worst_key = max((float(np.abs(c.camera.project(c.points_mm @ rotation.T + shift) - c.points_px).max()),
                                c.key) for c in clicks)
        raise InputError("the clicked points do not fit the calibration", file=file, key=clicks[0].key,
                         expected=f"a pose that leaves less than {max_error_px:g} px (rms)",
                         found=f"{error:.1f} px, up to {worst:.1f} px in {worst_key}",
                         remedy=baseline
                         or "check points_mm and points_px, the image that they were clicked in, and whether left "
                            "and right camera are swapped (calibration_camera)")
    notes = [f"alignment: {len(points)} clicked points, {error:.2f} px (rms)"]
    if baseline is not None:
        notes[0] += f"; {baseline}"
    elif error > NOTED_CLICK_ERROR_PX:
        notes[0] += "; look at the picture of  idic check, and identify placement.* if the mesh is off"
    return rotation, shift, notes


def _of_one_camera(click: Clicks) -> tuple[np.ndarray, np.ndarray]:
    """The pose that one camera alone sees, in the frame of the rig."""
    starts = sorted(_starts([click]), key=lambda start: _click_error([click], *start))[:N_REFINED_STARTS]
    rotation, shift, _ = min((_refined([click], start) for start in starts), key=lambda pose: pose[2])
    return rotation, shift


def _click_error(clicks: Sequence[Clicks], rotation: np.ndarray, shift: np.ndarray) -> float:
    """Sum of squared distances to the clicks, px²; infinite where a point is behind a camera."""
    try:
        return sum(float(((c.camera.project(c.points_mm @ rotation.T + shift) - c.points_px) ** 2).sum())
                   for c in clicks)
    except InputError:
        return np.inf


def _starts(clicks: Sequence[Clicks]):
    """Poses to begin with: of every camera alone, in the frame of the rig."""
    for c in clicks:
        ideal = c.camera.normalised(c.points_px)
        for rotation, shift in _linear_poses(c.points_mm, ideal):
            yield (c.camera.rotation.T @ rotation, c.camera.rotation.T @ (shift - c.camera.translation_mm))


def _linear_poses(points: np.ndarray, ideal: np.ndarray):
    """Poses before a camera from a homography of the plane of the points, and its mirror about the line of sight."""
    middle = points.mean(axis=0)
    _, _, axes = np.linalg.svd(points - middle)
    axes = axes * np.sign(np.linalg.det(axes))
    flat = (points - middle) @ axes.T
    rows = []
    for (x, y, _), (p, q) in zip(flat, ideal, strict=True):
        rows += [[x, y, 1, 0, 0, 0, -p * x, -p * y, -p], [0, 0, 0, x, y, 1, -q * x, -q * y, -q]]
    if len(points) >= 4:
        homography = np.linalg.svd(np.array(rows))[2][-1].reshape(3, 3)
        yield from _of_homography(homography, middle, axes)
    size = np.sqrt((flat[:, :2] ** 2).sum() / max(((ideal - ideal.mean(axis=0)) ** 2).sum(), 1e-300))
    for tilt in ((0, 0), (30, 0), (-30, 0), (0, 30), (0, -30)):  # seen square, or at an angle: the fit finds the rest
        for turned in range(0, 360, 45):
            for side in (np.eye(3), np.diag([1.0, -1.0, -1.0])):
                turn = rotation_of([*tilt, 0.0]) @ rotation_of([0.0, 0.0, turned]) @ side @ axes
                yield turn, size * np.array([*ideal.mean(axis=0), 1.0]) - turn @ middle


def _of_homography(homography: np.ndarray, middle: np.ndarray, axes: np.ndarray):
    scale = np.linalg.norm(homography[:, :2], axis=0).mean()
    h = homography / scale * np.sign(homography[2, 2])
    u, _, vt = np.linalg.svd(np.column_stack([h[:, 0], h[:, 1], np.cross(h[:, 0], h[:, 1])]))
    turn = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
    for turned in (turn, turn @ rotation_of([20.0, 0.0, 0.0]), turn @ rotation_of([0.0, 20.0, 0.0])):
        yield turned @ axes, h[:, 2] - turned @ axes @ middle


def _refined(clicks: Sequence[Clicks], start) -> tuple[np.ndarray, np.ndarray, float]:
    """Least squares over the six unknowns from a start, and the rms of a click (px); infinite behind a camera."""
    rotation, shift = start
    pivot = np.concatenate([c.points_mm for c in clicks]).mean(axis=0)
    size = max(float(np.abs(np.concatenate([c.points_mm for c in clicks]) - pivot).max()), 1e-12)
    unit = np.array([np.degrees(1.0)] * 3 + [size] * 3)

    def placed(z):
        return [PlacedCamera(c.camera, rotation, shift, z * unit, pivot) for c in clicks]

    def residual(z):
        try:
            return np.concatenate([(camera.project(c.points_mm) - c.points_px).ravel()
                                   for camera, c in zip(placed(z), clicks, strict=True)])
        except InputError:
            return np.full(sum(c.points_px.size for c in clicks), 1e6)

    def slopes(z):
        try:
            return np.concatenate([np.stack([camera.parameter_jacobian(c.points_mm, name).ravel() for name in
                                             [n for n in camera.values() if n.startswith("placement.")]], axis=1)
                                   for camera, c in zip(placed(z), clicks, strict=True)]) * unit
        except InputError:
            return np.zeros((sum(c.points_px.size for c in clicks), 6))

    if not np.isfinite(_click_error(clicks, rotation, shift)):
        return rotation, shift, np.inf
    fit = scipy.optimize.least_squares(residual, np.zeros(6), slopes, x_scale="jac", max_nfev=60)
    six = fit.x * unit
    turn = rotation_of(six[:3])
    error = float(np.sqrt((fit.fun**2).sum() / (len(fit.fun) / 2)))
    return rotation @ turn, rotation @ (pivot - turn @ pivot + six[3:]) + shift, error
