"""Where fields are read off: points, virtual extensometers, line cuts and circles, as declared in experiment.toml.

They do not affect the identification; a report of a finished RUN may use others than those of its start.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

KINDS = ("probe", "extensometer", "line", "circle")
_RINGS, _ROUND = 6, 24  # samples of a circle: rings of equal area, samples of each


@dataclass(frozen=True)
class Gauge:
    """One place of reading.

    kind : "probe" | "extensometer" | "line" | "circle"; points_mm : the point, the two ends, or the middle, in mesh
    coordinates; radius_mm : of a circle; samples : of a line
    """

    name: str
    kind: str
    points_mm: tuple[tuple[float, float], ...]
    radius_mm: float = 0.0
    samples: int = 0

    @property
    def places(self) -> np.ndarray:
        """The points at which fields are read: their mean counts for a circle  # (n, 2) mm"""
        ends = np.array(self.points_mm)
        if self.kind == "line":
            return ends[0] + np.linspace(0.0, 1.0, self.samples)[:, None] * (ends[1] - ends[0])
        if self.kind == "circle":
            radii = self.radius_mm * np.sqrt((np.arange(_RINGS) + 0.5) / _RINGS)
            angles = 2.0 * np.pi * np.arange(_ROUND) / _ROUND
            ring = np.stack([np.cos(angles), np.sin(angles)], axis=1)
            return ends[0] + (radii[:, None, None] * ring).reshape(-1, 2)
        return ends

    @property
    def length_mm(self) -> float:
        """Distance of the two ends; 0 of a point and a circle."""
        return float(np.hypot(*np.subtract(*self.points_mm))) if len(self.points_mm) == 2 else 0.0
