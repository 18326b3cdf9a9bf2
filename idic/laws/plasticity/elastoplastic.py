"""Finite-strain elastoplasticity: the parts that all laws of this kind share, up to the return of their own.

The deformation gradient splits into an elastic and a plastic factor; plastic flow keeps the volume (Simo, Comput.
Methods Appl. Mech. Eng. 99 (1992) 61, doi:10.1016/0045-7825(92)90123-2; Simo & Hughes, Computational Inelasticity
(1998), box 9.1, doi:10.1007/b98904). The trial state of a step and the state after a return along the deviator are

    b = J^(-2/3) F Cp^-1 F^T,  I = tr(b)/3,  s = G dev b
    y = 1 - 2 G I x / |s|,  tau = y s + kappa (J - 1) J 1,  P = tau F^-T
    b+ = y dev b + I 1,  Cp^-1 = J^(2/3) F^-1 b+ F^-T,  p+ = p + sqrt(2/3) x

Each law finds x, the plastic multiplier of the step, from its own yield condition (``composed/isotropic_return.py``,
``creep.py`` ...). State: Cp^-1 - 1 (11, 22, 33, 12, 13, 23) and p, the equivalent plastic strain.
"""

from __future__ import annotations

import math

import numpy as np

from idic.laws.core import tensors
from idic.laws.core.inner import inner
from idic.laws.core.law import LawParameter
from idic.laws.elastic import ELASTIC_ALTERNATIVES, ELASTIC_PARAMETERS

ROOT = math.sqrt(2.0 / 3.0)
MAX_ITERATIONS = 100
RELATIVE_TOLERANCE = 1e-8    # Newton: the error after a step of 1e-8 is 1e-16
ABSOLUTE_TOLERANCE = 1e-14   # of the strain at which the trial stress would vanish: rounding of the yield function

STATE_NAMES = ("cpi11-1", "cpi22-1", "cpi33-1", "cpi12", "cpi13", "cpi23", "plastic_strain")

PARAMETERS = (*ELASTIC_PARAMETERS,
              LawParameter("yield_stress", "MPa", "initial yield stress", default=200.0, null=math.inf,
                           activation_factor=0.6))
ALTERNATIVES = ELASTIC_ALTERNATIVES


@inner
def shear_and_bulk(E, nu):
    """G and kappa of E and nu."""
    return 0.5 * E / (1.0 + nu), E / (3.0 * (1.0 - 2.0 * nu))


@inner
def elastic_change(params, d):
    """Change of G and kappa with E and nu."""
    G, kappa = shear_and_bulk(params[0], params[1])
    return (G / params[0] * d[0] - G / (1.0 + params[1]) * d[1],
            kappa / params[0] * d[0] + 2.0 * kappa / (1.0 - 2.0 * params[1]) * d[1])


@inner
def trial_state(F, state):
    """(J, F^-1, b, I, dev b, |dev b|, J^(-2/3)) of a point, real or complex."""
    f = tensors.load(F)
    J, fi = tensors.inverse(f)
    c = (1.0 + state[0], 1.0 + state[1], 1.0 + state[2], state[3], state[4], state[5])
    scale = J ** (-2.0 / 3.0) if J.real > 0.0 else 0.0 * J
    b = tensors.congruence(f, c)
    b = tensors.scaled(scale, b, 0.0)
    mean, dev = tensors.deviator(b)
    return J, fi, b, mean, dev, np.sqrt(tensors.contract(dev, dev)), scale


@inner
def cp_after(fi, keep, mean, dev, scale, state_new):
    """Cp^-1 of the b+ that the return leaves, into the state."""
    c = tensors.congruence(fi, tensors.scaled(keep * scale, dev, mean * scale))
    state_new[0], state_new[1], state_new[2] = c[0] - 1.0, c[1] - 1.0, c[2] - 1.0
    state_new[3], state_new[4], state_new[5] = c[3], c[4], c[5]


@inner
def one_direction(F, trial, solution, explicit, k, dF, dstate, dP, dstate_new):
    """Row k of dP and dstate_new; l = dF F^-1, the return's x by the implicit function theorem."""
    J, fi, b, mean, dev, norm, shrink = trial
    plastic, x, keep, inverse_slope, slope, scale, tau = solution
    G, kappa, dG, dkappa, dflow, dp = explicit
    ell = tensors.product(tensors.load(dF[k]), fi)
    t = ell[0] + ell[4] + ell[8]
    db = tensors.combine(1.0, tensors.twice_symmetric(ell, b), -2.0 / 3.0 * t, b, 0.0)
    if dstate.shape[0] > 0:
        dc = (dstate[k, 0], dstate[k, 1], dstate[k, 2], dstate[k, 3], dstate[k, 4], dstate[k, 5])
        db = tensors.combine(1.0, db, shrink, tensors.congruence(tensors.load(F), dc), 0.0)
    dmean, ddev = tensors.deviator(db)
    dkeep, dx = 0.0, 0.0
    if plastic:
        dnorm = tensors.contract(dev, ddev) / norm
        dexcess = dG * norm + G * dnorm - 2.0 * x * (dG * mean + G * dmean) - ROOT * (slope * dp + dflow)
        dx = dexcess * inverse_slope
        dkeep = (-2.0 * (dmean * x + mean * dx) + 2.0 * mean * x / norm * dnorm) / norm
    dpressure = kappa * (2.0 * J - 1.0) * J * t + dkappa * (J - 1.0) * J
    dtau = tensors.combine(dkeep * G + keep * dG, dev, keep * G, ddev, dpressure)
    change = tensors.subtract_full(dtau, tensors.times_transposed(tau, ell))  # d(tau F^-T) = (dtau - tau l^T) F^-T
    tensors.store(tensors.product_transposed(change, fi), dP[k])
    if k >= dstate_new.shape[0]:
        return
    if plastic:
        b_after = tensors.scaled(keep, dev, mean)
        db_after = tensors.combine(dkeep, dev, keep, ddev, dmean)
        db_after = tensors.combine(1.0, db_after, -1.0, tensors.twice_symmetric(ell, b_after), 0.0)
        db_after = tensors.combine(scale, db_after, 2.0 / 3.0 * t * scale, b_after, 0.0)
        dc = tensors.congruence(fi, db_after)
        for m in range(6):
            dstate_new[k, m] = dc[m]
    else:
        for m in range(6):
            dstate_new[k, m] = dstate[k, m] if dstate.shape[0] > 0 else 0.0
    dstate_new[k, 6] = dp + ROOT * dx


@inner
def closed_tangent(state, trial, solution, moduli, flow_by_volume, A):
    """dP/dF of a return along the deviator, into A (9, 9): a(l) F^-T with l = dF F^-1, t = tr l, g = y G,

        a(l) = l g b + (g I - p) l^T + dev b (alpha : l) + 1 (beta : l),       p = kappa (J - 1) J
        alpha = G (k1 dev b + k2 dev b^2 + k3 1) - 2/3 g 1,  beta = (dp/dt - 2/3 g I) 1 - 2/3 g dev b

    dy = (k1 dev b + k2 dev b^2 + k3 1) : l as in `one_direction`; ``flow_by_volume``: change of the flow stress over t.
    """
    J, fi, b, mean, dev, norm, shrink = trial
    plastic, x, keep, inverse_slope = solution
    G, kappa = moduli
    k1, k2, k3, stiffness = 0.0, 0.0, 0.0, keep * G
    if plastic:
        by_norm = 2.0 * mean / norm * (x / norm - inverse_slope * G)
        by_mean = 2.0 * x / norm * (2.0 * mean * G * inverse_slope - 1.0)
        k1, k2 = 2.0 * by_norm * mean / norm + 2.0 / 3.0 * by_mean, 2.0 * by_norm / norm
        k3 = 2.0 * mean / norm * inverse_slope * ROOT * flow_by_volume - 2.0 / 3.0 * by_norm * norm
    square = tensors.squared(dev)
    alpha = tensors.combine(G * k1, dev, G * k2, square, G * k3 - 2.0 / 3.0 * stiffness)
    beta = tensors.scaled(-2.0 / 3.0 * stiffness, dev, kappa * (2.0 * J - 1.0) * J - 2.0 / 3.0 * stiffness * mean)
    g = stiffness * shrink  # F^-1 g b F^-T = g J^(-2/3) Cp^-1
    M = (g * (1.0 + state[0]), g * (1.0 + state[1]), g * (1.0 + state[2]), g * state[3], g * state[4], g * state[5])
    around = tensors.transposed(fi)
    tensors.fill_tangent(tensors.times_transposed(dev, fi), tensors.times_transposed(alpha, fi), around,
                         tensors.times_transposed(beta, fi),
                         tensors.multiple(stiffness * mean - kappa * (J - 1.0) * J, around), around, A)
    tensors.add_blocks(M, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0), A)
