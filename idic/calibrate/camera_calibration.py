"""The calibration of one camera or of a pair, with its covariance and notes on values that it does not determine."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.stats import f as f_distribution

from idic.calibrate.between_views import between_views, by_points
from idic.calibrate.bundle import Adjusted, adjust, seen_points
from idic.calibrate.image_noise import Image, Linear, image_noise, inlying
from idic.calibrate.judge import notes_on
from idic.calibrate.projection import N_POSE, derivatives, n_cameras_unknowns, n_unknowns
from idic.calibrate.records import Between, Calibration, Lens, Pose, SIGNIFICANCE, Shape, State, Views
from idic.calibrate.shape import Target, exact, out_of_plane, with_print
from idic.calibrate.start import numbered, one_camera, second_camera
from idic.errors import InputError
from idic.images import RIGID
from idic.readers import CameraRig

PRIOR_PASSES = 2            # free points and the noise of the images depend on each other: settled after the second
MIN_VIEWS = 3               # of a flat target: below, focal length and centre are not determined


def calibrate(views: Views, image_size_px: tuple[tuple[int, int], ...], spacing_mm: float, lens: Lens | None = None,
              target_std_mm: float | None = None) -> Calibration:
    """Cameras whose projections of a flat target lie closest to the seen points.

    Parameters
    ----------
    views : tuple over images of tuple over cameras (one or two) of TargetView or None
    image_size_px : per camera (width, height)
    spacing_mm : float
        Distance of neighbouring points of the target.
    lens : Lens, optional
        Which intrinsic values are free.
    target_std_mm : float, optional
        Standard deviation of every point of the target from its nominal place. 0: they are exact; above 0 all of them
        are identified with the cameras. By default a smooth bend is identified, and other spacings along its two axes
        where the images show them.

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
    points, used, state, seen_views = _start(views, image_size_px, spacing_mm, lens)
    target = _target(points, target_std_mm)
    first = adjust(state, used, lens, replace(target, point_std_mm=0.0))
    linear = _linear(first, used, lens, exact(points))
    good = inlying(linear, lens)
    used = _chosen(used, good)
    n_left_out = int(sum((~part).sum() for part in good.values()))
    noise = image_noise({key: image.of_points(good[key]) for key, image in linear.items()}, lens)
    best = adjust(first.state, used, lens, target, noise)
    for _ in range(PRIOR_PASSES if target.n_free_points else 0):
        noise = image_noise(_linear(best, used, lens, exact(points)), lens)
        best = adjust(best.state, used, lens, target, noise)
    if target_std_mm is None:
        target, best = _with_print_if_seen(best, used, lens, target, with_print(target, points), noise)
    between = _between(best, used, lens, target, noise)
    shape = _shape(best, between, target, np.rint(points[:, :2] / spacing_mm).astype(int))
    rig = _rig(best.state.cameras, lens, between.covariance, image_size_px)
    residuals, views_out = _in_place(best.residuals_px, used, seen_views, len(views), n_cameras)
    poses_out = dict(zip(seen_views, best.state.poses, strict=True))
    result = Calibration(rig, tuple(poses_out.get(v) for v in range(len(views))), residuals,
                         views_out,
                         best.state.points_mm, best.rms_px, best.noise_px, n_left_out, between,
                         shape)
    return replace(result, notes=notes_on(result, target_std_mm))


def _start(views: Views, image_size_px, spacing_mm: float, lens: Lens
           ) -> tuple[np.ndarray, Views, State, list[int]]:
    """Nominal points, the views with numbers of these where a pose is known, the state to start from, and the numbers
    of these views.
    """
    n_cameras = len(image_size_px)
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
    return points, used, state, seen_views


def _target(points: np.ndarray, std_mm: float | None) -> Target:
    """What is free of the target by the stated standard deviation of its points."""
    if std_mm == 0.0:
        return exact(points)
    return replace(out_of_plane(points), point_std_mm=std_mm or 0.0)


def _with_print_if_seen(adjusted: Adjusted, views: Views, lens: Lens, target: Target, wider: Target,
                        noise: dict[Image, float]) -> tuple[Target, Adjusted]:
    """The wider target where the images show what it adds, else the present one, and the adjustment to it."""
    step, covariance = by_points(_linear(adjusted, views, lens, wider), noise, _prior(adjusted, lens, wider))
    step_mm, freedom = step[len(step) - wider.n_unknowns :], adjusted.all_px.size - len(adjusted.cofactor)
    probability = _probability(step_mm, covariance, wider, ~wider.is_normal, freedom)
    if probability < SIGNIFICANCE:  # by the points; the scatter between views is dearer
        between = _between(adjusted, views, lens, wider, noise)
        probability = _probability(step_mm, between.covariance, wider, ~wider.is_normal,
                                   _freedom(adjusted, between))
    if probability < SIGNIFICANCE:
        return wider, adjust(adjusted.state, views, lens, wider, noise)
    return target, adjusted


def _freedom(adjusted: Adjusted, between: Between) -> int:
    """Degrees of freedom of the covariance."""
    if between.all_views.is_significant:
        return len(adjusted.state.poses) - 1
    return adjusted.all_px.size - len(adjusted.cofactor)


def _probability(shape_mm: np.ndarray, covariance: np.ndarray, target: Target, chosen: np.ndarray, freedom: int
                 ) -> float:
    """Of coefficients of some modes as large by chance  # (m,), covariance of all shared unknowns, bool (n_modes,)"""
    modes = np.flatnonzero(chosen)
    if not len(modes):
        return 1.0
    first = len(covariance) - target.n_unknowns
    square = shape_mm[modes] @ np.linalg.solve(covariance[first:, first:][np.ix_(modes, modes)], shape_mm[modes])
    return float(f_distribution.sf(square / len(modes), len(modes), max(freedom, 1)))


def _shape(adjusted: Adjusted, between: Between, target: Target, index: np.ndarray) -> Shape:
    """The shape of the target with its standard deviations."""
    first, shape_mm = len(between.covariance) - target.n_unknowns, adjusted.state.shape_mm
    out_of_plane, in_plane = (_probability(shape_mm, between.covariance, target, chosen, _freedom(adjusted, between))
                              for chosen in (target.is_normal, ~target.is_normal))
    return Shape(index, *target.shape_mm(shape_mm, between.covariance[first:, first:]), out_of_plane, in_plane)


def _chosen(views: Views, good: dict[Image, np.ndarray]) -> Views:
    """The views with some of their points."""
    return tuple(tuple(None if view is None else
                       replace(view, index=view.index[good[v, c]], points_px=view.points_px[good[v, c]],
                               areas_px=None if view.areas_px is None else view.areas_px[good[v, c]])
                       for c, view in enumerate(row)) for v, row in enumerate(views))


def _linear(adjusted: Adjusted, views: Views, lens: Lens, target: Target) -> dict[Image, Linear]:
    """The equations of every image about an adjusted state."""
    state, images = adjusted.state, {}
    n, n_first = n_unknowns(state, lens, target), n_cameras_unknowns(len(state.cameras), lens)
    n_poses = N_POSE * len(state.poses)
    for c, points in enumerate(seen_points(views)):
        slopes = derivatives(state, lens, np.zeros(n), target, c, points.view_of, points.numbers)
        columns = np.where(slopes.columns < n_first, slopes.columns, slopes.columns - n_poses)
        for v, numbers, common, pose, by_point in zip(points.views, *map(points.split, (
                points.numbers, slopes.common, slopes.pose, slopes.by_point)), strict=True):
            shared = np.zeros((len(common), 2, n - n_poses))
            shared[:, :, columns] = common
            for k, number in enumerate(numbers if target.n_free_points else ()):
                at = n_first + target.n_modes + 3 * number
                shared[k, :, at : at + 3] = by_point[k]
            images[v, c] = Linear(shared.reshape(-1, n - n_poses), pose.reshape(-1, N_POSE),
                                  adjusted.residuals_px[v][c].ravel())
    return images


def _between(adjusted: Adjusted, views: Views, lens: Lens, target: Target, noise: dict[Image, float]) -> Between:
    """The scatter between the views of an adjustment."""
    return between_views(_linear(adjusted, views, lens, target), noise, len(adjusted.state.cameras), lens,
                         _prior(adjusted, lens, target))


def _prior(adjusted: Adjusted, lens: Lens, target: Target) -> np.ndarray:
    """Weights of the prior of the unknowns of cameras and target."""
    return np.concatenate([np.zeros(n_cameras_unknowns(len(adjusted.state.cameras), lens)), target.prior_std_mm**-2.0])


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
            names += [f"{number}.{name}" for name in RIGID]
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


