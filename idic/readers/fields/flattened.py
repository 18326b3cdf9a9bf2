"""Motion of the middle surface of a sheet, flattened, for the comparison with a plane model.

Points of three coordinates show how a sheet leaves its plane. A tilt of the whole sheet shortens it as seen from the
front, bending stretches the seen side, and an arc is longer than its chord; a plane model has none of the three. The
rise w of the surface over its plane is fitted by a polynomial of the second degree with the slope m + K x; h is half of
the thickness:

    u = R (x3 + u3) - x3                  removes the tilt; R: the smallest rotation that levels the sheet
      + h (m + K x)                       from the measured side to the middle (Kirchhoff 1850)
      + a(K0 + K, x) - a(K0, x)           from the chord to the arc, K0 of the reference stage

    a(K, x) = sum_i (k_i^2 xi_i^3 / 6) e_i,       k_i, e_i principal curvatures and their directions, xi_i = x . e_i

An uneven change of thickness makes a rise alpha p that is no bending and does not count in K: p = h (1 / det F - 1) is
the largest possible one. Its share 0 <= alpha <= 1 follows from the rests of p and w after a fit by polynomials of the
third degree:

    alpha = (p . w / s^2 + alpha_0 / s_0^2) / (p . p / s^2 + 1 / s_0^2)

with s the rms of the rest of w. Where the rise does not show it, the share is alpha_0 = 0.5 with a standard deviation
of s_0 = 0.25 (metals: 0.4 to 1).

docs/method.md, equation 15.9. The arc is exact to the second order where one curvature is zero: a sheet that can be
laid flat.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from idic.readers.fields.plane import BENDING_DEGREE, area_ratio, neighbours, powers

MIN_KNOWN = 12  # points that show the rise
SHARE_MEAN, SHARE_STD = 0.5, 0.25  # of the largest possible change of thickness, where the rise does not show it


@dataclass(frozen=True, eq=False)
class Flattening:
    """Corrects the stages of one test.

    positions : (n, 3) mm, points of the reference stage from their middle: along their plane, and height above it;
    curvature : (2, 2) 1/mm, of that stage; half_mm : half of the thickness, 0 where it is not known
    """

    positions: np.ndarray
    curvature: np.ndarray
    half_mm: float

    @classmethod
    def of(cls, positions: np.ndarray, heights: np.ndarray, thickness_mm: float | None) -> Flattening:
        """From the reference stage: positions (n, 2) mm along its plane, heights (n,) mm above it."""
        at = np.column_stack([positions - positions.mean(axis=0), heights])
        return cls(at, _rise(at[:, :2], heights)[1], 0.5 * (thickness_mm or 0.0))

    def __call__(self, moved: np.ndarray) -> np.ndarray:
        """Displacement of the flattened middle surface, and over it; as measured where fewer than `MIN_KNOWN` points
        are known.

        moved : (n, 3) mm, NaN where not measured; returns (n, 3) mm
        """
        measured = np.isfinite(moved).all(axis=1)
        if measured.sum() < MIN_KNOWN:
            return moved
        places, x = self.positions + moved, self.positions[:, :2]
        level = np.column_stack([places[measured, :2], np.ones(measured.sum())])
        tilt = np.linalg.lstsq(level, places[measured, 2], rcond=None)[0][:2]
        turned = places @ _upright(tilt).T - self.positions
        slope, K = _rise(x[measured], (turned[:, 2] - self.thinning(turned))[measured])
        turned[:, :2] += self.half_mm * (slope + x @ K) + _arc(self.curvature + K, x) - _arc(self.curvature, x)
        return turned

    @cached_property
    def _neighbours(self) -> np.ndarray:
        return neighbours(self.positions[:, :2])

    def thinning(self, moved: np.ndarray) -> np.ndarray:
        """The part of the rise that is a change of thickness  # (n, 3) mm, level -> (n,) mm"""
        if not self.half_mm:
            return np.zeros(len(moved))
        x = self.positions[:, :2] / np.abs(self.positions[:, :2]).max()
        largest = self.half_mm * (1.0 / area_ratio(self.positions[:, :2], moved[:, :2], self._neighbours) - 1.0)
        measured = np.isfinite(largest) & np.isfinite(moved[:, 2])
        bent = np.column_stack([x[:, 0] ** i * x[:, 1] ** j for i, j in powers(BENDING_DEGREE)])[measured]
        if len(bent) < 2 * bent.shape[1]:
            return np.zeros(len(moved))
        fields = np.column_stack([largest, moved[:, 2]])[measured]
        p, w = (fields - bent @ np.linalg.lstsq(bent, fields, rcond=None)[0]).T
        precision = 1.0 / max(float(w @ w) / len(w), 1e-300)
        share = ((precision * float(p @ w) + SHARE_MEAN / SHARE_STD**2)
                 / (precision * float(p @ p) + 1.0 / SHARE_STD**2))
        return float(np.clip(share, 0.0, 1.0)) * np.where(np.isfinite(largest), largest, np.nanmean(largest))


def _upright(tilt: np.ndarray) -> np.ndarray:
    """The smallest rotation that levels a plane of this slope  # (2,) -> (3, 3)"""
    normal = np.array([-tilt[0], -tilt[1], 1.0]) / np.sqrt(1.0 + tilt @ tilt)
    skew = np.array([[0.0, 0.0, -normal[0]], [0.0, 0.0, -normal[1]], [normal[0], normal[1], 0.0]])
    return np.eye(3) + skew + skew @ skew / (1.0 + normal[2])  # Rodrigues


def _rise(x: np.ndarray, rise: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Slope in the middle and matrix of curvatures of the best polynomial of the second degree  # (2,), (2, 2) 1/mm"""
    size = float(np.abs(x).max())
    a, b = (x / size).T
    c = np.linalg.lstsq(np.column_stack([np.ones_like(a), a, b, 0.5 * a * a, a * b, 0.5 * b * b]), rise, rcond=None)[0]
    return c[1:3] / size, np.array([[c[3], c[4]], [c[4], c[5]]]) / size**2


def _arc(curvature: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Length along the surface minus chord, from the middle to every point  # (n, 2) mm"""
    values, axes = np.linalg.eigh(curvature)
    return (values**2 * (x @ axes) ** 3 / 6.0) @ axes.T
