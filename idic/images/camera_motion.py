"""A camera that moves or comes nearer during the test: in frame t, before distortion,

    p0(t) = centre + (1 + m(t)) R(phi(t)) (p0 - centre) + s(t)

m, phi and s are sums of unknown amplitudes times known courses, zero at the reference frame: magnification that drifts
with time or follows a column of the log (a specimen that moves out of its plane), or a rigid motion of every frame. So
are the shapes of a sheet that bends out of its plane (`deflection`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from idic.images.deflection import SHAPES, Deflection, Shape, Sheet


@dataclass(frozen=True, eq=False)
class CameraMotion:
    """Amplitudes and their courses.

    names : degrees of freedom, after the name of the camera; kinds : of each "magnification" (relative), "turn" (deg,
    counter-clockwise as seen), "column" or "row" (px), or of `shapes` (relative); courses : (n, n_frames); values :
    (n,); ends : (2, 2) mm, lowest and highest x and y of the sheet, between which the shapes lie, None where no sheet
    may bend; lever : mm^2, distance of the camera times half the thickness
    """

    shapes: ClassVar[dict[str, Shape]] = SHAPES
    units: ClassVar[dict[str, str]] = {"magnification": "", "turn": "deg", "column": "px", "row": "px",
                                       **dict.fromkeys(SHAPES, "")}

    names: tuple[str, ...]
    kinds: tuple[str, ...]
    courses: np.ndarray
    values: np.ndarray
    ends: np.ndarray | None = None
    lever: float = 0.0

    def with_values(self, values: Mapping[str, float]) -> CameraMotion:
        """The same with these amplitudes, by name."""
        return replace(self, values=np.array([values.get(name, amplitude) for name, amplitude in
                                              zip(self.names, self.values, strict=True)], dtype=float))

    def extended(self, n: int) -> CameraMotion:
        """The same for `n` more frames, in which the camera stays as it is in the last one."""
        return replace(self, courses=np.hstack([self.courses, np.repeat(self.courses[:, -1:], n, axis=1)]))

    def at(self, frame: int) -> tuple[np.ndarray, np.ndarray]:
        """Linear map and shift of a frame  # (2, 2), (2,) px"""
        motion = self._amplitudes(frame)
        c, s = np.cos(np.radians(motion["turn"])), np.sin(np.radians(motion["turn"]))
        return ((1.0 + motion["magnification"]) * np.array([[c, s], [-s, c]]),
                np.array([motion["column"], motion["row"]]))

    def deflection(self, frame: int) -> Deflection | None:
        """The bent sheet of a frame; None where no shape is unknown."""
        if self.ends is None or not set(self.kinds) & set(SHAPES):
            return None
        motion, (low, high) = self._amplitudes(frame), self.ends
        sheet = Sheet(0.5 * (low + high), 0.5 * (high - low), self.lever)
        return Deflection(sheet, {kind: motion[kind] for kind in dict.fromkeys(self.kinds) if kind in SHAPES})

    def _amplitudes(self, frame: int) -> dict[str, float]:
        motion = dict.fromkeys(self.units, 0.0)
        for kind, course, value in zip(self.kinds, self.courses[:, frame], self.values, strict=True):
            motion[kind] += float(course * value)
        return motion

    def shape(self, name: str, frame: int) -> tuple[str, float] | None:
        """Shape of an amplitude and its course in a frame; None of another motion."""
        i = self.names.index(name)
        return (self.kinds[i], float(self.courses[i, frame])) if self.kinds[i] in SHAPES else None

    def slope(self, name: str, frame: int, centred: np.ndarray, linear: np.ndarray) -> np.ndarray:
        """Derivative of p0(t) by an amplitude that is not of a shape  # (n, 2) px

        centred : (n, 2) ``(1 + m) R (p0 - centre)``; linear : the map of the frame
        """
        i = self.names.index(name)
        course, kind = self.courses[i, frame], self.kinds[i]
        if course == 0.0:
            return np.zeros_like(centred)
        if kind == "magnification":
            return course / np.sqrt(np.linalg.det(linear)) * centred
        if kind == "turn":
            return course * np.radians(1.0) * centred @ np.array([[0.0, -1.0], [1.0, 0.0]])
        return np.broadcast_to(course * np.eye(2)[0 if kind == "column" else 1], centred.shape)
