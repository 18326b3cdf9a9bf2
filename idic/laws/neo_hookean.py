"""Compressible neo-Hookean elasticity; the shortest law, a good one to copy."""

from __future__ import annotations

import numpy as np

from idic.laws.core import tensors
from idic.laws.core.inner import array_maker, inner
from idic.laws.core.law import LawParameter, LawSpec, register


@inner
def inverse(F, out):
    """out = F^-1; returns det F."""
    a = F[1, 1] * F[2, 2] - F[1, 2] * F[2, 1]
    b = F[1, 2] * F[2, 0] - F[1, 0] * F[2, 2]
    c = F[1, 0] * F[2, 1] - F[1, 1] * F[2, 0]
    J = F[0, 0] * a + F[0, 1] * b + F[0, 2] * c
    r = 1.0 / J
    out[0, 0], out[1, 0], out[2, 0] = a * r, b * r, c * r
    out[0, 1] = (F[0, 2] * F[2, 1] - F[0, 1] * F[2, 2]) * r
    out[1, 1] = (F[0, 0] * F[2, 2] - F[0, 2] * F[2, 0]) * r
    out[2, 1] = (F[0, 1] * F[2, 0] - F[0, 0] * F[2, 1]) * r
    out[0, 2] = (F[0, 1] * F[1, 2] - F[0, 2] * F[1, 1]) * r
    out[1, 2] = (F[0, 2] * F[1, 0] - F[0, 0] * F[1, 2]) * r
    out[2, 2] = (F[0, 0] * F[1, 1] - F[0, 1] * F[1, 0]) * r
    return J


@array_maker
def update(F, state, params, dt, P, state_new):
    """P = 2 C10 J^(-2/3) (F - I1/3 F^-T) + kappa (J - 1) J F^-T,  I1 = F:F."""
    C10, kappa = params[0], params[1]
    Fi = F.copy()
    J = inverse(F, Fi)
    if not J.real > 0.0:
        return 1
    I1 = 0.0 * J
    for i in range(3):
        for j in range(3):
            I1 += F[i, j] * F[i, j]
    c = 2.0 * C10 * J ** (-2.0 / 3.0)
    q = kappa * (J - 1.0) * J - c * I1 / 3.0
    for i in range(3):
        for j in range(3):
            P[i, j] = c * F[i, j] + q * Fi[j, i]
    return 0


@array_maker
def linearise(F, state, params, dt, dF, dstate, dparams, P, state_new, dP, dstate_new):
    """`update` and its derivative, with t = tr(F^-1 dF) and d(F^-T) = -F^-T dF^T F^-T."""
    C10, kappa = params[0], params[1]
    Fi, G = np.empty((3, 3)), np.empty((3, 3))
    J = inverse(F, Fi)
    if not J > 0.0:
        return 1
    I1 = 0.0
    for i in range(3):
        for j in range(3):
            I1 += F[i, j] * F[i, j]
    iso = 2.0 * J ** (-2.0 / 3.0)
    c = C10 * iso
    q = kappa * (J - 1.0) * J - c * I1 / 3.0
    for i in range(3):
        for j in range(3):
            P[i, j] = c * F[i, j] + q * Fi[j, i]
    for k in range(dF.shape[0]):
        d = dF[k]
        t, FdF = 0.0, 0.0
        for i in range(3):
            for j in range(3):
                G[i, j] = Fi[i, 0] * d[0, j] + Fi[i, 1] * d[1, j] + Fi[i, 2] * d[2, j]  # F^-1 dF
                FdF += F[i, j] * d[i, j]
            t += G[i, i]
        dc, dkappa = -2.0 / 3.0 * t * c, 0.0
        if dparams.shape[0] > 0:
            dc += iso * dparams[k, 0]
            dkappa = dparams[k, 1]
        dq = kappa * (2.0 * J - 1.0) * J * t + dkappa * (J - 1.0) * J - (dc * I1 + 2.0 * c * FdF) / 3.0
        for i in range(3):
            for j in range(3):
                dFi = -(G[j, 0] * Fi[0, i] + G[j, 1] * Fi[1, i] + G[j, 2] * Fi[2, i])  # d(F^-1)_ji
                dP[k, i, j] = dc * F[i, j] + c * d[i, j] + dq * Fi[j, i] + q * dFi
    return 0


def tangent(F, state, params, dt, P, state_new, A, work):
    """`update` and dP/dF = dc F + c dF + dq F^-T + q d(F^-T), a sum of products of F and F^-T."""
    C10, kappa = params[0], params[1]
    f = tensors.load(F)
    J, fi = tensors.inverse(f)
    if not J > 0.0:
        return 1
    I1 = (f[0] * f[0] + f[1] * f[1] + f[2] * f[2] + f[3] * f[3] + f[4] * f[4] + f[5] * f[5] + f[6] * f[6] + f[7] * f[7]
          + f[8] * f[8])
    c = 2.0 * C10 * J ** (-2.0 / 3.0)
    q = kappa * (J - 1.0) * J - c * I1 / 3.0
    around = tensors.transposed(fi)
    tensors.store(tensors.sum_of(c, f, q, around, 0.0, f), P)
    by_volume = kappa * (2.0 * J - 1.0) * J + 2.0 / 9.0 * c * I1
    tensors.fill_tangent(f, tensors.multiple(-2.0 / 3.0 * c, around),
                         around, tensors.sum_of(by_volume, around, -2.0 / 3.0 * c, f, 0.0, f),
                         tensors.multiple(-q, around), around, A)
    tensors.add_blocks((c, c, c, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0, 0.0, 0.0), A)
    return 0


def C10_kappa_of_mu(mu, kappa):
    """C10 = mu / 2 and kappa (MPa) of the initial shear modulus mu and the bulk modulus kappa (MPa)."""
    return {"C10": 0.5 * mu, "kappa": kappa}


def C10_kappa_of_E_nu(E, nu):
    """C10 and kappa (MPa) of the initial E (MPa) and nu."""
    return {"C10": 0.25 * E / (1.0 + nu), "kappa": E / (3.0 * (1.0 - 2.0 * nu))}


LAW = register(LawSpec(
    name="neo_hookean",
    parameters=(
        LawParameter("C10", "MPa", "half the shear modulus", default=3.3),
        LawParameter("kappa", "MPa", "bulk modulus", default=660.0),
    ),
    updates={"finite": update},
    linearise={"finite": linearise},
    tangents={"finite": tangent},
    reference="W = C10 (J^(-2/3) I1 - 3) + kappa (J - 1)^2 / 2; Holzapfel, Nonlinear Solid Mechanics (2000), ch. 6",
    alternatives={("mu", "kappa"): C10_kappa_of_mu, ("E", "nu"): C10_kappa_of_E_nu},
))
