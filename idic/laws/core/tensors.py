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
def transposed(a):
    """a^T of a 9-tuple."""
    return a[0], a[3], a[6], a[1], a[4], a[7], a[2], a[5], a[8]


@inner
def multiple(x, a):
    """x a of a 9-tuple."""
    return x * a[0], x * a[1], x * a[2], x * a[3], x * a[4], x * a[5], x * a[6], x * a[7], x * a[8]


@inner
def sum_of(x, a, y, b, z, c):
    """x a + y b + z c of three 9-tuples."""
    return (x * a[0] + y * b[0] + z * c[0], x * a[1] + y * b[1] + z * c[1], x * a[2] + y * b[2] + z * c[2],
            x * a[3] + y * b[3] + z * c[3], x * a[4] + y * b[4] + z * c[4], x * a[5] + y * b[5] + z * c[5],
            x * a[6] + y * b[6] + z * c[6], x * a[7] + y * b[7] + z * c[7], x * a[8] + y * b[8] + z * c[8])


# tangents: (9, 9), rows iJ and columns kL of dP_iJ / dF_kL --------------------------------------------
@inner
def fill_row(A, row, x, y, u, z, p0, p1, p2, q0, q1, q2):
    """A row of `fill_tangent`."""
    A[row, 0], A[row, 1], A[row, 2] = x * y[0] + u * z[0] + p0 * q0, x * y[1] + u * z[1] + p0 * q1, \
        x * y[2] + u * z[2] + p0 * q2
    A[row, 3], A[row, 4], A[row, 5] = x * y[3] + u * z[3] + p1 * q0, x * y[4] + u * z[4] + p1 * q1, \
        x * y[5] + u * z[5] + p1 * q2
    A[row, 6], A[row, 7], A[row, 8] = x * y[6] + u * z[6] + p2 * q0, x * y[7] + u * z[7] + p2 * q1, \
        x * y[8] + u * z[8] + p2 * q2


@inner
def fill_tangent(x, y, u, z, p, q, A):
    """A[iJ, kL] = x_iJ y_kL + u_iJ z_kL + p_kJ q_iL of 9-tuples."""
    fill_row(A, 0, x[0], y, u[0], z, p[0], p[3], p[6], q[0], q[1], q[2])
    fill_row(A, 1, x[1], y, u[1], z, p[1], p[4], p[7], q[0], q[1], q[2])
    fill_row(A, 2, x[2], y, u[2], z, p[2], p[5], p[8], q[0], q[1], q[2])
    fill_row(A, 3, x[3], y, u[3], z, p[0], p[3], p[6], q[3], q[4], q[5])
    fill_row(A, 4, x[4], y, u[4], z, p[1], p[4], p[7], q[3], q[4], q[5])
    fill_row(A, 5, x[5], y, u[5], z, p[2], p[5], p[8], q[3], q[4], q[5])
    fill_row(A, 6, x[6], y, u[6], z, p[0], p[3], p[6], q[6], q[7], q[8])
    fill_row(A, 7, x[7], y, u[7], z, p[1], p[4], p[7], q[6], q[7], q[8])
    fill_row(A, 8, x[8], y, u[8], z, p[2], p[5], p[8], q[6], q[7], q[8])


@inner
def add_row(A, row, x, y, p0, p1, p2, q0, q1, q2):
    """A row of `add_tangent`."""
    A[row, 0] += x * y[0] + p0 * q0
    A[row, 1] += x * y[1] + p0 * q1
    A[row, 2] += x * y[2] + p0 * q2
    A[row, 3] += x * y[3] + p1 * q0
    A[row, 4] += x * y[4] + p1 * q1
    A[row, 5] += x * y[5] + p1 * q2
    A[row, 6] += x * y[6] + p2 * q0
    A[row, 7] += x * y[7] + p2 * q1
    A[row, 8] += x * y[8] + p2 * q2


@inner
def add_tangent(x, y, p, q, A):
    """A[iJ, kL] += x_iJ y_kL + p_kJ q_iL of 9-tuples."""
    add_row(A, 0, x[0], y, p[0], p[3], p[6], q[0], q[1], q[2])
    add_row(A, 1, x[1], y, p[1], p[4], p[7], q[0], q[1], q[2])
    add_row(A, 2, x[2], y, p[2], p[5], p[8], q[0], q[1], q[2])
    add_row(A, 3, x[3], y, p[0], p[3], p[6], q[3], q[4], q[5])
    add_row(A, 4, x[4], y, p[1], p[4], p[7], q[3], q[4], q[5])
    add_row(A, 5, x[5], y, p[2], p[5], p[8], q[3], q[4], q[5])
    add_row(A, 6, x[6], y, p[0], p[3], p[6], q[6], q[7], q[8])
    add_row(A, 7, x[7], y, p[1], p[4], p[7], q[6], q[7], q[8])
    add_row(A, 8, x[8], y, p[2], p[5], p[8], q[6], q[7], q[8])


@inner
def add_blocks(M, B, A):
    """A[iJ, kL] += delta_ik M_JL + B_ik delta_JL of symmetric M, B."""
    for i in range(3):
        j = 3 * i
        A[j, j] += M[0]
        A[j + 1, j + 1] += M[1]
        A[j + 2, j + 2] += M[2]
        A[j, j + 1] += M[3]
        A[j + 1, j] += M[3]
        A[j, j + 2] += M[4]
        A[j + 2, j] += M[4]
        A[j + 1, j + 2] += M[5]
        A[j + 2, j + 1] += M[5]
    for i in range(3):
        A[i, i] += B[0]
        A[3 + i, 3 + i] += B[1]
        A[6 + i, 6 + i] += B[2]
        A[i, 3 + i] += B[3]
        A[3 + i, i] += B[3]
        A[i, 6 + i] += B[4]
        A[6 + i, i] += B[4]
        A[3 + i, 6 + i] += B[5]
        A[6 + i, 3 + i] += B[5]


@inner
def unit_strain(b):
    """Strain b (0 ... 5) of the six whose stress changes are the columns of D in `push_tangent`."""
    return (1.0 if b == 0 else 0.0, 1.0 if b == 1 else 0.0, 1.0 if b == 2 else 0.0, 0.5 if b == 3 else 0.0,
            0.5 if b == 4 else 0.0, 0.5 if b == 5 else 0.0)


@inner
def push_row(A, row, f, D, a, b, c, x, y, z):
    """A row of `push_tangent`."""
    h0, h1 = x * D[a, 0] + y * D[b, 0] + z * D[c, 0], x * D[a, 1] + y * D[b, 1] + z * D[c, 1]
    h2, h3 = x * D[a, 2] + y * D[b, 2] + z * D[c, 2], x * D[a, 3] + y * D[b, 3] + z * D[c, 3]
    h4, h5 = x * D[a, 4] + y * D[b, 4] + z * D[c, 4], x * D[a, 5] + y * D[b, 5] + z * D[c, 5]
    A[row, 0], A[row, 1], A[row, 2] = f[0] * h0 + f[1] * h3 + f[2] * h4, f[0] * h3 + f[1] * h1 + f[2] * h5, \
        f[0] * h4 + f[1] * h5 + f[2] * h2
    A[row, 3], A[row, 4], A[row, 5] = f[3] * h0 + f[4] * h3 + f[5] * h4, f[3] * h3 + f[4] * h1 + f[5] * h5, \
        f[3] * h4 + f[4] * h5 + f[5] * h2
    A[row, 6], A[row, 7], A[row, 8] = f[6] * h0 + f[7] * h3 + f[8] * h4, f[6] * h3 + f[7] * h1 + f[8] * h5, \
        f[6] * h4 + f[7] * h5 + f[8] * h2


@inner
def push_tangent(f, S, D, A):
    """dP/dF of P = F S with dS = D dE, E Green's strain: A[iJ, kL] = delta_ik S_JL + F_iM F_kN D[MJ, NL].

    Column b of D (6, 6) is dS along `unit_strain` b.
    """
    push_row(A, 0, f, D, 0, 3, 4, f[0], f[1], f[2])
    push_row(A, 1, f, D, 3, 1, 5, f[0], f[1], f[2])
    push_row(A, 2, f, D, 4, 5, 2, f[0], f[1], f[2])
    push_row(A, 3, f, D, 0, 3, 4, f[3], f[4], f[5])
    push_row(A, 4, f, D, 3, 1, 5, f[3], f[4], f[5])
    push_row(A, 5, f, D, 4, 5, 2, f[3], f[4], f[5])
    push_row(A, 6, f, D, 0, 3, 4, f[6], f[7], f[8])
    push_row(A, 7, f, D, 3, 1, 5, f[6], f[7], f[8])
    push_row(A, 8, f, D, 4, 5, 2, f[6], f[7], f[8])
    add_blocks(S, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0), A)
