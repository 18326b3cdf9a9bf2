"""Local coordinate systems of input decks: coordinates in them as coordinates in the axes of the mesh."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

RECTANGULAR, CYLINDRICAL, SPHERICAL = "R", "C", "S"
_MIN_SINE = 1e-9  # between two directions that span a plane


def rectangular(points: np.ndarray, kind: str) -> np.ndarray:
    """x, y, z of points of a kind of system  # (n, 3) -> (n, 3)

    Cylindrical: r, theta, z. Spherical: r, theta from the z axis, phi about it (Nastran). Angles in degrees.
    """
    a, b, c = np.asarray(points, dtype=float).T
    if kind == CYLINDRICAL:
        return np.column_stack([a * np.cos(np.radians(b)), a * np.sin(np.radians(b)), c])
    if kind == SPHERICAL:
        theta, phi = np.radians(b), np.radians(c)
        return np.column_stack([a * np.sin(theta) * np.cos(phi), a * np.sin(theta) * np.sin(phi), a * np.cos(theta)])
    return np.column_stack([a, b, c])


@dataclass(frozen=True)
class Frame:
    """A place and three axes: origin (3,), and axes (3, 3) with the directions x, y, z as rows."""

    origin: np.ndarray
    axes: np.ndarray

    def outside(self, points: np.ndarray) -> np.ndarray:
        """Points of this frame in the axes that it is given in  # (n, 3) -> (n, 3)"""
        return self.origin + np.asarray(points, dtype=float) @ self.axes


IDENTITY = Frame(np.zeros(3), np.eye(3))


def frame_of(origin, first: str, on_first, in_plane) -> Frame:
    """The frame with a point on its first axis and one in the plane of its two named axes.

    Parameters
    ----------
    origin, on_first, in_plane : (3,)
    first : "x", with the point in the x-y plane (Abaqus *SYSTEM), or "z", with the point in the z-x plane (Nastran)

    Raises
    ------
    ValueError
        The three points lie on a line.
    """
    origin, on_first, in_plane = (np.asarray(point, dtype=float) for point in (origin, on_first, in_plane))
    main, other_side = on_first - origin, in_plane - origin
    normal = np.cross(main, other_side)
    if not np.linalg.norm(normal) > _MIN_SINE * np.linalg.norm(main) * np.linalg.norm(other_side):
        raise ValueError("the three points of the system lie on a line")
    main, normal = main / np.linalg.norm(main), normal / np.linalg.norm(normal)
    if first == "x":
        return Frame(origin, np.array([main, np.cross(normal, main), normal]))
    return Frame(origin, np.array([np.cross(normal, main), normal, main]))  # z x (point in z-x) = y


def turned(points: np.ndarray, start, end, angle_deg: float) -> np.ndarray:
    """Points rotated about the line from `start` to `end`, by the right hand  # (n, 3) -> (n, 3)

    Raises
    ------
    ValueError
        The two points of the axis are the same.
    """
    start, axis = np.asarray(start, dtype=float), np.asarray(end, dtype=float) - np.asarray(start, dtype=float)
    length = float(np.linalg.norm(axis))
    if not length > 0.0:
        raise ValueError("the two points of the axis of rotation are the same")
    axis, angle, relative = axis / length, np.radians(angle_deg), points - start
    along = np.outer(relative @ axis, axis)
    return start + along + np.cos(angle) * (relative - along) + np.sin(angle) * np.cross(axis, relative)
