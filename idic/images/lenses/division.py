"""A wide-angle lens: radial distortion of normalised coordinates by division.

    a = a' / w,   b = b' / w,   w = 1 + l1 q + l2 q²,   q = a'² + b'²

A. W. Fitzgibbon, Simultaneous linear estimation of multiple view geometry and lens distortion, CVPR 2001, I-125,
doi:10.1109/CVPR.2001.990465, with l1; l2 is the next power. The inverse is explicit, the distortion itself is a root:
(a', b') = m (a, b), and with s = a² + b², q = s m², w' = l1 + 2 l2 q

    m = 1 + l1 s m² + l2 s² m⁴
    d (a', b') / d (a, b)   = w (I + 2 w' / (w - 2 q w') (a', b')ᵀ (a', b'))
    d (a', b') / d (l1, l2) = (a', b')ᵀ (q, q²) / (w - 2 q w')

It is the root that leads to m = 1 at the axis. It exists up to the fold w = 2 q w', where the ideal radius is largest;
where w = 0 comes first, this radius is infinite there, and every ideal position has its image.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from idic.images.lens_camera import LensCamera, MAX_NEWTON_STEPS, NEWTON_STEP


@dataclass(frozen=True, eq=False)
class DivisionCamera(LensCamera):
    """Central projection with skew, distortion by division and pose.

    Attributes
    ----------
    l1, l2 : float
        Radial distortion by the second and fourth power of the distorted normalised radius; l1 < 0: a barrel.
    """

    coefficients: ClassVar = ("l1", "l2")
    example: ClassVar = {"l1": -0.25, "l2": 0.08}
    leading: ClassVar = "l1"

    l1: float = 0.0
    l2: float = 0.0

    def distort(self, ideal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """As that of every lens; NaN beyond the largest ideal radius."""
        position, q = self._position(ideal)
        factor = 2.0 * (self.l1 + 2.0 * self.l2 * q) * self._stretch(q)
        slope = np.eye(2) + factor[:, None, None] * position[:, :, None] * position[:, None]
        return position, self._divisor(q)[:, None, None] * slope

    def coefficient_slopes(self, ideal: np.ndarray) -> np.ndarray:
        position, q = self._position(ideal)
        return position[:, :, None] * (self._stretch(q)[:, None] * np.column_stack([q, q * q]))[:, None]

    def undistort(self, target: np.ndarray, allowed_px: np.ndarray) -> np.ndarray:
        """As that of every lens, explicit: without Newton's method and what it may miss by."""
        q = (target * target).sum(axis=1)
        q[~(q < self._limits()[0])] = np.nan
        return target / self._divisor(q)[:, None]

    def _position(self, ideal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Distorted positions and their squared radii, by Newton's method between bounds  # (n, 2) -> (n, 2), (n,)"""
        largest_q, largest_radius = self._limits()
        s = (ideal * ideal).sum(axis=1)
        s[~(s < largest_radius**2)] = np.nan
        with np.errstate(divide="ignore"):
            low, high = np.zeros(len(s)), np.sqrt(largest_q / s)
        m = np.where(high > 1.0, 1.0, 0.5 * high)
        for _ in range(MAX_NEWTON_STEPS):
            q = s * m * m
            miss = m - self._divisor(q)
            low, high = np.where(miss < 0.0, m, low), np.where(miss > 0.0, m, high)
            tried = m - miss / (1.0 - 2.0 * s * m * (self.l1 + 2.0 * self.l2 * q))
            step = np.where((tried > low) & (tried < high), tried, 0.5 * (low + high)) - m
            step[miss == 0.0] = 0.0
            m = m + step
            if not (np.abs(step) > NEWTON_STEP * (1.0 + m)).any():
                break
        return m[:, None] * ideal, s * m * m

    def _divisor(self, q: np.ndarray) -> np.ndarray:
        return 1.0 + q * (self.l1 + q * self.l2)

    def _stretch(self, q: np.ndarray) -> np.ndarray:
        """1 / (w - 2 q w')"""
        return 1.0 / (1.0 - q * (self.l1 + 3.0 * q * self.l2))

    def _limits(self) -> tuple[float, float]:
        """Squared distorted radius up to which the distortion has an inverse, and the ideal radius there."""
        fold, pole = _first_root(-self.l1, -3.0 * self.l2), _first_root(self.l1, self.l2)
        if fold < pole:
            return fold, float(np.sqrt(fold) / self._divisor(np.array(fold)))
        return pole, np.inf


def _first_root(b: float, c: float) -> float:
    """The smallest positive root of 1 + b q + c q²; infinite where there is none."""
    squared = b * b - 4.0 * c
    inverse = 0.5 * (np.sqrt(squared) - b) if squared >= 0.0 else 0.0  # the largest root of z² + b z + c, z = 1 / q
    return 1.0 / inverse if inverse > 0.0 else np.inf
