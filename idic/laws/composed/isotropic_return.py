"""The return of a composed law whose flow is along the deviator of the stress: Mises or Drucker-Prager, no back stress.

With q the Mises stress of the trial state (symbols of ``plasticity/elastoplastic.py``), the growth of p solves

    q - 3 G I growth - resistance(p + growth, growth / dt) = 0,   x = sqrt(3/2) growth

``surface`` is the kind and the place of its first parameter. Drucker-Prager adds friction * pressure to the flow
stress: yield_stress is the Mises stress at yield in pure shear, tension yields at yield_stress / (1 + friction / 3),
compression at yield_stress / (1 - friction / 3). Flow is along the deviator (measured dilation is far below that of
the associated rule: Spitzig & Richmond, Acta Metall. 32 (1984) 457, doi:10.1016/0001-6160(84)90119-6), so the pressure
is known before the return, and where tension leaves no strength the deviator vanishes: a fluid under tension, which a
simulation will not pass through but the search for F33 may.
Derivatives are written by hand.
"""

from __future__ import annotations

import math


from idic.laws.composed.flow_stress import (
    NONE,
    flow_stress,
    most_growth,
    resistance,
    resistance_change,
    straight,
    without_viscosity,
)
from idic.laws.core import tensors
from idic.laws.core.inner import inner
from idic.laws.plasticity.elastoplastic import (
    ABSOLUTE_TOLERANCE,
    MAX_ITERATIONS,
    RELATIVE_TOLERANCE,
    ROOT,
    closed_tangent,
    cp_after,
    elastic_change,
    one_direction,
    shear_and_bulk,
    trial_state,
)

MISES, DRUCKER_PRAGER, HILL48, IN_PLANE_SHEAR = 0, 1, 2, 3


@inner
def plastic_growth(hardening, rate, trial, stiffness, p, dt, friction_stress, params):
    """Root of trial - stiffness growth - resistance, all real; -1 without one, -2 where no strength is left.

    Newton inside a shrinking bracket, from the middle: safe for an infinite slope (power laws) and for softening.
    """
    largest = trial / stiffness
    sigma, start_slope = flow_stress(hardening, p, params)
    sigma += friction_stress
    if flow_stress(hardening, p + largest, params)[0] + friction_stress <= 0.0:
        return -2.0
    if straight(hardening, rate):
        x = (trial - sigma) / (stiffness + start_slope)
        return x if 0.0 < x < (1.0 - 1e-10) * largest else -1.0
    limit = max(most_growth(hardening, rate, trial, p, sigma, dt, params), ABSOLUTE_TOLERANCE * largest)
    low, high = 0.0, min(largest, limit)
    x = 0.5 * min((trial - sigma) / stiffness, high)
    for _ in range(MAX_ITERATIONS):
        flow, slope, _ = resistance(hardening, rate, p, x, dt, friction_stress, params)
        excess = trial - stiffness * x - flow
        if excess > 0.0:
            low = x
        else:
            high = x
        next_growth = x + excess / (stiffness + slope)
        converged = abs(next_growth - x) <= RELATIVE_TOLERANCE * x
        if not low <= next_growth <= high:
            next_growth, converged = 0.5 * (low + high), False
        if converged or abs(next_growth - x) <= ABSOLUTE_TOLERANCE * largest:
            return next_growth if next_growth < (1.0 - 1e-10) * largest else -1.0
        x = next_growth
    return -1.0


@inner
def friction_of(surface, spherical, params):
    """friction * pressure, what Drucker and Prager add to the flow stress."""
    return -params[surface[1]] * spherical if surface[0] == DRUCKER_PRAGER else 0.0 * spherical


@inner
def flows(hardening, rate, trial, p, dt, friction_stress, params):
    """Whether the trial state is beyond yield, and time, or no viscosity, lets it flow; all real."""
    return trial > flow_stress(hardening, p, params)[0] + friction_stress and (
        dt > 0.0 or without_viscosity(rate, params))


@inner
def update(surface, hardening, rate, F, state, params, dt, P, state_new):
    """One point, real or complex."""
    G, kappa = shear_and_bulk(params[0], params[1])
    J, fi, b, mean, dev, norm, shrink = trial_state(F, state)
    if not J.real > 0.0:
        return 1
    p, real_params = state[6], params.real
    keep = 1.0 + 0.0 * J
    spherical = kappa * (J - 1.0) * J
    friction_stress = friction_of(surface, spherical, params)
    for m in range(7):
        state_new[m] = state[m]
    trial, stiffness = G * norm / ROOT, 3.0 * G * mean
    if flows(hardening, rate, trial.real, p.real, dt, friction_stress.real, real_params):
        real = plastic_growth(hardening, rate, trial.real, stiffness.real, p.real, dt, friction_stress.real,
                              real_params)
        if real == -1.0 or (real < 0.0 and surface[0] != DRUCKER_PRAGER):
            return 1
        if real < 0.0:
            growth, keep = trial / stiffness, 0.0 * keep
        else:  # one more step, in complex: exact derivative
            flow, slope, _ = resistance(hardening, rate, p, real + 0.0 * p, dt, friction_stress, params)
            growth = real + (trial - stiffness * real - flow) / (stiffness.real + slope.real)
            keep = 1.0 - 2.0 * mean / ROOT * growth / norm
        cp_after(fi, keep, mean, dev, 1.0 / shrink, state_new)
        state_new[6] = p + growth
    tau = tensors.scaled(keep * G, dev, spherical)
    tensors.store(tensors.times_transposed(tau, fi), P)
    return 0


@inner
def real_return(surface, hardening, rate, F, state, params, dt, P, state_new):
    """One point, real, with what its derivatives take: (status, trial state, solution, values), see `linearise`."""
    G, kappa = shear_and_bulk(params[0], params[1])
    point = trial_state(F, state)
    J, fi, b, mean, dev, norm, shrink = point
    p = state[6]
    growth, keep, inverse_slope, slope, strong = 0.0, 1.0, 0.0, 0.0, True
    trial, stiffness, spherical = G * norm / ROOT, 3.0 * G * mean, kappa * (J - 1.0) * J
    friction_stress = friction_of(surface, spherical, params)
    for m in range(7):
        state_new[m] = state[m]
    plastic = J > 0.0 and flows(hardening, rate, trial, p, dt, friction_stress, params)
    if plastic:
        growth = plastic_growth(hardening, rate, trial, stiffness, p, dt, friction_stress, params)
        if growth == -1.0 or (growth < 0.0 and surface[0] != DRUCKER_PRAGER):
            return 1, point, (plastic, growth, keep, inverse_slope), (spherical, friction_stress, slope, strong)
        strong = growth >= 0.0
        if strong:
            _, total, slope = resistance(hardening, rate, p, growth, dt, friction_stress, params)
            inverse_slope = 1.0 / (2.0 / 3.0 * (stiffness + total))
            keep = 1.0 - 2.0 * mean / ROOT * growth / norm
        else:
            growth, keep, inverse_slope = trial / stiffness, 0.0, 1.5 / stiffness
        cp_after(fi, keep, mean, dev, 1.0 / shrink, state_new)
        state_new[6] = p + growth
    tensors.store(tensors.times_transposed(tensors.scaled(keep * G, dev, spherical), fi), P)
    return (0 if J > 0.0 else 1), point, (plastic, growth, keep, inverse_slope), (spherical, friction_stress, slope,
                                                                                 strong)


@inner
def tangent(surface, hardening, rate, F, state, params, dt, P, state_new, A):
    """`update` and dP/dF in closed form."""
    status, point, solution, values = real_return(surface, hardening, rate, F, state, params, dt, P, state_new)
    if status != 0:
        return 1
    plastic, growth, keep, inverse_slope = solution
    G, kappa = shear_and_bulk(params[0], params[1])
    flow_by_volume = 0.0
    if surface[0] == DRUCKER_PRAGER and plastic and values[3]:
        J = point[0]
        flow_by_volume = -params[surface[1]] * kappa * (2.0 * J - 1.0) * J * rate_factor(
            hardening, rate, state[6], growth, dt, values[1], params)
    closed_tangent(state, point, (plastic, growth / ROOT, keep, inverse_slope), (G, kappa), flow_by_volume, A)
    return 0


@inner
def linearise(surface, hardening, rate, F, state, params, dt, dF, dstate, dparams, P, state_new, dP, dstate_new):
    """`update` and its derivative (see `LawSpec.linearise`)."""
    status, point, solution, values = real_return(surface, hardening, rate, F, state, params, dt, P, state_new)
    if status != 0:
        return 1
    G, kappa = shear_and_bulk(params[0], params[1])
    J, fi, b, mean, dev, norm, shrink = point
    plastic, growth, keep, inverse_slope = solution
    spherical, friction_stress, slope, strong = values
    p, tau = state[6], tensors.scaled(keep * G, dev, spherical)
    solved = (plastic, growth / ROOT, keep, inverse_slope, slope, 1.0 / shrink, tau)
    none = params[:0]
    for k in range(dF.shape[0]):
        dG, dkappa, dflow, dp, dfriction_stress = 0.0, 0.0, 0.0, 0.0, 0.0
        dparam = dparams[k] if dparams.shape[0] > 0 else none
        if dparam.shape[0] > 0:
            dG, dkappa = elastic_change(params, dparam)
        if plastic and strong:
            if surface[0] == DRUCKER_PRAGER:
                ell = tensors.product(tensors.load(dF[k]), fi)
                change = kappa * (2.0 * J - 1.0) * J * (ell[0] + ell[4] + ell[8]) + dkappa * (J - 1.0) * J
                dfriction_stress = -params[surface[1]] * change - (
                    dparam[surface[1]] * spherical if dparam.shape[0] > 0 else 0.0)
            if dparam.shape[0] > 0:
                dflow = resistance_change(hardening, rate, state_new[6], growth, dt, friction_stress, params, dparam,
                                          dfriction_stress)
            elif surface[0] == DRUCKER_PRAGER:
                dflow = dfriction_stress * rate_factor(hardening, rate, p, growth, dt, friction_stress, params)
        if dstate.shape[0] > 0:
            dp = dstate[k, 6]
        one_direction(F, point, solved, (G, kappa, dG, dkappa, dflow, dp), k, dF, dstate, dP, dstate_new)
    return 0


@inner
def rate_factor(hardening, rate, p, growth, dt, friction_stress, params):
    """Derivative of the resistance by the flow stress: it is linear in it, and 1 MPa more shows the factor."""
    if rate[0] == NONE:
        return 1.0
    more = resistance(hardening, rate, p, growth, dt, friction_stress + 1.0, params)[0]
    return more - resistance(hardening, rate, p, growth, dt, friction_stress, params)[0] if math.isfinite(more) else 1.0
