"""The calibration of one camera or of a pair, with its covariance and notes on values that it does not determine."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from idic.calibrate.between_views import between_views
from idic.calibrate.bundle import Adjusted, adjust, without_outliers
from idic.calibrate.judge import notes_on
from idic.calibrate.projection import N_POSE, derivatives, n_unknowns
from idic.calibrate.records import Between, Calibration, Lens, Pose, State, Views
from idic.calibrate.start import numbered, one_camera, second_camera
from idic.errors import InputError
from idic.images import POSE_PARAMETERS
from idic.readers import CameraRig

PRIOR_PASSES = 2            # the weight of the prior of target points depends on the noise: settled after the first
MIN_VIEWS = 3               # of a flat target: below, focal length and centre are not determined


def calibrate(views: Views, image_size_px: tuple[tuple[int, int], ...], spacing_mm: float, lens: Lens | None = None,
              target_std_mm: float = 0.0) -> Calibration:
    """Cameras whose projections of a flat target lie closest to the seen points.

    Parameters
    ----------
    views : tuple over images of tuple over cameras (one or two) of TargetView or None
    image_size_px : per camera (width, height)
    spacing_mm : float
        Distance of neighbouring points of the target.
    lens : Lens, optional
        Which intrinsic values are free.
    target_std_mm : float
        Standard deviation of a point of the target from its nominal place; 0: exact. Above 0 the points are identified,
        too.

    Returns
    -------
    Calibration
        With the covariance of all free values of the cameras, from the scatter of the points within each view and,
        where it is significant, from that between the views.

    Raises
    ------
    InputError
        Fewer than three views of a camera, or pairs that do not fit together.
    NotConverged
        The adjustment does not converge.
    """
    lens, n_cameras = lens or Lens(), len(image_size_px)
    for number in range(n_cameras):
        n_views = sum(row[number] is not None for row in views)
        if n_views < MIN_VIEWS:
            raise InputError("too few images show the target", key=f"camera {number}", found=f"{n_views}",
                             expected=f"at least {MIN_VIEWS}, better 15, at different tilts and places",
                             remedy="record more images of the target; check --target and --grid")
    used, points = numbered(views, spacing_mm)
    single_cameras = [one_camera(used, number, points, image_size_px[number], lens) for number in range(n_cameras)]
    cameras = [next(iter(single_cameras[0].values()))[0]]
    if n_cameras == 2:
        camera, used = second_camera(single_cameras[0], single_cameras[1], used, points)
        cameras.append(camera)
    first_poses = {v: pose for v, (_, pose) in single_cameras[0].items()}
    second_poses = {v: _pose_in_camera_0(cameras[1], pose)
                    for v, (_, pose) in single_cameras[1].items()} if n_cameras == 2 else {}
    poses = [first_poses.get(v, second_poses.get(v)) for v in range(len(used))]
    seen_views = [v for v, pose in enumerate(poses) if pose is not None]
    used = tuple(used[v] for v in seen_views)
    state = State(tuple(cameras), tuple(poses[v] for v in seen_views), points)
    first = adjust(state, used, lens)
    used, n_left_out = without_outliers(first, used)
    best = adjust(first.state, used, lens)
    for _ in range(PRIOR_PASSES if target_std_mm > 0.0 else 0):
        best = adjust(replace(best.state, points_mm=points), used, lens, target_std_mm, best.noise_px)
    noise = best.noise_px
    between = _between(best, used, lens, target_std_mm)
    rig = _rig(best.state.cameras, lens, between.covariance, image_size_px)
    residuals, views_out = _in_place(best.residuals_px, used, seen_views, len(views), n_cameras)
    poses_out = dict(zip(seen_views, best.state.poses, strict=True))
    result = Calibration(rig, tuple(poses_out.get(v) for v in range(len(views))), residuals,
                         views_out,
                         best.state.points_mm, best.rms_px, noise, n_left_out, between)
    return replace(result, notes=notes_on(result, target_std_mm))


def _between(adjusted: Adjusted, views: Views, lens: Lens, target_std_mm: float) -> Between:
    """The scatter between the views of an adjustment."""
    state, points_free = adjusted.state, target_std_mm > 0.0
    n, n_cameras = n_unknowns(state, lens, points_free), len(state.cameras)
    first_pose = n_cameras * len(lens.identified) + N_POSE * (n_cameras - 1)
    last_pose = first_pose + N_POSE * len(state.poses)
    shared = np.r_[:first_pose, last_pose:n]
    prior = np.zeros(len(shared))
    if points_free:
        prior[first_pose:] = (adjusted.noise_px / target_std_mm)**2
    rows, errors = {}, {}
    for v, row in enumerate(views):
        for c, view in enumerate(row):
            if view is not None:
                slopes = derivatives(state, lens, np.zeros(n), points_free, v, c, view.index[:, 0])
                pose = first_pose + N_POSE * v + np.arange(N_POSE)
                rows[v, c] = slopes[:, np.r_[shared, pose]]
                errors[v, c] = adjusted.residuals_px[v][c].ravel()
    return between_views(rows, errors, n_cameras, lens, len(shared), np.diag(prior))


def _rig(cameras, lens: Lens, covariance: np.ndarray, sizes) -> CameraRig:
    names, rows = [], []
    at = 0
    for number in range(len(sizes)):
        for name in lens.identified:
            names.append(f"{number}.{name}")
            rows.append((at, 1.0))
            if name == "fx" and lens.square:
                names.append(f"{number}.fy")
                rows.append((at, 1.0))
            at += 1
        if number:
            names += [f"{number}.{name}" for name in POSE_PARAMETERS]
            rows += [(at + k, np.degrees(1.0) if k < 3 else 1.0) for k in range(6)]
            at += 6
    order = np.array([row for row, _ in rows])
    factor = np.array([f for _, f in rows])
    return CameraRig(cameras, tuple(sizes), tuple(names),
                     covariance[np.ix_(order, order)] * factor[:, None] * factor)


def _pose_in_camera_0(camera, pose):
    """The pose of a target in the frame of camera 0, of its pose in that of another camera."""
    return Pose(camera.rotation.T @ pose.rotation, camera.rotation.T @ (pose.translation_mm - camera.translation_mm))


def _in_place(residuals, used, seen_views, n_views, n_cameras):
    """Residuals and views by the numbers of the images."""
    empty = (None,) * n_cameras
    by_view = dict(zip(seen_views, zip(residuals, used, strict=True), strict=True))
    return (tuple(by_view[v][0] if v in by_view else empty for v in range(n_views)),
            tuple(by_view[v][1] if v in by_view else empty for v in range(n_views)))


