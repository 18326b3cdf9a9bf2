"""J2 plasticity at finite strain with isotropic hardening: what the ``j2_*`` laws share.

Multiplicative split, radial return on the isochoric elastic left Cauchy-Green tensor (Simo, Comput. Methods Appl.
Mech. Eng. 99 (1992) 61, doi:10.1016/0045-7825(92)90123-2; Simo & Hughes, Computational Inelasticity, box 9.1):

    b = J^(-2/3) F Cp^-1 F^T,  I = tr(b)/3,  s = G dev b,  f = |s| - sqrt(2/3) sigma(p)
    |s| - 2 G I x - sqrt(2/3) sigma(p + sqrt(2/3) x) = 0
    y = 1 - 2 G I x / |s|,  tau = y s + kappa (J - 1) J 1,  P = tau F^-T
    b+ = y dev b + I 1,  Cp^-1 = J^(2/3) F^-1 b+ F^-T,  p+ = p + sqrt(2/3) x

State: Cp^-1 - 1 (11, 22, 33, 12, 13, 23) and p, the equivalent plastic strain. Parameters: E, nu, then hardening.

The hardening laws are in ``hardening.py``; ``kind`` says which.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from idic.materials.core import tensors
from idic.materials.core.law import LawParameter
from idic.materials.elastic import ELASTIC_ALTERNATIVES, ELASTIC_PARAMETERS
from idic.materials.plasticity.hardening import flow_stress, flow_stress_change

ROOT = math.sqrt(2.0 / 3.0)
ITERATIONS = 100
RELATIVE = 1e-8    # Newton: the error after a step of 1e-8 is 1e-16
ABSOLUTE = 1e-14   # of the strain at which the trial stress would vanish: rounding of the yield function

STATE_NAMES = ("cpi11-1", "cpi22-1", "cpi33-1", "cpi12", "cpi13", "cpi23", "plastic_strain")

PARAMETERS = (*ELASTIC_PARAMETERS,
              LawParameter("yield_stress", "MPa", "initial yield stress", default=200.0, null=math.inf, sooner=0.6))
ALTERNATIVES = ELASTIC_ALTERNATIVES


@njit
def shear_and_bulk(E, nu):
    """G and kappa of E and nu."""
    return 0.5 * E / (1.0 + nu), E / (3.0 * (1.0 - 2.0 * nu))


@njit
def plastic_multiplier(kind, trial, stiffness, p, params):
    """Root x >= 0 of trial - stiffness x - sqrt(2/3) sigma(p + sqrt(2/3) x), all real; -1 where there is none.

    Newton from the middle, bracketed by [0, trial/stiffness] (where no stress would be left): safe for an infinite
    initial slope (power law) and for softening.
    """
    low, high = 0.0, trial / stiffness
    x = 0.5 * (trial - ROOT * flow_stress(kind, p, params)[0].real) / stiffness
    for _ in range(ITERATIONS):
        flow, slope = flow_stress(kind, p + ROOT * x, params)
        excess = trial - stiffness * x - ROOT * flow.real
        if excess > 0.0:
            low = x
        else:
            high = x
        new = x + excess / (stiffness + 2.0 / 3.0 * slope.real)
        converged = abs(new - x) <= RELATIVE * x
        if not low <= new <= high:
            new, converged = 0.5 * (low + high), False
        if converged or abs(new - x) <= ABSOLUTE * trial / stiffness:
            return new if new < (1.0 - 1e-10) * trial / stiffness else -1.0  # no stress left: no strength left
        x = new
    return -1.0


@njit
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


@njit
def update(kind, F, state, params, P, state_new):
    """One point, real or complex."""
    G, kappa = shear_and_bulk(params[0], params[1])
    J, fi, b, mean, dev, norm, shrink = trial_state(F, state)
    if not J.real > 0.0:
        return 1
    p = state[6]
    keep = 1.0 + 0.0 * J
    pressure = kappa * (J - 1.0) * J
    for m in range(7):
        state_new[m] = state[m]
    if G.real * norm.real > ROOT * flow_stress(kind, p.real, params)[0].real:
        stiffness = 2.0 * G * mean
        real = plastic_multiplier(kind, G.real * norm.real, stiffness.real, p.real, params)
        if real < 0.0:
            return 1
        flow, slope = flow_stress(kind, p + ROOT * real, params)  # one more step, in complex: exact derivative
        excess = G * norm - stiffness * real - ROOT * flow
        x = real + excess / (stiffness.real + 2.0 / 3.0 * slope.real)
        keep = 1.0 - 2.0 * mean * x / norm
        scale = 1.0 / shrink
        c = tensors.congruence(fi, tensors.scaled(keep * scale, dev, mean * scale))
        state_new[0], state_new[1], state_new[2] = c[0] - 1.0, c[1] - 1.0, c[2] - 1.0
        state_new[3], state_new[4], state_new[5] = c[3], c[4], c[5]
        state_new[6] = p + ROOT * x
    tau = tensors.scaled(keep * G, dev, pressure)
    tensors.store(tensors.times_transposed(tau, fi), P)
    return 0


@njit
def linearise(kind, F, state, params, dF, dstate, dparams, P, state_new, dP, dstate_new):
    """`update` and its derivative along ``len(dF)`` directions, by hand (see `LawSpec.linearise`)."""
    G, kappa = shear_and_bulk(params[0], params[1])
    trial = trial_state(F, state)
    J, fi, b, mean, dev, norm, shrink = trial
    if not J > 0.0:
        return 1
    p = state[6]
    for m in range(7):
        state_new[m] = state[m]
    x, keep, inverse_slope = 0.0, 1.0, 0.0
    scale, plastic = 1.0 / shrink, G * norm > ROOT * flow_stress(kind, p, params)[0]
    if plastic:
        x = plastic_multiplier(kind, G * norm, 2.0 * G * mean, p, params)
        if x < 0.0:
            return 1
        keep = 1.0 - 2.0 * mean * x / norm
        state_new[6] = p + ROOT * x
        slope = flow_stress(kind, state_new[6], params)[1]
        inverse_slope = 1.0 / (2.0 * G * mean + 2.0 / 3.0 * slope)
        c = tensors.congruence(fi, tensors.scaled(keep * scale, dev, mean * scale))
        state_new[0], state_new[1], state_new[2] = c[0] - 1.0, c[1] - 1.0, c[2] - 1.0
        state_new[3], state_new[4], state_new[5] = c[3], c[4], c[5]
    tau = tensors.scaled(keep * G, dev, kappa * (J - 1.0) * J)
    tensors.store(tensors.times_transposed(tau, fi), P)
    solution = (plastic, x, keep, inverse_slope, slope if plastic else 0.0, scale, tau)
    for k in range(dF.shape[0]):
        dG, dkappa, dflow, dp = 0.0, 0.0, 0.0, 0.0
        if dparams.shape[0] > 0:
            dG, dkappa = elastic_change(params, dparams[k])
            if plastic:
                dflow = flow_stress_change(kind, state_new[6], params, dparams[k])
        if dstate.shape[0] > 0:
            dp = dstate[k, 6]
        explicit = (G, kappa, dG, dkappa, dflow, dp)
        one_direction(F, trial, solution, explicit, k, dF, dstate, dP, dstate_new)
    return 0


@njit
def elastic_change(params, d):
    """Change of G and kappa with E and nu."""
    G, kappa = shear_and_bulk(params[0], params[1])
    return (G / params[0] * d[0] - G / (1.0 + params[1]) * d[1],
            kappa / params[0] * d[0] + 2.0 * kappa / (1.0 - 2.0 * params[1]) * d[1])


@njit
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
        after = tensors.scaled(keep, dev, mean)
        dafter = tensors.combine(dkeep, dev, keep, ddev, dmean)
        dafter = tensors.combine(1.0, dafter, -1.0, tensors.twice_symmetric(ell, after), 0.0)
        dafter = tensors.combine(scale, dafter, 2.0 / 3.0 * t * scale, after, 0.0)
        dc = tensors.congruence(fi, dafter)
        for m in range(6):
            dstate_new[k, m] = dc[m]
    else:
        for m in range(6):
            dstate_new[k, m] = dstate[k, m] if dstate.shape[0] > 0 else 0.0
    dstate_new[k, 6] = dp + ROOT * dx
