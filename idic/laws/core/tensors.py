"""3 x 3 algebra on tuples, which numba keeps in registers; real or complex.

A matrix is a 9-tuple by rows; a symmetric one a 6-tuple (11, 22, 33, 12, 13, 23).
"""

from __future__ import annotations

from idic.laws.core.inner import inner


@inner
def load(F):
    """9-tuple of a (3, 3) array."""
    return F[0, 0], F[0, 1], F[0, 2], F[1, 0], F[1, 1], F[1, 2], F[2, 0], F[2, 1], F[2, 2]


@inner
def store(a, out):
    """A 9-tuple into a (3, 3) array."""
    out[0, 0], out[0, 1], out[0, 2] = a[0], a[1], a[2]
    out[1, 0], out[1, 1], out[1, 2] = a[3], a[4], a[5]
    out[2, 0], out[2, 1], out[2, 2] = a[6], a[7], a[8]


@inner
def inverse(f):
    """(det f, f^-1)."""
    a, b, c = f[4] * f[8] - f[5] * f[7], f[5] * f[6] - f[3] * f[8], f[3] * f[7] - f[4] * f[6]
    J = f[0] * a + f[1] * b + f[2] * c
    r = 1.0 / J
    return J, (a * r, (f[2] * f[7] - f[1] * f[8]) * r, (f[1] * f[5] - f[2] * f[4]) * r,
               b * r, (f[0] * f[8] - f[2] * f[6]) * r, (f[2] * f[3] - f[0] * f[5]) * r,
               c * r, (f[1] * f[6] - f[0] * f[7]) * r, (f[0] * f[4] - f[1] * f[3]) * r)


@inner
def product(a, b):
    """a b."""
    return (a[0] * b[0] + a[1] * b[3] + a[2] * b[6], a[0] * b[1] + a[1] * b[4] + a[2] * b[7],
            a[0] * b[2] + a[1] * b[5] + a[2] * b[8],
            a[3] * b[0] + a[4] * b[3] + a[5] * b[6], a[3] * b[1] + a[4] * b[4] + a[5] * b[7],
            a[3] * b[2] + a[4] * b[5] + a[5] * b[8],
            a[6] * b[0] + a[7] * b[3] + a[8] * b[6], a[6] * b[1] + a[7] * b[4] + a[8] * b[7],
            a[6] * b[2] + a[7] * b[5] + a[8] * b[8])


@inner
def product_transposed(a, b):
    """a b^T."""
    return (a[0] * b[0] + a[1] * b[1] + a[2] * b[2], a[0] * b[3] + a[1] * b[4] + a[2] * b[5],
            a[0] * b[6] + a[1] * b[7] + a[2] * b[8],
            a[3] * b[0] + a[4] * b[1] + a[5] * b[2], a[3] * b[3] + a[4] * b[4] + a[5] * b[5],
            a[3] * b[6] + a[4] * b[7] + a[5] * b[8],
            a[6] * b[0] + a[7] * b[1] + a[8] * b[2], a[6] * b[3] + a[7] * b[4] + a[8] * b[5],
            a[6] * b[6] + a[7] * b[7] + a[8] * b[8])


@inner
def subtract_full(s, a):
    """s - a of a symmetric s and a full a, as a 9-tuple."""
    return (s[0] - a[0], s[3] - a[1], s[4] - a[2], s[3] - a[3], s[1] - a[4], s[5] - a[5],
            s[4] - a[6], s[5] - a[7], s[2] - a[8])


@inner
def scaled(x, s, spherical):
    """x s + spherical I, as a 6-tuple."""
    return x * s[0] + spherical, x * s[1] + spherical, x * s[2] + spherical, x * s[3], x * s[4], x * s[5]


@inner
def times_transposed(s, a):
    """s a^T of a symmetric s, as a 9-tuple."""
    return (s[0] * a[0] + s[3] * a[1] + s[4] * a[2], s[0] * a[3] + s[3] * a[4] + s[4] * a[5],
            s[0] * a[6] + s[3] * a[7] + s[4] * a[8],
            s[3] * a[0] + s[1] * a[1] + s[5] * a[2], s[3] * a[3] + s[1] * a[4] + s[5] * a[5],
            s[3] * a[6] + s[1] * a[7] + s[5] * a[8],
            s[4] * a[0] + s[5] * a[1] + s[2] * a[2], s[4] * a[3] + s[5] * a[4] + s[2] * a[5],
            s[4] * a[6] + s[5] * a[7] + s[2] * a[8])


@inner
def congruence(a, s):
    """a s a^T of a symmetric s, as a 6-tuple."""
    m = times_transposed(s, a)  # s a^T
    return (a[0] * m[0] + a[1] * m[3] + a[2] * m[6], a[3] * m[1] + a[4] * m[4] + a[5] * m[7],
            a[6] * m[2] + a[7] * m[5] + a[8] * m[8], a[0] * m[1] + a[1] * m[4] + a[2] * m[7],
            a[0] * m[2] + a[1] * m[5] + a[2] * m[8], a[3] * m[2] + a[4] * m[5] + a[5] * m[8])


@inner
def twice_symmetric(a, s):
    """a s + s a^T of a symmetric s, as a 6-tuple."""
    m = times_transposed(s, a)  # s a^T
    return 2.0 * m[0], 2.0 * m[4], 2.0 * m[8], m[1] + m[3], m[2] + m[6], m[5] + m[7]


@inner
def deviator(s):
    """(tr s / 3, dev s)."""
    mean = (s[0] + s[1] + s[2]) / 3.0
    return mean, (s[0] - mean, s[1] - mean, s[2] - mean, s[3], s[4], s[5])


@inner
def contract(s, t):
    """s : t of two symmetric tensors."""
    return s[0] * t[0] + s[1] * t[1] + s[2] * t[2] + 2.0 * (s[3] * t[3] + s[4] * t[4] + s[5] * t[5])


@inner
def combine(x, s, y, t, spherical):
    """x s + y t + spherical I, as a 6-tuple."""
    return (x * s[0] + y * t[0] + spherical, x * s[1] + y * t[1] + spherical, x * s[2] + y * t[2] + spherical,
            x * s[3] + y * t[3], x * s[4] + y * t[4], x * s[5] + y * t[5])


@inner
def squared(s):
    """s s of a symmetric s, as a 6-tuple."""
    return (s[0] * s[0] + s[3] * s[3] + s[4] * s[4], s[3] * s[3] + s[1] * s[1] + s[5] * s[5],
            s[4] * s[4] + s[5] * s[5] + s[2] * s[2], s[0] * s[3] + s[3] * s[1] + s[4] * s[5],
            s[0] * s[4] + s[3] * s[5] + s[4] * s[2], s[3] * s[4] + s[1] * s[5] + s[5] * s[2])


@inner
def fill_row(A, row, x, y, g, z, p0, p1, p2, q0, q1, q2):
    """A row of `fill_tangent`."""
    A[row, 0], A[row, 1], A[row, 2] = x * y[0] + g * z[0] + p0 * q0, x * y[1] + g * z[1] + p0 * q1, \
        x * y[2] + g * z[2] + p0 * q2
    A[row, 3], A[row, 4], A[row, 5] = x * y[3] + g * z[3] + p1 * q0, x * y[4] + g * z[4] + p1 * q1, \
        x * y[5] + g * z[5] + p1 * q2
    A[row, 6], A[row, 7], A[row, 8] = x * y[6] + g * z[6] + p2 * q0, x * y[7] + g * z[7] + p2 * q1, \
        x * y[8] + g * z[8] + p2 * q2


@inner
def fill_tangent(fi, M, m, x, y, z, A):
    """A[iJ, kL] = delta_ik M_JL + m Fi_Li Fi_Jk + x_iJ y_kL + Fi_Ji z_kL, Fi = F^-1, M symmetric, the others full."""
    fill_row(A, 0, x[0], y, fi[0], z, m * fi[0], m * fi[1], m * fi[2], fi[0], fi[3], fi[6])
    fill_row(A, 1, x[1], y, fi[3], z, m * fi[3], m * fi[4], m * fi[5], fi[0], fi[3], fi[6])
    fill_row(A, 2, x[2], y, fi[6], z, m * fi[6], m * fi[7], m * fi[8], fi[0], fi[3], fi[6])
    fill_row(A, 3, x[3], y, fi[1], z, m * fi[0], m * fi[1], m * fi[2], fi[1], fi[4], fi[7])
    fill_row(A, 4, x[4], y, fi[4], z, m * fi[3], m * fi[4], m * fi[5], fi[1], fi[4], fi[7])
    fill_row(A, 5, x[5], y, fi[7], z, m * fi[6], m * fi[7], m * fi[8], fi[1], fi[4], fi[7])
    fill_row(A, 6, x[6], y, fi[2], z, m * fi[0], m * fi[1], m * fi[2], fi[2], fi[5], fi[8])
    fill_row(A, 7, x[7], y, fi[5], z, m * fi[3], m * fi[4], m * fi[5], fi[2], fi[5], fi[8])
    fill_row(A, 8, x[8], y, fi[8], z, m * fi[6], m * fi[7], m * fi[8], fi[2], fi[5], fi[8])
    for i in range(3):
        A[3 * i, 3 * i] += M[0]
        A[3 * i + 1, 3 * i + 1] += M[1]
        A[3 * i + 2, 3 * i + 2] += M[2]
        A[3 * i, 3 * i + 1] += M[3]
        A[3 * i + 1, 3 * i] += M[3]
        A[3 * i, 3 * i + 2] += M[4]
        A[3 * i + 2, 3 * i] += M[4]
        A[3 * i + 1, 3 * i + 2] += M[5]
        A[3 * i + 2, 3 * i + 1] += M[5]
