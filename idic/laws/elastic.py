"""Isotropic linear elasticity; with finite kinematics the St. Venant-Kirchhoff material."""

from __future__ import annotations

from collections.abc import Callable, Mapping


from idic.laws.core import tensors
from idic.laws.core.inner import array_maker, inner
from idic.laws.core.law import LawParameter, LawSpec, register


@inner
def lame(E, nu):
    """Lamé's constants of E and nu."""
    return E * nu / ((1.0 + nu) * (1.0 - 2.0 * nu)), 0.5 * E / (1.0 + nu)


@inner
def lame_change(E, nu, dE, dnu):
    """Change of Lamé's constants with E and nu."""
    lam, mu = lame(E, nu)
    below = (1.0 + nu) * (1.0 - 2.0 * nu)
    dlam = lam / E * dE + E * (1.0 + 2.0 * nu * nu) / (below * below) * dnu
    return dlam, mu / E * dE - mu / (1.0 + nu) * dnu


@inner
def small_stress(F, lam, mu, P):
    """sigma = lam tr(eps) I + 2 mu eps,  eps = sym(F - I)."""
    pressure = lam * (F[0, 0] + F[1, 1] + F[2, 2] - 3.0)
    for i in range(3):
        for j in range(3):
            P[i, j] = mu * (F[i, j] + F[j, i])
        P[i, i] += pressure - 2.0 * mu


def update_small(F, state, params, dt, P, state_new):
    """sigma = lam tr(eps) I + 2 mu eps,  eps = sym(F - I)."""
    lam, mu = lame(params[0], params[1])
    small_stress(F, lam, mu, P)
    return 0


def linearise_small(F, state, params, dt, dF, dstate, dparams, P, state_new, dP, dstate_new):
    """`update_small` and its derivative."""
    lam, mu = lame(params[0], params[1])
    trace = F[0, 0] + F[1, 1] + F[2, 2] - 3.0
    for i in range(3):
        for j in range(3):
            P[i, j] = mu * (F[i, j] + F[j, i])
        P[i, i] += lam * trace - 2.0 * mu
    for k in range(dF.shape[0]):
        dpressure = lam * (dF[k, 0, 0] + dF[k, 1, 1] + dF[k, 2, 2])
        for i in range(3):
            for j in range(3):
                dP[k, i, j] = mu * (dF[k, i, j] + dF[k, j, i])
            dP[k, i, i] += dpressure
    for k in range(dparams.shape[0]):
        dlam, dmu = lame_change(params[0], params[1], dparams[k, 0], dparams[k, 1])
        for i in range(3):
            for j in range(3):
                dP[k, i, j] += dmu * (F[i, j] + F[j, i])
            dP[k, i, i] += dlam * trace - 2.0 * dmu
    return 0


@inner
def second_piola(F, lam, mu, S):
    """S = lam tr(E) I + 2 mu E with Green's strain E = (F^T F - I)/2; returns tr(E)."""
    trace = -1.5 + 0.0 * F[0, 0]
    for i in range(3):
        for j in range(3):
            S[i, j] = mu * (F[0, i] * F[0, j] + F[1, i] * F[1, j] + F[2, i] * F[2, j])
            trace += 0.5 * F[i, j] * F[i, j]
    for i in range(3):
        S[i, i] += lam * trace - mu
    return trace


@inner
def multiply(A, B, out):
    """out = A B for 3 x 3 matrices."""
    for i in range(3):
        for j in range(3):
            out[i, j] = A[i, 0] * B[0, j] + A[i, 1] * B[1, j] + A[i, 2] * B[2, j]


@array_maker
def update_finite(F, state, params, dt, P, state_new):
    """P = F S,  S = lam tr(E) I + 2 mu E."""
    lam, mu = lame(params[0], params[1])
    S = F.copy()
    second_piola(F, lam, mu, S)
    multiply(F, S, P)
    return 0


@array_maker
def linearise_finite(F, state, params, dt, dF, dstate, dparams, P, state_new, dP, dstate_new):
    """`update_finite` and its derivative, dP = dF S + F dS."""
    lam, mu = lame(params[0], params[1])
    S, dS = F.copy(), F.copy()
    trace = second_piola(F, lam, mu, S)
    multiply(F, S, P)
    for k in range(dF.shape[0]):
        d = dF[k]
        dlam, dmu, dtrace = 0.0, 0.0, 0.0
        if dparams.shape[0] > 0:
            dlam, dmu = lame_change(params[0], params[1], dparams[k, 0], dparams[k, 1])
        for i in range(3):
            for j in range(3):
                FtdF = F[0, i] * d[0, j] + F[1, i] * d[1, j] + F[2, i] * d[2, j]
                dFtF = d[0, i] * F[0, j] + d[1, i] * F[1, j] + d[2, i] * F[2, j]
                dS[i, j] = mu * (FtdF + dFtF)
                dtrace += F[i, j] * d[i, j]
                if dmu != 0.0:
                    dS[i, j] += dmu * (F[0, i] * F[0, j] + F[1, i] * F[1, j] + F[2, i] * F[2, j])
        for i in range(3):
            dS[i, i] += dlam * trace + lam * dtrace - dmu
        for i in range(3):
            for j in range(3):
                dP[k, i, j] = (d[i, 0] * S[0, j] + d[i, 1] * S[1, j] + d[i, 2] * S[2, j]
                               + F[i, 0] * dS[0, j] + F[i, 1] * dS[1, j] + F[i, 2] * dS[2, j])
    return 0


@inner
def isotropic_tangent(finite, f, lam, mu, s, slope, stress, A):
    """dP/dF of stress = 2 mu e + lam tr(e) 1 + (what grows along s with slope : e), e Green's or the small strain.

    A[iJ, kL] = delta_ik S_JL + F_iM F_kN (lam delta_MJ delta_NL + mu (delta_MN delta_JL + delta_ML delta_NJ)
    + s_MJ slope_NL); small strain: F = 1, and no S.
    """
    if not finite:
        f = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
    transposed = tensors.transposed(f)
    along = tensors.transposed(tensors.times_transposed(s, f))  # F s
    tensors.fill_tangent(f, tensors.multiple(lam, f), along, tensors.transposed(tensors.times_transposed(slope, f)),
                         tensors.multiple(mu, f), f, A)
    b = tensors.product(f, transposed)
    tensors.add_blocks(tensors.scaled(1.0 if finite else 0.0, stress, 0.0),
                       (mu * b[0], mu * b[4], mu * b[8], mu * b[1], mu * b[2], mu * b[5]), A)


def tangent_small(F, state, params, dt, P, state_new, A, work):
    """`update_small` and its tangent."""
    lam, mu = lame(params[0], params[1])
    none = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    small_stress(F, lam, mu, P)
    isotropic_tangent(False, tensors.load(F), lam, mu, none, none, none, A)
    return 0


def tangent_finite(F, state, params, dt, P, state_new, A, work):
    """`update_finite` and its tangent."""
    lam, mu = lame(params[0], params[1])
    f = tensors.load(F)
    C = tensors.congruence(tensors.transposed(f), (1.0, 1.0, 1.0, 0.0, 0.0, 0.0))
    none = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    S = tensors.scaled(mu, C, 0.5 * lam * (C[0] + C[1] + C[2] - 3.0) - mu)
    tensors.store(tensors.transposed(tensors.times_transposed(S, f)), P)  # F S
    isotropic_tangent(True, f, lam, mu, none, none, S, A)
    return 0


def E_nu_of_K_G(K, G):
    """E (MPa) and nu of the bulk modulus K and the shear modulus G (MPa)."""
    return {"E": 9.0 * K * G / (3.0 * K + G), "nu": (3.0 * K - 2.0 * G) / (2.0 * (3.0 * K + G))}


def E_nu_of_E_G(E, G):
    """E (MPa) and nu of E and the shear modulus G (MPa)."""
    return {"E": E, "nu": 0.5 * E / G - 1.0}


def E_nu_of_E_K(E, K):
    """E (MPa) and nu of E and the bulk modulus K (MPa)."""
    return {"E": E, "nu": 0.5 - E / (6.0 * K)}


def E_nu_of_lame(lam, mu):
    """E (MPa) and nu of Lame's constants (MPa)."""
    return {"E": mu * (3.0 * lam + 2.0 * mu) / (lam + mu), "nu": 0.5 * lam / (lam + mu)}


ELASTIC_PARAMETERS = (
    LawParameter("E", "MPa", "Young's modulus", default=70e3),
    LawParameter("nu", "-", "Poisson's ratio", default=0.3, positive=False, bounds=(-0.99, 0.4999)),
)
ELASTIC_ALTERNATIVES: Mapping[tuple[str, ...], Callable] = {
    ("K", "G"): E_nu_of_K_G, ("E", "G"): E_nu_of_E_G, ("E", "K"): E_nu_of_E_K, ("lam", "mu"): E_nu_of_lame}

LAW = register(LawSpec(
    name="elastic",
    parameters=ELASTIC_PARAMETERS,
    updates={"small": update_small, "finite": update_finite},
    linearise={"small": linearise_small, "finite": linearise_finite},
    tangents={"small": tangent_small, "finite": tangent_finite},
    linear=True,
    reference="Hooke's law; finite: St. Venant-Kirchhoff, S = lam tr(E) I + 2 mu E (small strains, large rotations)",
    alternatives=ELASTIC_ALTERNATIVES,
))
