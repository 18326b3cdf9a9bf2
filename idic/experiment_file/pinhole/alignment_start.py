"""Where the mesh is about, from the rough pixels of holes, edges and points: the start of a fit.

Points that span a plane give a pose. Of points on a line two cameras give two places in space; the tilt about the line
is left to those who look at the images.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from idic.errors import InputError
from idic.experiment_file.pinhole.alignment import MIN_SPREAD, Clicks, aligned
from idic.images import rotation_of

ROUGH_PX = 60.0                          # rms of the pixels of the file
TILTS_DEG = np.arange(-40.0, 41.0, 5.0)  # about a line of points
Rigid = tuple[np.ndarray, np.ndarray]    # rotation (3, 3) and translation (3,) mm


def starts(clicks: Sequence[Clicks], centre_mm: np.ndarray, outward: np.ndarray, measured: bool, file,
           key: str) -> list[Rigid]:
    """Poses from the mesh frame to that of the calibration; several where the pixels leave a choice.

    Parameters
    ----------
    centre_mm : array (3,)
        Mean of the centres of the cameras.
    outward : array (3,)
        Normal of the surface of the mesh, towards the cameras.
    measured : bool
        Whether the surface is measured: one camera at an unknown distance does not do then.

    Raises
    ------
    InputError
        One point, or points on a line that two cameras do not share.
    """
    points = np.concatenate([c.points_mm for c in clicks]) if clicks else np.zeros((0, 3))
    distinct = np.unique(np.round(points, 9), axis=0)
    if len(distinct) < 2:
        raise InputError("the alignment leaves the place of the mesh open", file=file, key=key,
                         expected="two holes, or one hole and an edge, or three points",
                         found="one hole" if len(distinct) else "nothing marked",
                         remedy="add a hole, an edge, or clicked points")
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    if len(spread) > 1 and spread[1] > MIN_SPREAD * spread[0]:
        pose = aligned(clicks, file, ROUGH_PX)[:2]
        return [pose, *(_mirrored(*pose, clicks[0]) if len(clicks) == 1 else ())]
    points, places = _two_places(clicks, measured, file, key)
    mesh_axis, rig_axis = points[1] - points[0], places[1] - places[0]
    poses = []
    for tilt in TILTS_DEG:
        turn = (rotation_of(tilt * rig_axis / np.linalg.norm(rig_axis))
                @ _frame(rig_axis, centre_mm - places.mean(axis=0)) @ _frame(mesh_axis, outward).T)
        poses.append((turn, places.mean(axis=0) - turn @ points.mean(axis=0)))
    return poses


def _two_places(clicks: Sequence[Clicks], measured: bool, file, key: str) -> tuple[np.ndarray, np.ndarray]:
    """Two points of the mesh far apart, and where they are in the frame of the calibration  # (2, 3), (2, 3) mm"""
    every = np.concatenate([c.points_mm for c in clicks])
    first = every[np.argmax(np.linalg.norm(every - every.mean(axis=0), axis=1))]
    points = np.array([first, every[np.argmax(np.linalg.norm(every - first, axis=1))]])
    rays = [[(c.camera.centre_mm, c.camera.rays(c.points_px[k:k + 1])[1][0]) for c in clicks
             for k in np.flatnonzero(np.linalg.norm(c.points_mm - point, axis=1) < 1e-9)] for point in points]
    if all(len(bundle) > 1 for bundle in rays):
        return points, np.array([_nearest_point(bundle) for bundle in rays])
    if len(clicks) > 1 or measured:
        raise InputError("points on a line that are not marked in two cameras", file=file, key=key,
                         expected="both holes in the alignment of two cameras, or a third point off their line",
                         found=f"{len(every)} points", remedy="add the holes to the alignment of the other camera, or "
                         "an edge, or a clicked point")
    (centre, ray), (_, second_ray) = rays[0][0], rays[1][0]  # at equal distances
    length = np.linalg.norm(points[1] - points[0]) / max(float(np.linalg.norm(ray - second_ray)), 1e-9)
    return points, centre + length * np.array([ray, second_ray])


def _frame(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Right-handed axes: along the first vector, towards the second  # (3, 3), in columns"""
    first_axis = first / np.linalg.norm(first)
    second_axis = second - (second @ first_axis) * first_axis
    second_axis /= np.linalg.norm(second_axis)
    return np.column_stack([first_axis, second_axis, np.cross(first_axis, second_axis)])


def _nearest_point(rays) -> np.ndarray:
    """The point with the least squared distances to rays (centre, unit direction)  # (3,) mm"""
    across = [np.eye(3) - np.outer(ray, ray) for _, ray in rays]
    return np.linalg.solve(sum(across), sum(a @ centre for a, (centre, _) in zip(across, rays, strict=True)))


def _mirrored(rotation: np.ndarray, shift: np.ndarray, clicks: Clicks) -> list[Rigid]:
    """The pose whose tilt has the other sign: of points in a plane it looks nearly the same."""
    middle = clicks.points_mm.mean(axis=0)
    place = rotation @ middle + shift
    sight = place - clicks.camera.centre_mm
    sight /= np.linalg.norm(sight)
    normal = rotation @ np.linalg.svd(clicks.points_mm - middle)[2][-1]
    normal *= np.sign(normal @ sight) or 1.0
    axis = np.cross(normal, sight)
    size = float(np.linalg.norm(axis))
    if size < 1e-6:
        return []
    turn = rotation_of(2.0 * np.degrees(np.arctan2(size, float(normal @ sight))) * axis / size) @ rotation
    return [(turn, place - turn @ middle)]
