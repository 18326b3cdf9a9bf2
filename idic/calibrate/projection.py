"""Projected points of a view with their derivatives by everything that the bundle adjustment identifies.

    x_pixel = camera_c( R_v X + t_v )

with the pose (R_v, t_v) of the target in the frame of camera 0, and camera c with its own pose relative to that frame.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from idic.calibrate.records import Lens, Pose, State
from idic.calibrate.shape import Target
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


def moved(state: State, lens: Lens, step: np.ndarray, target: Target) -> State:
    """The state after a step: per camera its lens (and pose, but for camera 0), per view its pose, then the target."""
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
        poses.append(turned(pose, step[at : at + N_POSE]))
        at += N_POSE
    if not target.n_unknowns:
        return State(tuple(cameras), tuple(poses), state.points_mm, state.shape_mm)
    return State(tuple(cameras), tuple(poses), state.points_mm + target.displacement_mm(step[at:]),
                 state.shape_mm + step[at:])


def turned(pose: Pose, step: np.ndarray) -> Pose:
    """The pose after a rotation vector in rad and a shift in mm  # (6,)"""
    return Pose(rotation_of(np.degrees(step[:3])) @ pose.rotation, pose.translation_mm + step[3:6])


def n_cameras_unknowns(n_cameras: int, lens: Lens) -> int:
    """Unknowns of all cameras: their lenses, and their poses but for that of camera 0."""
    return n_cameras * len(lens.identified) + N_POSE * (n_cameras - 1)


def n_unknowns(state: State, lens: Lens, target: Target) -> int:
    """Length of the step of `moved`."""
    return n_cameras_unknowns(len(state.cameras), lens) + N_POSE * len(state.poses) + target.n_unknowns


@dataclass(frozen=True, eq=False)
class Derivatives:
    """d (column, row) of n points that one camera sees in all its views.

    Attributes
    ----------
    columns : int array (k,)
        The unknowns that move all these points: the camera's, and the modes of the target.
    common : array (n, 2, k)
        By these unknowns.
    pose : array (n, 2, 6)
        By the pose of the view of each point.
    by_point : array (n, 2, 3)
        By the place of the point in the target's frame.
    """

    columns: np.ndarray
    common: np.ndarray
    pose: np.ndarray
    by_point: np.ndarray


def derivatives(state: State, lens: Lens, step: np.ndarray, target: Target, number: int, views: np.ndarray,
                chosen: np.ndarray) -> Derivatives:
    """Derivatives of points seen by one camera by the step.

    ``state`` is the one after the step; ``views`` (n,) are the views of the points, ``chosen`` (n,) the numbers of
    the target points.
    """
    camera, first, n_cameras = state.cameras[number], len(lens.identified), len(state.cameras)
    rotations = np.array([pose.rotation for pose in state.poses])[views]
    arm = (rotations @ state.points_mm[chosen][:, :, None])[:, :, 0]
    space = arm + np.array([pose.translation_mm for pose in state.poses])[views]
    every = camera.parameter_jacobian(space)
    by_shift = every[:, :, -3:]  # of the camera
    by_space = by_shift @ camera.rotation
    by_point = by_space @ rotations
    at = n_cameras_unknowns(number, lens) + (0 if number else N_POSE)
    columns, blocks = [np.arange(at, at + first)], [_by_lens(every, camera, lens)]
    if number:
        turn = left_jacobian(np.degrees(step[at + first : at + first + 3]))
        columns.append(np.arange(at + first, at + first + N_POSE))
        blocks += [_rotated(by_shift, space @ camera.rotation.T) @ turn, by_shift]  # about the camera's own centre
    if target.n_modes:
        at = n_cameras_unknowns(n_cameras, lens) + N_POSE * len(state.poses)
        columns.append(np.arange(at, at + target.n_modes))
        blocks.append(by_point @ target.modes[chosen])
    at = n_cameras_unknowns(n_cameras, lens)
    turns = np.array([left_jacobian(np.degrees(step[at + N_POSE * v : at + N_POSE * v + 3]))
                      for v in range(len(state.poses))])
    pose = np.concatenate([_rotated(by_space, arm) @ turns[views], by_space], axis=2)
    return Derivatives(np.concatenate(columns), np.concatenate(blocks, axis=2), pose, by_point)


def pose_slopes(camera: PinholeCamera, pose: Pose, step: np.ndarray, points_mm: np.ndarray) -> np.ndarray:
    """d (column, row) by the step of `turned` that led to this pose  # (6,), (n, 3) mm -> (2 n, 6)"""
    space = in_camera_0(pose, points_mm)
    by_space = camera.jacobian(space)
    by_turn = _rotated(by_space, space - pose.translation_mm) @ left_jacobian(np.degrees(step[:3]))
    return np.concatenate([by_turn, by_space], axis=2).reshape(-1, N_POSE)


def _by_lens(every: np.ndarray, camera: PinholeCamera, lens: Lens) -> np.ndarray:
    """Derivatives by the identified intrinsic values, of those by all parameters  # (n, 2, n_identified)"""
    by_lens = every[:, :, [camera.parameters.index(name) for name in lens.identified]]
    if lens.square:
        by_lens[:, :, lens.identified.index("fx")] += every[:, :, camera.parameters.index("fy")]
    return by_lens


def _rotated(by_point: np.ndarray, arm: np.ndarray) -> np.ndarray:
    """d pixel / d infinitesimal rotation of an arm: arm x by_point  # (n, 2, 3), (n, 3) -> (n, 2, 3)"""
    (x, y, z), (px, py, pz) = arm.T[:, :, None], np.moveaxis(by_point, 2, 0)
    return np.stack([y * pz - z * py, z * px - x * pz, x * py - y * px], axis=2)
