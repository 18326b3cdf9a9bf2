"""Projected points of a view with their derivatives by everything that the bundle adjustment identifies.

    x_pixel = camera_c( R_v X + t_v )

with the pose (R_v, t_v) of the target in the frame of camera 0, and camera c with its own pose relative to that frame.
"""

from __future__ import annotations

import numpy as np

from idic.calibrate.records import Lens, Pose, State
from idic.images import PinholeCamera, left_jacobian, rotation_of

N_POSE = 6
_RING = np.sqrt(2.0 / 3.0) * np.column_stack([np.cos(np.pi / 3 * np.arange(6)), np.sin(np.pi / 3 * np.arange(6))])
_DISC = np.vstack([np.zeros((1, 2)), _RING])               # unit disc, exact to degree 5:
# A. H. Stroud, Approximate Calculation of Multiple Integrals, 1971
_DISC_WEIGHTS = np.array([0.25] + 6 * [0.125])


def in_camera_0(pose: Pose, points_mm: np.ndarray) -> np.ndarray:
    """Target points in the frame of camera 0  # (n, 3) mm"""
    return points_mm @ pose.rotation.T + pose.translation_mm


def dot_shift(camera: PinholeCamera, pose: Pose, points_mm: np.ndarray, radius_mm: float) -> np.ndarray:
    """Centroid of the image of a round dot minus the image of its centre  # (n, 2) px

    Both differ under perspective and distortion: by quadrature over the dot with the local magnification as weight.
    """
    weights, moments = np.zeros(len(points_mm)), np.zeros((len(points_mm), 2))
    for place, weight in zip(_DISC, _DISC_WEIGHTS, strict=True):
        space = in_camera_0(pose, points_mm + np.array([*(radius_mm * place), 0.0]))
        local = weight * magnification(camera, pose, space)
        weights, moments = weights + local, moments + local[:, None] * camera.project(space)
    return moments / weights[:, None] - camera.project(in_camera_0(pose, points_mm))


def magnification(camera: PinholeCamera, pose: Pose, space_mm: np.ndarray) -> np.ndarray:
    """px² of the image per mm² of the target  # (n, 3) in the frame of camera 0 -> (n,)"""
    in_plane = camera.jacobian(space_mm) @ pose.rotation[:, :2]
    return np.abs(np.linalg.det(in_plane))


def moved(state: State, lens: Lens, step: np.ndarray, points_free: bool) -> State:
    """The state after a step: per camera its lens (and pose, but for camera 0), per view its pose, then the points."""
    step, cameras, poses = np.asarray(step, dtype=float), [], []
    at = 0
    for number, camera in enumerate(state.cameras):
        intrinsic = camera.values()
        moved_intrinsic = {name: intrinsic[name] + d for name, d in zip(lens.identified, step[at:], strict=False)}
        at += len(lens.identified)
        if lens.square:
            moved_intrinsic["fy"] = moved_intrinsic["fx"]
        rotation, translation = camera.rotation, camera.translation_mm
        if number:
            rotation = rotation_of(np.degrees(step[at : at + 3])) @ rotation
            translation = translation + step[at + 3 : at + 6]
            at += N_POSE
        cameras.append(PinholeCamera(**({n: intrinsic[n] for n in camera.intrinsics} | moved_intrinsic),
                                     rotation=rotation, translation_mm=translation))
    for pose in state.poses:
        poses.append(Pose(rotation_of(np.degrees(step[at : at + 3])) @ pose.rotation,
                          pose.translation_mm + step[at + 3 : at + 6]))
        at += N_POSE
    points = state.points_mm + step[at:].reshape(-1, 3) if points_free else state.points_mm
    return State(tuple(cameras), tuple(poses), points)


def n_unknowns(state: State, lens: Lens, points_free: bool) -> int:
    """Length of the step of `moved`."""
    n = len(state.cameras)
    return n * len(lens.identified) + N_POSE * (n - 1 + len(state.poses)) + (state.points_mm.size if points_free else 0)


def derivatives(state: State, lens: Lens, step: np.ndarray, points_free: bool, view: int, number: int,
                chosen: np.ndarray) -> np.ndarray:
    """d (column, row) of points seen by one camera in one view by the step  # -> (2 n, n_unknowns)

    ``state`` is the one after the step; ``chosen`` (n,) are the numbers of the target points.
    """
    camera, pose, first = state.cameras[number], state.poses[view], len(lens.identified)
    points = state.points_mm[chosen]
    space = in_camera_0(pose, points)
    all_columns, by_point = camera.parameter_jacobian(space), camera.jacobian(space)
    rows = np.zeros((len(chosen), 2, n_unknowns(state, lens, points_free)))
    at = number * first + N_POSE * max(number - 1, 0)
    for k, name in enumerate(lens.identified):
        rows[:, :, at + k] = all_columns[:, :, camera.parameters.index(name)]
        if name == "fx" and lens.square:
            rows[:, :, at + k] += all_columns[:, :, camera.parameters.index("fy")]
    if number:
        turn = left_jacobian(np.degrees(step[at + first : at + first + 3]))
        turned = space @ camera.rotation.T  # about the camera's own centre
        rows[:, :, at + first : at + first + 3] = _rotated(by_point @ camera.rotation.T, turned) @ turn
        rows[:, :, at + first + 3 : at + first + 6] = by_point @ camera.rotation.T
    at = len(state.cameras) * first + N_POSE * (len(state.cameras) - 1 + view)
    turn = left_jacobian(np.degrees(step[at : at + 3]))
    rows[:, :, at : at + 3] = _rotated(by_point, space - pose.translation_mm) @ turn
    rows[:, :, at + 3 : at + 6] = by_point
    if points_free:
        at = n_unknowns(state, lens, False)
        by_target = by_point @ pose.rotation
        for n, point in enumerate(chosen):
            rows[n, :, at + 3 * point : at + 3 * point + 3] = by_target[n]
    return rows.reshape(-1, rows.shape[2])


def _rotated(by_point, arm):
    """d pixel / d infinitesimal rotation of an arm  # (n, 2, 3), (n, 3) -> (n, 2, 3)"""
    return np.cross(arm[:, None, :], by_point)
