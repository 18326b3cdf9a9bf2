"""Closed-form start: a homography per view, one focal length of all of them, the pose of each.

Z. Zhang, A flexible new technique for camera calibration, IEEE TPAMI 22 (2000) 1330; here with the principal point in
the middle of the image, square pixels and no distortion.
"""

from __future__ import annotations

import numpy as np

from idic.calibrate.records import Pose

DEFAULT_FOCAL = 5.0  # image widths, where the views do not tell the focal length


def homography(plane: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """The projective map of plane points to pixels by least squares  # (n, 2), (n, 2) -> (3, 3)"""
    to_plane, to_pixels = _normaliser(plane), _normaliser(pixels)
    p = np.column_stack([plane, np.ones(len(plane))]) @ to_plane.T
    q = np.column_stack([pixels, np.ones(len(pixels))]) @ to_pixels.T
    zero = np.zeros_like(p)
    rows = np.vstack([np.hstack([p, zero, -q[:, :1] * p]), np.hstack([zero, p, -q[:, 1:2] * p])])
    solution = np.linalg.svd(rows, full_matrices=False)[2][-1].reshape(3, 3)
    matrix = np.linalg.inv(to_pixels) @ solution @ to_plane
    return matrix / np.linalg.norm(matrix)


def focal_length(homographies: list[np.ndarray], centre: np.ndarray, width: float) -> float:
    """Focal length in px that makes the columns of all rotations orthogonal and equally long, by least squares."""
    shift = np.array([[1.0, 0.0, -centre[0]], [0.0, 1.0, -centre[1]], [0.0, 0.0, 1.0]])
    rows, right = [], []
    for h in homographies:
        a, b = (shift @ h)[:, 0], (shift @ h)[:, 1]
        scale = np.hypot(np.linalg.norm(a[:2]), np.linalg.norm(b[:2]))
        a, b = a / scale, b / scale
        rows += [a[0] * b[0] + a[1] * b[1], a[0] ** 2 + a[1] ** 2 - b[0] ** 2 - b[1] ** 2]
        right += [-a[2] * b[2], b[2] ** 2 - a[2] ** 2]
    rows, right = np.array(rows), np.array(right)
    inverse_square = (rows @ right) / (rows @ rows) if (rows @ rows) > 0 else 0.0
    return float(1.0 / np.sqrt(inverse_square)) if inverse_square > 0 else DEFAULT_FOCAL * width


def pose_of(h: np.ndarray, focal: float, centre: np.ndarray) -> Pose:
    """The pose of the plane in front of a camera without distortion."""
    columns = np.linalg.inv(np.array([[focal, 0.0, centre[0]], [0.0, focal, centre[1]], [0.0, 0.0, 1.0]])) @ h
    columns = columns / np.sqrt(np.linalg.norm(columns[:, 0]) * np.linalg.norm(columns[:, 1]))
    columns = columns if columns[2, 2] > 0 else -columns
    u, _, vt = np.linalg.svd(np.column_stack([columns[:, 0], columns[:, 1], np.cross(columns[:, 0], columns[:, 1])]))
    return Pose(u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt, columns[:, 2])


def mirrored(pose: Pose, middle: np.ndarray) -> Pose:
    """The pose with the opposite tilt about the middle of the target; a long lens hardly separates the two."""
    centre = pose.rotation @ middle + pose.translation_mm
    sight = centre / np.linalg.norm(centre)
    normal = pose.rotation[:, 2]
    mirrored_normal = 2.0 * (normal @ sight) * sight - normal
    axis = np.cross(normal, mirrored_normal)
    sine = np.linalg.norm(axis)
    if sine < 1e-9:
        return pose
    k = axis / sine
    cross = np.array([[0, -k[2], k[1]], [k[2], 0, -k[0]], [-k[1], k[0], 0]])
    rotation = (np.eye(3) + sine * cross + (1 - normal @ mirrored_normal) * cross @ cross) @ pose.rotation
    return Pose(rotation, centre - rotation @ middle)


def _normaliser(points):
    mean, spread = points.mean(axis=0), max(float(points.std()), 1e-12)
    return np.array([[1 / spread, 0, -mean[0] / spread], [0, 1 / spread, -mean[1] / spread], [0, 0, 1.0]])
