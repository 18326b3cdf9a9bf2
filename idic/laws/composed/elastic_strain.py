"""The elastic strain of a point in axes that turn with the material, and the stress that belongs to it.

With R and U of F = R U and the plastic state Cp^-1,

    g = U Cp^-1 U,   e = (g - g^-1) / 4,   g = 2 e + (1 + 4 e^2)^(1/2)

e agrees with the logarithmic strain up to third order (Bazant, J. Eng. Mater. Technol. 120 (1998) 131,
doi:10.1115/1.2807001) and has closed derivatives for equal stretches too. A stress t that is the derivative of an
energy of e gives, without approximation,

    M = (t + g^-1 t g^-1) / 4,   T = Cp^-1 U M + M U Cp^-1,   P = R (T + K)

with K the skew tensor that makes (T + K) U symmetric: the work of P is then the change of the energy, whatever the
symmetry of the material. Symmetric tensors are 6-tuples, full ones 9-tuples (``core/tensors.py``); real or complex.
"""

from __future__ import annotations

import math

import numpy as np

from idic.laws.core import symmetric, tensors
from idic.laws.core.inner import inner

MAX_ROOT_ITERATIONS = 40
ROOT_TOLERANCE = 1e-5  # change of the square root, quadratic: two more iterations end at rounding


@inner
def full(s):
    """A 6-tuple as a 9-tuple."""
    return s[0], s[3], s[4], s[3], s[1], s[5], s[4], s[5], s[2]


@inner
def inverse(s):
    """s^-1 of a symmetric tensor."""
    a = symmetric.adjugate(s)
    return tensors.scaled(1.0 / (s[0] * a[0] + s[3] * a[3] + s[4] * a[4]), a, 0.0)


@inner
def stretch(R, f):
    """U = R^T f of f = R U, its skew rounding dropped."""
    return symmetric.cauchy_green(R, f)


@inner
def strain_of(g):
    """e of g."""
    return tensors.combine(0.25, g, -0.25, inverse(g), 0.0)


@inner
def of_strain(e):
    """g of e; the square root by the iteration of Denman and Beavers, which keeps symmetric tensors symmetric."""
    y, z = tensors.scaled(4.0, tensors.squared(e), 1.0), tensors.scaled(0.0, e, 1.0)
    rounds_left = MAX_ROOT_ITERATIONS
    while rounds_left > 0:
        rounds_left -= 1
        y_new = tensors.combine(0.5, y, 0.5, inverse(z), 0.0)
        z = tensors.combine(0.5, z, 0.5, inverse(y), 0.0)
        change = (abs(y_new[0].real - y[0].real) + abs(y_new[1].real - y[1].real) + abs(y_new[2].real - y[2].real)
                  + abs(y_new[3].real - y[3].real) + abs(y_new[4].real - y[4].real) + abs(y_new[5].real - y[5].real))
        y = y_new
        if change < ROOT_TOLERANCE:
            rounds_left = min(rounds_left, 2)
    return tensors.combine(2.0, e, 1.0, y, 0.0)


@inner
def about_z(angle):
    """The rotation Q^T into axes at an angle (deg) about z: Q^T s Q has the components there."""
    c, s = np.cos(angle * (math.pi / 180.0)), np.sin(angle * (math.pi / 180.0))
    zero = 0.0 * c
    return c, s, zero, -s, c, zero, zero, zero, 1.0 + zero


@inner
def first_piola(R, U, inverse_cp, g, t):
    """P of the stress t, which stands in the axes of U."""
    back = full(inverse(g))
    M = tensors.combine(0.25, t, 0.25, tensors.congruence(back, t), 0.0)
    h = tensors.product(full(inverse_cp), symmetric.times(full(U), M))
    T = (2.0 * h[0], h[1] + h[3], h[2] + h[6], h[1] + h[3], 2.0 * h[4], h[5] + h[7],
         h[2] + h[6], h[5] + h[7], 2.0 * h[8])
    x = tensors.product(full(U), T)  # U T - T U = x - x^T is skew; so is K, and K U + U K = x - x^T
    b1, b2, b3 = x[7] - x[5], x[2] - x[6], x[3] - x[1]
    trace = U[0] + U[1] + U[2]
    a = inverse((trace - U[0], trace - U[1], trace - U[2], -U[3], -U[4], -U[5]))
    k1, k2, k3 = a[0] * b1 + a[3] * b2 + a[4] * b3, a[3] * b1 + a[1] * b2 + a[5] * b3, a[4] * b1 + a[5] * b2 + a[2] * b3
    return tensors.product(R, (T[0], T[1] - k3, T[2] + k2, T[3] + k3, T[4], T[5] - k1, T[6] - k2, T[7] + k1, T[8]))
