"""Products of symmetric 3 x 3 tensors that laws in the right Cauchy-Green tensor need; tuples as in ``tensors.py``."""

from __future__ import annotations

from idic.laws.core import tensors
from idic.laws.core.inner import inner


@inner
def crossed(s, t):
    """The derivative of adj(s) along t; adj(s) = crossed(s, s) / 2."""
    return (s[1] * t[2] + t[1] * s[2] - 2.0 * s[5] * t[5], s[0] * t[2] + t[0] * s[2] - 2.0 * s[4] * t[4],
            s[0] * t[1] + t[0] * s[1] - 2.0 * s[3] * t[3],
            s[4] * t[5] + t[4] * s[5] - s[3] * t[2] - t[3] * s[2],
            s[3] * t[5] + t[3] * s[5] - s[4] * t[1] - t[4] * s[1],
            s[3] * t[4] + t[3] * s[4] - s[0] * t[5] - t[0] * s[5])


@inner
def adjugate(s):
    """adj(s) = det(s) s^-1 of a symmetric 6-tuple."""
    return (s[1] * s[2] - s[5] * s[5], s[0] * s[2] - s[4] * s[4], s[0] * s[1] - s[3] * s[3],
            s[4] * s[5] - s[3] * s[2], s[3] * s[5] - s[4] * s[1], s[3] * s[4] - s[0] * s[5])


@inner
def deviatoric_product(s, t):
    """(tr(s t), dev(s t)) of two symmetric tensors; the deviator is a 9-tuple."""
    a, b, c = (s[0] * t[0] + s[3] * t[3] + s[4] * t[4], s[3] * t[3] + s[1] * t[1] + s[5] * t[5],
               s[4] * t[4] + s[5] * t[5] + s[2] * t[2])
    mean = (a + b + c) / 3.0
    return a + b + c, (a - mean, s[0] * t[3] + s[3] * t[1] + s[4] * t[5], s[0] * t[4] + s[3] * t[5] + s[4] * t[2],
                       s[3] * t[0] + s[1] * t[3] + s[5] * t[4], b - mean, s[3] * t[4] + s[1] * t[5] + s[5] * t[2],
                       s[4] * t[0] + s[5] * t[3] + s[2] * t[4], s[4] * t[3] + s[5] * t[1] + s[2] * t[5], c - mean)


@inner
def trace_of_product(a, b):
    """tr(a b) of two 9-tuples."""
    return (a[0] * b[0] + a[4] * b[4] + a[8] * b[8] + a[1] * b[3] + a[3] * b[1] + a[2] * b[6] + a[6] * b[2]
            + a[5] * b[7] + a[7] * b[5])


@inner
def times(a, s):
    """a s of a full a and a symmetric s, as a 9-tuple."""
    return (a[0] * s[0] + a[1] * s[3] + a[2] * s[4], a[0] * s[3] + a[1] * s[1] + a[2] * s[5],
            a[0] * s[4] + a[1] * s[5] + a[2] * s[2],
            a[3] * s[0] + a[4] * s[3] + a[5] * s[4], a[3] * s[3] + a[4] * s[1] + a[5] * s[5],
            a[3] * s[4] + a[4] * s[5] + a[5] * s[2],
            a[6] * s[0] + a[7] * s[3] + a[8] * s[4], a[6] * s[3] + a[7] * s[1] + a[8] * s[5],
            a[6] * s[4] + a[7] * s[5] + a[8] * s[2])


@inner
def cauchy_green(f, d):
    """sym(f^T d) of two 9-tuples, as a 6-tuple; C = cauchy_green(F, F)."""
    return (f[0] * d[0] + f[3] * d[3] + f[6] * d[6], f[1] * d[1] + f[4] * d[4] + f[7] * d[7],
            f[2] * d[2] + f[5] * d[5] + f[8] * d[8],
            0.5 * (f[0] * d[1] + d[0] * f[1] + f[3] * d[4] + d[3] * f[4] + f[6] * d[7] + d[6] * f[7]),
            0.5 * (f[0] * d[2] + d[0] * f[2] + f[3] * d[5] + d[3] * f[5] + f[6] * d[8] + d[6] * f[8]),
            0.5 * (f[1] * d[2] + d[1] * f[2] + f[4] * d[5] + d[4] * f[5] + f[7] * d[8] + d[7] * f[8]))


@inner
def determinant(f):
    """det of a 9-tuple."""
    return (f[0] * (f[4] * f[8] - f[5] * f[7]) + f[1] * (f[5] * f[6] - f[3] * f[8])
            + f[2] * (f[3] * f[7] - f[4] * f[6]))


@inner
def applied(K, V):
    """-K V as a 6-tuple."""
    return (-(K[0, 0] * V[0] + K[0, 1] * V[1] + K[0, 2] * V[2] + K[0, 3] * V[3] + K[0, 4] * V[4] + K[0, 5] * V[5]),
            -(K[1, 0] * V[0] + K[1, 1] * V[1] + K[1, 2] * V[2] + K[1, 3] * V[3] + K[1, 4] * V[4] + K[1, 5] * V[5]),
            -(K[2, 0] * V[0] + K[2, 1] * V[1] + K[2, 2] * V[2] + K[2, 3] * V[3] + K[2, 4] * V[4] + K[2, 5] * V[5]),
            -(K[3, 0] * V[0] + K[3, 1] * V[1] + K[3, 2] * V[2] + K[3, 3] * V[3] + K[3, 4] * V[4] + K[3, 5] * V[5]),
            -(K[4, 0] * V[0] + K[4, 1] * V[1] + K[4, 2] * V[2] + K[4, 3] * V[3] + K[4, 4] * V[4] + K[4, 5] * V[5]),
            -(K[5, 0] * V[0] + K[5, 1] * V[1] + K[5, 2] * V[2] + K[5, 3] * V[3] + K[5, 4] * V[4] + K[5, 5] * V[5]))


@inner
def inverse_change(C, J, Ci, t, dC):
    """Change of C^-1 along dC, t = tr(C^-1 dC) / 2."""
    return tensors.combine(1.0 / (J * J), crossed(C, dC), -2.0 * t, Ci, 0.0)
