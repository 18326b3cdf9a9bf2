"""An ordinary lens: radial and tangential distortion of normalised coordinates by Brown.

    s = a² + b²
    a' = a (1 + k1 s + k2 s² + k3 s³) + 2 p1 a b + p2 (s + 2 a²)
    b' = b (1 + k1 s + k2 s² + k3 s³) + p1 (s + 2 b²) + 2 p2 a b

D. C. Brown, Close-range camera calibration, Photogrammetric Engineering 37 (1971) 855; the sequence k1, k2, p1, p2, k3
and the signs are those of OpenCV. Calibration files and `idic calibrate` give this model.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numba import njit

from idic.images.lens_camera import LensCamera, MAX_NEWTON_STEPS, NEWTON_STEP


@dataclass(frozen=True, eq=False)
class PinholeCamera(LensCamera):
    """Central projection with skew, Brown distortion and pose.

    Attributes
    ----------
    k1, k2, k3, p1, p2 : float
        Radial and tangential distortion of normalised coordinates.
    """

    coefficients: ClassVar = ("k1", "k2", "k3", "p1", "p2")
    example: ClassVar = {"k1": -0.12, "k2": 0.3, "k3": -0.2, "p1": 1.5e-3, "p2": -8e-4}
    is_calibrated: ClassVar = True

    k1: float = 0.0
    k2: float = 0.0
    k3: float = 0.0
    p1: float = 0.0
    p2: float = 0.0

    def distort(self, ideal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return _distort(np.ascontiguousarray(ideal), self.k1, self.k2, self.k3, self.p1, self.p2)

    def coefficient_slopes(self, ideal: np.ndarray) -> np.ndarray:
        return _coefficient_slopes(np.ascontiguousarray(ideal))

    def undistort(self, target: np.ndarray, allowed_px: np.ndarray) -> np.ndarray:
        """As that of every lens, compiled: it runs over all pixels."""
        return _undistort(target, allowed_px, self.fx, self.fy, self.k1, self.k2, self.k3, self.p1, self.p2)


@njit(cache=True, nogil=True)
def _at(a, b, k1, k2, k3, p1, p2):
    """Distorted position and its derivative (2 x 2, by rows) at the ideal position a, b."""
    s = a * a + b * b
    radial = 1.0 + s * (k1 + s * (k2 + s * k3))
    slope = 2.0 * (k1 + s * (2.0 * k2 + s * 3.0 * k3))  # d radial / d a = slope * a
    return (a * radial + 2.0 * p1 * a * b + p2 * (s + 2.0 * a * a),
            b * radial + p1 * (s + 2.0 * b * b) + 2.0 * p2 * a * b,
            radial + a * a * slope + 2.0 * p1 * b + 6.0 * p2 * a,
            a * b * slope + 2.0 * p1 * a + 2.0 * p2 * b,
            a * b * slope + 2.0 * p1 * a + 2.0 * p2 * b,
            radial + b * b * slope + 6.0 * p1 * b + 2.0 * p2 * a)


@njit(cache=True, nogil=True)
def _distort(ideal, k1, k2, k3, p1, p2):
    position, slope = np.empty(ideal.shape), np.empty((ideal.shape[0], 2, 2))
    for i in range(ideal.shape[0]):
        (position[i, 0], position[i, 1], slope[i, 0, 0], slope[i, 0, 1], slope[i, 1, 0],
         slope[i, 1, 1]) = _at(ideal[i, 0], ideal[i, 1], k1, k2, k3, p1, p2)
    return position, slope


@njit(cache=True, nogil=True)
def _coefficient_slopes(ideal):
    out = np.empty((ideal.shape[0], 2, 5))
    for i in range(ideal.shape[0]):
        a, b = ideal[i, 0], ideal[i, 1]
        s = a * a + b * b
        for k in range(3):
            out[i, 0, k], out[i, 1, k] = a * s ** (k + 1), b * s ** (k + 1)
        out[i, 0, 3], out[i, 1, 3] = 2.0 * a * b, s + 2.0 * b * b
        out[i, 0, 4], out[i, 1, 4] = s + 2.0 * a * a, 2.0 * a * b
    return out


@njit(cache=True, nogil=True)
def _undistort(target, allowed_px, fx, fy, k1, k2, k3, p1, p2):
    out = np.empty(target.shape)
    for i in range(target.shape[0]):
        at, bt = target[i, 0], target[i, 1]
        a, b, has_converged = at, bt, False
        for _ in range(MAX_NEWTON_STEPS):
            position, row, m00, m01, m10, m11 = _at(a, b, k1, k2, k3, p1, p2)
            ra, rb = position - at, row - bt
            determinant = m00 * m11 - m01 * m10
            if not (m00 > 0.0 and determinant > 0.0):  # beyond the fold of the polynomial
                break
            da, db = (m11 * ra - m01 * rb) / determinant, (m00 * rb - m10 * ra) / determinant
            a, b = a - da, b - db
            if abs(da) + abs(db) <= NEWTON_STEP * (1.0 + abs(a) + abs(b)):
                has_converged = True
                break
        if not has_converged:
            position, row, m00, m01, m10, m11 = _at(a, b, k1, k2, k3, p1, p2)
            has_converged = (abs(position - at) * fx + abs(row - bt) * fy < allowed_px[i]
                             and m00 > 0.0 and m00 * m11 - m01 * m10 > 0.0)
        out[i, 0], out[i, 1] = (a, b) if has_converged else (np.nan, np.nan)
    return out
