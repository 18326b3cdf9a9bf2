"""One point through a lens, compiled: perspective, Brown distortion, skewed sensor; with all derivatives, and back.

    (X, Y, Z) = R x + t,   a = X / Z,   b = Y / Z,   s = a² + b²
    a' = a (1 + k1 s + k2 s² + k3 s³) + 2 p1 a b + p2 (s + 2 a²)
    b' = b (1 + k1 s + k2 s² + k3 s³) + p1 (s + 2 b²) + 2 p2 a b
    column = fx a' + skew b' + cx,   row = fy b' + cy

D. C. Brown, Close-range camera calibration, Photogrammetric Engineering 37 (1971) 855; the sequence k1, k2, p1, p2, k3
and the signs are those of OpenCV. Intrinsic values are packed as fx, fy, skew, cx, cy, k1, k2, k3, p1, p2.
"""

from __future__ import annotations

import numpy as np
from numba import njit

N_INTRINSIC = 10
_NEWTON_STEPS = 50


@njit(cache=True, nogil=True)
def distort(a, b, q):
    """Distorted normalised position and its derivative (2 x 2, by rows) at the ideal position a, b."""
    k1, k2, k3, p1, p2 = q[5], q[6], q[7], q[8], q[9]
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
def project(points, q, rotation, translation):
    """(column, row) of points; NaN where a point is not in front of the camera  # (n, 3) mm -> (n, 2) px"""
    out = np.empty((points.shape[0], 2))
    for i in range(points.shape[0]):
        x, y, z = _in_camera(points, i, rotation, translation)
        if z > 0.0:
            a, b, _, _, _, _ = distort(x / z, y / z, q)
            out[i, 0] = q[0] * a + q[2] * b + q[3]
            out[i, 1] = q[1] * b + q[4]
        else:
            out[i] = np.nan
    return out


@njit(cache=True, nogil=True)
def point_jacobian(points, q, rotation, translation):
    """d (column, row) / d point; NaN behind the camera  # (n, 3) mm -> (n, 2, 3) px/mm"""
    out = np.empty((points.shape[0], 2, 3))
    for i in range(points.shape[0]):
        x, y, z = _in_camera(points, i, rotation, translation)
        if z > 0.0:
            c = _camera_jacobian(x, y, z, q)  # by the point in the camera's frame
            for j in range(3):
                for d in range(2):
                    out[i, d, j] = (c[d, 0] * rotation[0, j] + c[d, 1] * rotation[1, j] + c[d, 2] * rotation[2, j])
        else:
            out[i] = np.nan
    return out


@njit(cache=True, nogil=True)
def parameter_jacobian(points, q, rotation, translation, turn):
    """d (column, row) by the ten intrinsic values, rotation vector (rad) and translation  # -> (n, 2, 16)

    ``turn`` (3, 3) maps a change of the rotation vector to the infinitesimal rotation in the camera's frame
    (left Jacobian of the exponential map).
    """
    out = np.zeros((points.shape[0], 2, 16))
    for i in range(points.shape[0]):
        x, y, z = _in_camera(points, i, rotation, translation)
        if not z > 0.0:
            out[i] = np.nan
            continue
        a, b = x / z, y / z
        s = a * a + b * b
        ad, bd, _, _, _, _ = distort(a, b, q)
        out[i, 0, 0], out[i, 1, 1], out[i, 0, 2] = ad, bd, bd
        out[i, 0, 3], out[i, 1, 4] = 1.0, 1.0
        for k in range(5):
            if k < 3:
                da, db = a * s ** (k + 1), b * s ** (k + 1)
            elif k == 3:
                da, db = 2.0 * a * b, s + 2.0 * b * b
            else:
                da, db = s + 2.0 * a * a, 2.0 * a * b
            out[i, 0, 5 + k] = q[0] * da + q[2] * db
            out[i, 1, 5 + k] = q[1] * db
        c = _camera_jacobian(x, y, z, q)
        xr, yr, zr = x - translation[0], y - translation[1], z - translation[2]
        for k in range(3):
            wx, wy, wz = turn[0, k], turn[1, k], turn[2, k]
            vx, vy, vz = wy * zr - wz * yr, wz * xr - wx * zr, wx * yr - wy * xr
            for d in range(2):
                out[i, d, 10 + k] = c[d, 0] * vx + c[d, 1] * vy + c[d, 2] * vz
                out[i, d, 13 + k] = c[d, k]
    return out


@njit(cache=True, nogil=True)
def undistort(pixels, q):
    """Ideal normalised positions of pixels by Newton's method; NaN where the distortion has no inverse  # (n, 2)"""
    out = np.empty((pixels.shape[0], 2))
    for i in range(pixels.shape[0]):
        bt = (pixels[i, 1] - q[4]) / q[1]
        at = (pixels[i, 0] - q[3] - q[2] * bt) / q[0]
        a, b = at, bt
        converged = False
        for _ in range(_NEWTON_STEPS):
            ad, bd, m00, m01, m10, m11 = distort(a, b, q)
            ra, rb = ad - at, bd - bt
            determinant = m00 * m11 - m01 * m10
            if not (m00 > 0.0 and determinant > 0.0):  # beyond the fold of the polynomial
                break
            da, db = (m11 * ra - m01 * rb) / determinant, (m00 * rb - m10 * ra) / determinant
            a, b = a - da, b - db
            if abs(da) + abs(db) <= 1e-15 * (1.0 + abs(a) + abs(b)):
                converged = True
                break
        if not converged:  # Newton may circle in the last bit: what counts is the position on the sensor
            ad, bd, m00, m01, m10, m11 = distort(a, b, q)
            converged = (abs(ad - at) * q[0] + abs(bd - bt) * q[1] < 1e-11
                         * (1.0 + abs(pixels[i, 0]) + abs(pixels[i, 1]))
                         and m00 > 0.0 and m00 * m11 - m01 * m10 > 0.0)
        out[i, 0] = a if converged else np.nan
        out[i, 1] = b if converged else np.nan
    return out


@njit(cache=True, nogil=True, inline="always")
def _in_camera(points, i, r, t):
    x, y, z = points[i, 0], points[i, 1], points[i, 2]
    return (r[0, 0] * x + r[0, 1] * y + r[0, 2] * z + t[0], r[1, 0] * x + r[1, 1] * y + r[1, 2] * z + t[1],
            r[2, 0] * x + r[2, 1] * y + r[2, 2] * z + t[2])


@njit(cache=True, nogil=True)
def _camera_jacobian(x, y, z, q):
    """d (column, row) by the point in the camera's frame  # (2, 3) px/mm"""
    a, b = x / z, y / z
    _, _, m00, m01, m10, m11 = distort(a, b, q)
    c = np.empty((2, 3))
    c[0, 0] = (q[0] * m00 + q[2] * m10) / z
    c[0, 1] = (q[0] * m01 + q[2] * m11) / z
    c[1, 0], c[1, 1] = q[1] * m10 / z, q[1] * m11 / z
    c[0, 2] = -(c[0, 0] * a + c[0, 1] * b)
    c[1, 2] = -(c[1, 0] * a + c[1, 1] * b)
    return c
