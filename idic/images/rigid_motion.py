"""Rigid displacements in mesh axes: of the whole mesh to its place, and of the specimen from frame to frame.

    W(X) = c + R(phi) (X - c) + s

with the rotation vector phi (deg), the translation s (mm) and a pivot c in the middle of the mesh. Of a motion, each of
the six numbers is a sum of unknown amplitudes times known courses, zero at the reference frame: an approach that
drifts with time or follows a column of the log, or a rigid motion of every frame.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from idic.images.lens_camera import POSE_PARAMETERS, left_jacobian, rotation_of

RIGID = POSE_PARAMETERS  # rotation_x, rotation_y, rotation_z (deg), t_x, t_y, t_z (mm)


@dataclass(frozen=True, eq=False)
class RigidMotion:
    """Amplitudes and their courses.

    names : degrees of freedom, without their stem; kinds : which of `units` each one changes; courses : (n,
    n_frames); values : (n,) deg or mm per unit of the course
    """

    units: ClassVar[dict[str, str]] = dict(zip(RIGID, ("deg",) * 3 + ("mm",) * 3, strict=True))  # of the numbers

    names: tuple[str, ...]
    kinds: tuple[str, ...]
    courses: np.ndarray
    values: np.ndarray

    def with_values(self, values: Mapping[str, float]) -> RigidMotion:
        """The same with these amplitudes, by name."""
        return replace(self, values=np.array([values.get(name, amplitude) for name, amplitude in
                                              zip(self.names, self.values, strict=True)], dtype=float))

    def extended(self, n: int) -> RigidMotion:
        """The same for `n` more frames, in which the specimen stays as it is in the last one."""
        return replace(self, courses=np.hstack([self.courses, np.repeat(self.courses[:, -1:], n, axis=1)]))

    def at(self, frame: int) -> np.ndarray:
        """The numbers of a frame  # (6,) deg, mm"""
        motion = np.zeros(len(self.units))
        for kind, course, value in zip(self.kinds, self.courses[:, frame], self.values, strict=True):
            motion[[*self.units].index(kind)] += course * value
        return motion

    def course(self, name: str, frame: int) -> tuple[int, float]:
        """Which of the numbers an amplitude changes in a frame, and by how much per unit."""
        i = self.names.index(name)
        return [*self.units].index(self.kinds[i]), float(self.courses[i, frame])


def displaced(points: np.ndarray, six: np.ndarray, pivot: np.ndarray) -> np.ndarray:
    """W of points  # (n, 3) mm -> (n, 3) mm"""
    return pivot + (points - pivot) @ rotation_of(six[:3]).T + six[3:]


def rigid_slope(points: np.ndarray, six: np.ndarray, pivot: np.ndarray, k: int) -> np.ndarray:
    """d W / d number k at points (before the displacement)  # (n, 3) mm -> (n, 3) mm per deg or mm"""
    if k >= 3:
        return np.broadcast_to(np.eye(3)[k - 3], points.shape)
    axis = np.radians(1.0) * left_jacobian(six[:3])[:, k]
    return np.cross(axis, (points - pivot) @ rotation_of(six[:3]).T)
