"""The start of the bundle adjustment: one camera after the other, then the pose of the second."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from idic.calibrate.bundle import Adjusted, START_TOLERANCE, adjust
from idic.calibrate.homography import focal_length, homography, mirrored, pose_of
from idic.calibrate.levenberg import minimum
from idic.calibrate.projection import N_POSE, in_camera_0, pose_slopes, turned
from idic.calibrate.records import Lens, Pose, State, Views
from idic.errors import InputError
from idic.images import PinholeCamera

MAX_POSE_SPREAD = 0.1       # of the second camera's pose between pairs, in rad and of the distance: else no one rig


def numbered(views: Views, spacing_mm: float) -> tuple[Views, np.ndarray]:
    """The views with numbers of target points as ``index`` (n, 1), and the points  # (n_points, 3) mm"""
    places = np.unique(np.vstack([view.index for row in views for view in row if view is not None]), axis=0)
    number = {tuple(place): n for n, place in enumerate(places.tolist())}
    rows = tuple(tuple(None if view is None
                       else replace(view, index=np.array([[number[tuple(p)]] for p in view.index.tolist()]))
                       for view in row) for row in views)
    return rows, np.column_stack([places * spacing_mm, np.zeros(len(places))])


def one_camera(views: Views, number: int, points_mm: np.ndarray, size: tuple[int, int], lens: Lens) -> dict[int, tuple]:
    """A camera by itself: per view number its (camera, pose in the frame of that camera).

    Raises
    ------
    InputError
        Where the views of this camera are too few.
    """
    chosen = [v for v, row in enumerate(views) if row[number] is not None]
    camera_views = tuple((views[v][number],) for v in chosen)
    centre = (np.array(size) - 1.0) / 2.0
    maps = [homography(points_mm[view.index[:, 0], :2], view.points_px) for (view,) in camera_views]
    focal = focal_length(maps, centre, size[0])
    camera = PinholeCamera(fx=focal, fy=focal, cx=centre[0], cy=centre[1])
    state = State((camera,), tuple(pose_of(h, focal, centre) for h in maps), points_mm)
    best = adjust(state, camera_views, Lens(("fx",)), rough=True)
    for _ in range(2):  # a long lens hardly tells a tilt from the opposite one: both are tried with the better lens
        best = adjust(_better_tilts(best, camera_views), camera_views, lens, rough=True)
    return {v: (best.state.cameras[0], pose) for v, pose in zip(chosen, best.state.poses, strict=True)}


def second_camera(first: dict[int, tuple], second: dict[int, tuple], views: Views, points_mm: np.ndarray
                  ) -> tuple[PinholeCamera, Views]:
    """Camera 1 relative to camera 0, and the views with the points of camera 1 counted as camera 0 counts them.

    A target without markers looks the same from two sides (from four where it is square): the numbering is the one in
    which all pairs agree about the rig.

    Raises
    ------
    InputError
        No image shows the target to both cameras, or the pairs do not agree.
    """
    pairs = sorted(set(first) & set(second))
    if not pairs:
        raise InputError("no pair in which both cameras see the target", expected="pairs that both show it",
                         found="none", remedy="record the target where both fields of view overlap")
    symmetric = not any(views[v][c].unique for v in pairs for c in (0, 1))
    turns = _symmetries(points_mm) if symmetric else [(np.arange(len(points_mm)), np.eye(3), np.zeros(3))]
    candidates = {}
    for v in pairs:
        a, b = first[v][1], second[v][1]
        for n, (_, turn, shift) in enumerate(turns):
            rotation = b.rotation @ turn @ a.rotation.T
            candidates[v, n] = rotation, b.rotation @ shift + b.translation_mm - rotation @ a.translation_mm
    scale = np.median([np.linalg.norm(first[v][1].translation_mm) for v in pairs])
    spread = {key: np.median([min(_pose_distance(pose, candidates[v, n], scale) for n in range(len(turns)))
                              for v in pairs])
              for key, pose in candidates.items()}
    best = min(spread, key=lambda key: (spread[key], key))
    if spread[best] > MAX_POSE_SPREAD:
        raise InputError("the pairs give different poses of the second camera", key="images",
                         found=f"its pose differs by {np.degrees(spread[best]):.1f}° from pair to pair",
                         expected="left and right images of the same instants",
                         remedy="check that the lists of both cameras have the same order, and that no camera moved")
    rotation, translation = candidates[best]
    renumbered = list(views)
    for v in pairs:
        n = min(range(len(turns)), key=lambda n: _pose_distance(candidates[best], candidates[v, n], scale))
        view = views[v][1]
        renumbered[v] = (views[v][0], replace(view, index=turns[n][0][view.index[:, 0]][:, None]))
    camera = next(iter(second.values()))[0].placed(rotation, translation)
    return camera, tuple(renumbered)


def _better_tilts(adjusted: Adjusted, views: Views) -> State:
    """Each view at the better of both tilts, with the lens as it is."""
    state, poses = adjusted.state, []
    for (view,), pose in zip(views, adjusted.state.poses, strict=True):
        points = state.points_mm[view.index[:, 0]]
        tries = [_posed(state.cameras[0], start, points, view.points_px)
                 for start in (pose, mirrored(pose, points.mean(axis=0)))]
        poses.append(min(tries, key=lambda posed: posed[1])[0])
    return replace(state, poses=tuple(poses))


def _posed(camera: PinholeCamera, start: Pose, points_mm: np.ndarray, seen_px: np.ndarray) -> tuple[Pose, float]:
    """The pose with the smallest sum of squared distances from the seen points, by a given lens, and that sum."""
    def distances(step: np.ndarray) -> np.ndarray:
        try:
            return (camera.project(in_camera_0(turned(start, step), points_mm)) - seen_px).ravel()
        except InputError:  # a trial step with a point behind the camera: it is cut
            return np.full(1, np.inf)

    def normal_equations(step: np.ndarray, errors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        slopes = pose_slopes(camera, turned(start, step), step, points_mm)
        return slopes.T @ slopes, slopes.T @ errors

    step = minimum(distances, normal_equations, N_POSE, START_TOLERANCE)
    return turned(start, step), float((distances(step)**2).sum())


def _symmetries(points_mm):
    """Rotations of the grid onto itself: new number of every point, and the rigid motion new place -> old place."""
    size, symmetries = points_mm.max(axis=0), []
    keys = {tuple(np.round(p, 6)): n for n, p in enumerate(points_mm)}
    for quarter in range(4):
        turn = Rotation.from_euler("z", 90 * quarter, degrees=True).as_matrix().round()
        turned = points_mm @ turn.T
        turned = turned - turned.min(axis=0)
        if not np.allclose(turned.max(axis=0), size):
            continue
        numbers = [keys.get(tuple(np.round(p, 6))) for p in turned]
        if None not in numbers:
            offset = turned[0] - turn @ points_mm[0]
            symmetries.append((np.array(numbers), turn.T, -turn.T @ offset))
    return symmetries


def _pose_distance(a, b, scale):
    """Distance of two poses: angle in rad and shift over a distance."""
    return Rotation.from_matrix(a[0] @ b[0].T).magnitude() + np.linalg.norm(a[1] - b[1]) / scale
