"""The tangent of a law in axes that turn with the material, from its changes along six strains.

The stress of F = R U is R P(U), and no state changes with R. So the law is asked at U, where nothing turns, and only
along changes of Green's strain E: with h = U^-1 dE the change of U is

    dU = h - W U,   W skew with W U + U W = h - h^T,       dS = U^-1 (dP - dU S),   S = U^-1 P(U)

Six changes in place of nine, without the search for R; what a law finds by iteration it finds once.
"""

from __future__ import annotations

from idic.laws.composed.elastic_strain import full, inverse
from idic.laws.core import symmetric, tensors
from idic.laws.core.inner import inner

IDENTITY = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)


@inner
def change_of_stretch(U, inverse_U, E):
    """dU of dE, as a 9-tuple that is symmetric but for rounding."""
    h = symmetric.times(full(inverse_U), E)
    b1, b2, b3 = h[7] - h[5], h[2] - h[6], h[3] - h[1]
    trace = U[0] + U[1] + U[2]
    a = inverse((trace - U[0], trace - U[1], trace - U[2], -U[3], -U[4], -U[5]))
    k1, k2, k3 = a[0] * b1 + a[3] * b2 + a[4] * b3, a[3] * b1 + a[1] * b2 + a[5] * b3, a[4] * b1 + a[5] * b2 + a[2] * b3
    turned = symmetric.times((0.0, -k3, k2, k3, 0.0, -k1, -k2, k1, 0.0), U)
    return tensors.sum_of(1.0, h, -1.0, turned, 0.0, h)


@inner
def symmetric_product(inverse_U, P):
    """S = U^-1 P, as a 6-tuple."""
    s = tensors.product(full(inverse_U), tensors.load(P))
    return s[0], s[4], s[8], 0.5 * (s[1] + s[3]), 0.5 * (s[2] + s[6]), 0.5 * (s[5] + s[7])
