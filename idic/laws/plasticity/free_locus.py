"""A free convex yield surface: a sum of even powers of linear forms on knots, with weights that are identified.

In material axes, with coordinates of the deviator in which Mises's q is their length,

    x1 = 3/2 s11,  x2 = sqrt(3)/2 (s22 - s33),  x3 = sqrt(3) s12,  x4 = sqrt(3) s13,  x5 = sqrt(3) s23
    q^2 = q_in^2 + x4^2 + x5^2,   q_in^8 = sum_k u_k g_k [(n_k . x)^8 + (n'_k . x)^8] / (the same of x = e1)

the directions n_k are knots on three rings: latitudes (the share of shear) are Gauss points of degree 9, n knots lie
evenly over half a turn of (x1, x2) on each ring, and n' is n with the other sign of x3. Each power is convex, so q is
convex for all weights u_k >= 0; 8 is even, so tension and compression yield alike. All weights alike are Mises's
surface, exactly, from 5 knots on: Gauss points and even knots integrate every polynomial of that degree. The flow
stress is that of a strip along axis 1 (e1). Shear through the thickness, which no test of a sheet determines, is
Mises's. Derivation: docs/method.md, equations 12.9 and 12.10. Sums of even powers as yield functions: Gotoh, Int. J.
Mech. Sci. 19 (1977) 505, doi:10.1016/0020-7403(77)90043-1; Soare, Yoon & Cazacu, Int. J. Plast. 24 (2008) 915,
doi:10.1016/j.ijplas.2007.07.016.
"""

from __future__ import annotations

import math

import numpy as np

from idic.laws.core.inner import inner

FREE_LOCUS = 16  # code of the surface with n knots on a ring: FREE_LOCUS + n
RINGS, POWER = 3, 8
RING_KNOTS = (5, 9)  # on a ring: fewest, of which Mises's surface is made exactly, and most, all forms of degree 8
MEAN = 0.02  # std of the mean weight, 1: the surface knows ratios of weights, their common factor is a convention
ROOT3 = math.sqrt(3.0)
MOST_STEPS, STEP_TOLERANCE = 60, 1e-9  # of Newton, over the trial stress; quadratic
SMALLEST = 1e-280  # of q^8: below it nothing shears in the plane


def directions(n: int) -> np.ndarray:
    """Knots of a surface with n knots on a ring: n_k and the fixed weight g_k of each  # (3 n, 4)"""
    z, g = np.polynomial.legendre.leggauss(2 * RINGS - 1)
    z, g = z[RINGS - 1:], g[RINGS - 1:]
    g = np.where(np.arange(RINGS) == 0, 0.5, 1.0) * g  # n and n' are one there
    ring, k = np.repeat(np.arange(RINGS), n), np.tile(np.arange(n), RINGS)
    angle, across = np.pi * (k + 0.5 * (ring % 2)) / n, np.sqrt(1.0 - z[ring] ** 2)
    return np.column_stack([across * np.cos(angle), across * np.sin(angle), z[ring], g[ring]])


def neighbours(n: int) -> np.ndarray:
    """Differences of neighbouring weights, which have unit variance in the smoothness prior  # (5 n, 3 n)"""
    rows, identity = [], np.eye(RINGS * n)
    for ring in range(RINGS):
        for k in range(n):
            rows.append(identity[ring * n + (k + 1) % n] - identity[ring * n + k])
            if ring + 1 < RINGS:  # knots of the next ring lie half an interval on, or back
                adjacent = (ring + 1) * n + np.array([k, k - 1 if ring == 0 else (k + 1) % n]) % n
                rows.append(identity[(ring + 1) * n:(ring + 2) * n][adjacent - (ring + 1) * n].mean(axis=0)
                            - identity[ring * n + k])
    return np.array(rows)


def prior_rows(n: int, std: float) -> np.ndarray:
    """Combinations of the weights less 1 that are 0 ± 1: neighbours 0 ± std, their mean 0 ± `MEAN`  # (5 n + 1, 3 n)"""
    return np.vstack([neighbours(n) / std, np.full(RINGS * n, 1.0 / (RINGS * n * MEAN))])


_TABLE = np.zeros((RING_KNOTS[1] + 1, RINGS * RING_KNOTS[1], 4))
for _n in range(RING_KNOTS[0], RING_KNOTS[1] + 1):
    _TABLE[_n, :RINGS * _n] = directions(_n)


@inner
def coordinates(s):
    """(x1 ... x5) of a deviator."""
    return 1.5 * s[0], 0.5 * ROOT3 * (s[1] - s[2]), ROOT3 * s[3], ROOT3 * s[4], ROOT3 * s[5]


@inner
def deviator_of(x):
    """The deviator of coordinates."""
    s11, difference = x[0] / 1.5, x[1] / ROOT3
    return s11, difference - 0.5 * s11, -difference - 0.5 * s11, x[2] / ROOT3, x[3] / ROOT3, x[4] / ROOT3


@inner
def tension(n, first, params):
    """The sum of a strip in tension along axis 1."""
    total = 0.0 * params[first]
    for k in range(RINGS * n):
        power = _TABLE[n, k, 0] ** 2
        power = power * power
        total += 2.0 * params[first + k] * _TABLE[n, k, 3] * power * power
    return total


@inner
def in_plane(n, first, scale, x, params):
    """(gradient of q_in^2 / 2 (3), its second derivatives 11, 22, 33, 12, 13, 23) at x1, x2, x3."""
    zero = 0.0 * (x[0] + scale)
    S, v1, v2, v3 = zero, zero, zero, zero
    m1, m2, m3, m12, m13, m23 = zero, zero, zero, zero, zero, zero
    for k in range(RINGS * n):
        a, b, c = _TABLE[n, k, 0], _TABLE[n, k, 1], _TABLE[n, k, 2]
        mirrored = 2 if k >= n else 1  # n and n' are one in the plane of the first ring
        g = params[first + k] * (_TABLE[n, k, 3] * (3 - mirrored)) / scale
        for _ in range(mirrored):
            y = a * x[0] + b * x[1] + c * x[2]
            y2 = y * y
            w = g * y2 * y2 * y2
            wy = w * y
            S += wy * y
            v1 += wy * a
            v2 += wy * b
            v3 += wy * c
            m1 += w * a * a
            m2 += w * b * b
            m3 += w * c * c
            m12 += w * a * b
            m13 += w * a * c
            m23 += w * b * c
            c = -c
    if not S.real > SMALLEST:
        unit = 1.0 + zero
        return (x[0], x[1], x[2]), (unit, unit, unit, zero, zero, zero)
    f = S ** (-0.75)
    h = (POWER - 2.0) / S
    return (f * v1, f * v2, f * v3), (
        f * (7.0 * m1 - h * v1 * v1), f * (7.0 * m2 - h * v2 * v2), f * (7.0 * m3 - h * v3 * v3),
        f * (7.0 * m12 - h * v1 * v2), f * (7.0 * m13 - h * v1 * v3), f * (7.0 * m23 - h * v2 * v3))


@inner
def direction(n, first, s, params):
    """q dq/ds of a deviator."""
    x = coordinates(s)
    d, _ = in_plane(n, first, tension(n, first, params), x, params)
    return deviator_of((1.5 * d[0], 1.5 * d[1], 1.5 * d[2], 1.5 * x[3], 1.5 * x[4]))


@inner
def solved(c, H, r):
    """(1 + c H)^-1 r of three components."""
    a, b, e = 1.0 + c * H[0], 1.0 + c * H[1], 1.0 + c * H[2]
    p, q, t = c * H[3], c * H[4], c * H[5]
    A, B, C = b * e - t * t, q * t - p * e, p * t - b * q
    D, E, F = a * e - q * q, p * q - a * t, a * b - p * p
    below = 1.0 / (a * A + p * B + q * C)
    return ((A * r[0] + B * r[1] + C * r[2]) * below, (B * r[0] + D * r[1] + E * r[2]) * below,
            (C * r[0] + E * r[1] + F * r[2]) * below)


@inner
def newton_step(n, first, scale, c, x, y, params):
    """Step of y towards y + c (gradient of q_in^2 / 2) = x, and the residual's square."""
    d, H = in_plane(n, first, scale, y, params)
    r = (x[0] - y[0] - c * d[0], x[1] - y[1] - c * d[1], x[2] - y[2] - c * d[2])
    return solved(c, H, r), r[0] * r[0] + r[1] * r[1] + r[2] * r[2]


@inner
def returned(n, first, s, w, params, start):
    """s+ of s+ + w (q dq/ds)(s+) = s, all real, searched from `start`.

    The gradient of a strongly convex function: Newton with halved steps where the residual does not fall.
    """
    c, x, y = 1.5 * w, coordinates(s), coordinates(start)
    scale, y, size = tension(n, first, params), (y[0], y[1], y[2]), math.sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2])
    step, residual = newton_step(n, first, scale, c, x, y, params)
    for _ in range(MOST_STEPS):
        length = math.sqrt(step[0] * step[0] + step[1] * step[1] + step[2] * step[2])
        if not length > STEP_TOLERANCE * size:
            break
        part, y_new, next_step, residual_new = 1.0, y, step, residual
        for _ in range(8):
            y_new = (y[0] + part * step[0], y[1] + part * step[1], y[2] + part * step[2])
            next_step, residual_new = newton_step(n, first, scale, c, x, y_new, params)
            if residual_new < residual:
                break
            part *= 0.5
        y, step, residual = y_new, next_step, residual_new
    return deviator_of((y[0] + step[0], y[1] + step[1], y[2] + step[2], x[3] / (1.0 + c), x[4] / (1.0 + c)))


@inner
def returned_with_derivative(n, first, s, w, params, start):
    """As `returned`, complex, from the real s+ `start`: one more step."""
    c, x, y = 1.5 * w, coordinates(s), coordinates(start)
    y_start = (y[0] + 0.0 * x[0], y[1] + 0.0 * x[0], y[2] + 0.0 * x[0])
    last_step, _ = newton_step(n, first, tension(n, first, params), c, x, y_start, params)
    return deviator_of((y_start[0] + last_step[0], y_start[1] + last_step[1], y_start[2] + last_step[2],
                        x[3] / (1.0 + c), x[4] / (1.0 + c)))


@inner
def direction_and_change(n, first, s, w, dA, dw, params):
    """(q dq/ds at s, change of s where s + w q dq/ds changes by dA and w by dw)."""
    x, c = coordinates(s), 1.5 * w
    d, H = in_plane(n, first, tension(n, first, params), x, params)
    direction = deviator_of((1.5 * d[0], 1.5 * d[1], 1.5 * d[2], 1.5 * x[3], 1.5 * x[4]))
    r = coordinates((dA[0] - dw * direction[0], dA[1] - dw * direction[1], dA[2] - dw * direction[2],
                     dA[3] - dw * direction[3], dA[4] - dw * direction[4], dA[5] - dw * direction[5]))
    m = solved(c, H, r)
    return direction, deviator_of((m[0], m[1], m[2], r[3] / (1.0 + c), r[4] / (1.0 + c)))
