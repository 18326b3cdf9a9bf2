"""Compressible Mooney-Rivlin elasticity; with C01 = 0 it is ``neo_hookean``.

    b = J^(-2/3) F F^T,  tau = dev(2 (C10 + C01 tr b) b - 2 C01 b b) + kappa (J - 1) J 1,  P = tau F^-T
"""

from __future__ import annotations

import numpy as np

from idic.laws.core import tensors
from idic.laws.core.inner import inner
from idic.laws.core.law import LawParameter, LawSpec, register


@inner
def full(s):
    """9-tuple of a symmetric 6-tuple."""
    return s[0], s[3], s[4], s[3], s[1], s[5], s[4], s[5], s[2]


@inner
def kinematics(F):
    """(J, F^-1, b, tr b, b b) with b the isochoric left Cauchy-Green tensor."""
    f = tensors.load(F)
    J, fi = tensors.inverse(f)
    scale = J ** (-2.0 / 3.0) if J.real > 0.0 else 0.0 * J
    m = tensors.product_transposed(f, f)
    b = tensors.scaled(scale, (m[0], m[4], m[8], m[1], m[2], m[5]), 0.0)
    square = tensors.scaled(0.5, tensors.twice_symmetric(full(b), b), 0.0)
    return J, fi, b, b[0] + b[1] + b[2], square


@inner
def kirchhoff(J, b, I1, square, C10, C01, kappa):
    """tau as a 6-tuple."""
    _, deviator = tensors.deviator(tensors.combine(2.0 * (C10 + C01 * I1), b, -2.0 * C01, square, 0.0))
    return tensors.scaled(1.0, deviator, kappa * (J - 1.0) * J)


@inner
def motion_change(dF, fi, b):
    """(l = dF F^-1, tr l, change of the isochoric b)."""
    ell = tensors.product(tensors.load(dF), fi)
    t = ell[0] + ell[4] + ell[8]
    return ell, t, tensors.combine(1.0, tensors.twice_symmetric(ell, b), -2.0 / 3.0 * t, b, 0.0)


@inner
def store_change(first, second, sphere, tau, ell, fi, dP):
    """dP = (dtau - tau l^T) F^-T with dtau = dev(first + second) + sphere 1."""
    _, deviator = tensors.deviator(tensors.combine(1.0, first, 1.0, second, 0.0))
    change = tensors.subtract_full(tensors.scaled(1.0, deviator, sphere), tensors.times_transposed(tau, ell))
    tensors.store(tensors.product_transposed(change, fi), dP)


@inner
def rubber_tangent(f, kappa, point, derivatives, P, A):
    """P and dP/dF of W1(I1) + W2(I2); point : of `kinematics`, derivatives : (g1, slope of g1, g2, slope of g2).

    With t = tr l, U = b F^-T, V = b b F^-T and W = F^-T every change is a sum of l : b = U : dF, l : b b = V : dF and
    t = W : dF; tau + m 1 = f1 b + f2 b b has the factors f1 = 2 (g1 + g2 I1), f2 = -2 g2.
    """
    J, fi, b, I1, square = point
    g1, h1, g2, h2 = derivatives
    s = I1 / (f[0] * f[0] + f[1] * f[1] + f[2] * f[2] + f[3] * f[3] + f[4] * f[4] + f[5] * f[5] + f[6] * f[6]
              + f[7] * f[7] + f[8] * f[8])  # J^(-2/3)
    f1, f2, trace = 2.0 * (g1 + g2 * I1), -2.0 * g2, square[0] + square[1] + square[2]
    U, W = tensors.multiple(s, f), tensors.transposed(fi)
    V = tensors.times_transposed(b, tensors.multiple(s, tensors.transposed(f)))
    p, mean = kappa * (J - 1.0) * J, (f1 * I1 + f2 * trace) / 3.0
    tensors.store(tensors.sum_of(f1, U, f2, V, p - mean, W), P)
    I2_b, I2_t = 2.0 * I1, 2.0 / 3.0 * (trace - I1 * I1)  # change of I2: I2_b l : b - 2 l : b b + I2_t t
    by_I1 = 2.0 * (h1 + g2)
    e1 = (2.0 * by_I1 + 2.0 * I1 * h2 * I2_b, -4.0 * I1 * h2,
          -2.0 / 3.0 * I1 * by_I1 + 2.0 * I1 * h2 * I2_t - 2.0 / 3.0 * f1)
    e2 = (-2.0 * h2 * I2_b, 4.0 * h2, -2.0 * h2 * I2_t - 4.0 / 3.0 * f2)
    e3 = (-(2.0 * f1 + I1 * e1[0] + trace * e2[0]) / 3.0, -(4.0 * f2 + I1 * e1[1] + trace * e2[1]) / 3.0,
          kappa * (2.0 * J - 1.0) * J - (I1 * e1[2] + trace * e2[2]) / 3.0)
    tensors.fill_tangent(U, tensors.sum_of(e1[0], U, e1[1], V, e1[2], W), W,
                         tensors.sum_of(e3[0], U, e3[1], V, e3[2], W), tensors.multiple(mean - p, W), W, A)
    if g2 != 0.0 or h2 != 0.0:
        tensors.add_tangent(V, tensors.sum_of(e2[0], U, e2[1], V, e2[2], W), tensors.multiple(f2 * s, U), f, A)
    C = tensors.congruence(tensors.transposed(f), (1.0, 1.0, 1.0, 0.0, 0.0, 0.0))
    tensors.add_blocks(tensors.scaled(f2 * s * s, C, f1 * s), tensors.scaled(f2 * s, b, 0.0), A)


def update(F, state, params, dt, P, state_new):
    """See the top of this file."""
    J, fi, b, I1, square = kinematics(F)
    if not J.real > 0.0:
        return 1
    tau = kirchhoff(J, b, I1, square, params[0], params[1], params[2])
    tensors.store(tensors.times_transposed(tau, fi), P)
    return 0


def linearise(F, state, params, dt, dF, dstate, dparams, P, state_new, dP, dstate_new):
    """`update` and its derivative, with l = dF F^-1: dP = (dtau - tau l^T) F^-T."""
    C10, C01, kappa = params[0], params[1], params[2]
    J, fi, b, I1, square = kinematics(F)
    if not J > 0.0:
        return 1
    tau = kirchhoff(J, b, I1, square, C10, C01, kappa)
    tensors.store(tensors.times_transposed(tau, fi), P)
    factor = 2.0 * (C10 + C01 * I1)
    for k in range(dF.shape[0]):
        ell, t, db = motion_change(dF[k], fi, b)
        dfactor = 2.0 * C01 * (db[0] + db[1] + db[2])
        sphere, dC01 = kappa * (2.0 * J - 1.0) * J * t, 0.0
        if dparams.shape[0] > 0:
            dC01 = dparams[k, 1]
            dfactor += 2.0 * (dparams[k, 0] + dC01 * I1)
            sphere += dparams[k, 2] * (J - 1.0) * J
        first = tensors.combine(dfactor, b, factor, db, 0.0)
        second = tensors.combine(-2.0 * dC01, square, -2.0 * C01, tensors.twice_symmetric(full(db), b), 0.0)
        store_change(first, second, sphere, tau, ell, fi, dP[k])
    return 0


def tangent(F, state, params, dt, P, state_new, A, work):
    """`update` and its tangent."""
    point = kinematics(F)
    if not point[0] > 0.0:
        return 1
    rubber_tangent(tensors.load(F), params[2], point, (params[0], 0.0, params[1], 0.0), P, A)
    return 0


LAW = register(LawSpec(
    name="mooney_rivlin",
    parameters=(
        LawParameter("C10", "MPa", "factor of the first invariant; C10 + C01 is half the shear modulus", default=3.0),
        LawParameter("C01", "MPa", "factor of the second invariant", default=0.3, null=0.0, positive=False,
                     bounds=(-np.inf, np.inf)),
        LawParameter("kappa", "MPa", "bulk modulus", default=660.0),
    ),
    updates={"finite": update},
    linearise={"finite": linearise},
    tangents={"finite": tangent},
    reference="W = C10 (J^(-2/3) I1 - 3) + C01 (J^(-4/3) I2 - 3) + kappa (J - 1)^2 / 2; Mooney, J. Appl. Phys. 11 "
              "(1940) 582, doi:10.1063/1.1712836; Holzapfel, Nonlinear Solid Mechanics (2000), ch. 6",
))
