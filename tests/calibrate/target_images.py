"""Images of flat targets by ray casting, with code of its own: no function of idic projects, undistorts or rotates
here."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

SUB = 2  # rays per pixel and direction; the coverage of an edge is linear within each


@dataclass(frozen=True)
class TrueCamera:
    """A lens (fx, fy, cx, cy, k1, k2) with its pose relative to camera 0."""

    fx: float
    fy: float
    cx: float
    cy: float
    k1: float
    k2: float
    rotation: np.ndarray
    shift: np.ndarray
    width: int = 480
    height: int = 400

    def rays(self):
        """Undistorted directions of sub-pixels, by fixed-point iteration  # (ny, nx, 3), in the camera's frame"""
        offset = (np.arange(SUB) + 0.5) / SUB - 0.5
        x = (np.arange(self.width)[:, None] + offset).ravel()
        y = (np.arange(self.height)[:, None] + offset).ravel()
        a, b = np.meshgrid((x - self.cx) / self.fx, (y - self.cy) / self.fy)
        u, v = a.copy(), b.copy()
        for _ in range(12):
            s = u * u + v * v
            factor = 1.0 + self.k1 * s + self.k2 * s * s
            u, v = a / factor, b / factor
        return np.stack([u, v, np.ones_like(u)], axis=-1)

    def sees(self, points):
        """(column, row) of points in the frame of camera 0."""
        x = points @ self.rotation.T + self.shift
        a, b = x[:, 0] / x[:, 2], x[:, 1] / x[:, 2]
        s = a * a + b * b
        factor = 1.0 + self.k1 * s + self.k2 * s * s
        return np.column_stack([self.fx * a * factor + self.cx, self.fy * b * factor + self.cy])


def poses(n, distance, generator, reach=6.0, tilt=30.0):
    """Rotations and shifts of a target whose middle is near the optical axis of camera 0."""
    found = []
    for k in range(n):
        turn = Rotation.from_euler("zyx", [generator.uniform(-25, 25), tilt * np.sin(2.4 * k), tilt * np.cos(1.7 * k)],
                                   degrees=True)
        found.append((turn.as_matrix(),
                      np.array([*generator.uniform(-reach, reach, 2), distance * generator.uniform(0.94, 1.06)])))
    return found


def render(camera, rays, pose, surface, noise, generator, light=0.0):
    """8-bit image; ``surface(x, y, size)`` is the reflectance in mm of the target, ``size`` the footprint of a ray in
    mm."""
    rotation, shift = camera.rotation @ pose[0], camera.rotation @ pose[1] + camera.shift
    normal = rotation[:, 2]
    depth = (normal @ shift) / (rays @ normal)
    space = (rays * depth[..., None] - shift) @ rotation
    size = np.abs(depth) / camera.fx / SUB
    grey = 40.0 + 170.0 * surface(space[..., 0], space[..., 1], size)
    ny, nx = camera.height, camera.width
    grey = grey.reshape(ny, SUB, nx, SUB).mean(axis=(1, 3))
    grey = grey * (1.0 + light * (np.arange(nx) / nx - 0.5))
    return np.clip(np.rint(grey + generator.normal(0.0, noise, grey.shape)), 0, 255).astype(np.uint8)


def dots(n, spacing, radius, markers=()):
    """Dark dots, columns x rows about the middle; markers are (i, j) of those with a hollow centre."""
    def surface(x, y, size):
        i = np.clip(np.rint(x / spacing + (n[0] - 1) / 2), 0, n[0] - 1)
        j = np.clip(np.rint(y / spacing + (n[1] - 1) / 2), 0, n[1] - 1)
        distance = np.hypot(x - (i - (n[0] - 1) / 2) * spacing, y - (j - (n[1] - 1) / 2) * spacing)
        dark = np.clip((radius - distance) / size + 0.5, 0, 1)
        for m in markers:
            hole = (i == m[0]) & (j == m[1])
            dark = np.where(hole, dark - np.clip((0.5 * radius - distance) / size + 0.5, 0, 1), dark)
        return 1.0 - dark
    return surface


def chessboard(n, spacing):
    """A board with n inner corners along x and y about the middle, on white paper."""
    def surface(x, y, size):
        u, v = x / spacing + (n[0] + 1) / 2, y / spacing + (n[1] + 1) / 2
        soft = [np.clip(_triangle(w) * spacing / size, -0.5, 0.5) for w in (u, v)]
        inside = (u > 0) & (u < n[0] + 1) & (v > 0) & (v < n[1] + 1)
        return np.where(inside, 0.5 + 2.0 * soft[0] * soft[1], 1.0)
    return surface


def _triangle(w):
    """Signed distance to the nearest integer border, positive on even squares."""
    near = np.rint(w)
    return (w - near) * np.where(near % 2 == 0, 1.0, -1.0)
