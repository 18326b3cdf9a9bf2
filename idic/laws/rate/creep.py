"""Elasticity with stationary (Norton) creep at finite strain: flow at a rate that grows with a power of the stress.

    dp/dt = rate (q / stress)^n,   q the Mises stress, p the equivalent creep strain

as ``elastoplastic.py`` (symbols there) without a yield stress, backward Euler in time; the norm of the deviator after
the return, y = |s| - 2 G I x, solves

    sqrt(2/3) x = dt rate (sqrt(3/2) y / stress)^n

``stress`` is chosen, not identified: a stress of the test, at which ``rate`` is the creep rate. With rate = 0 it is the
elastic body of the plastic laws, and the rate enters linearly from there on.
"""

from __future__ import annotations

import math


from idic.laws.core import tensors
from idic.laws.core.inner import inner
from idic.laws.core.law import LawParameter, LawSpec, register
from idic.laws.elastic import ELASTIC_ALTERNATIVES, ELASTIC_PARAMETERS
from idic.laws.plasticity import elastoplastic
from idic.laws.plasticity.elastoplastic import MAX_ITERATIONS, RELATIVE_TOLERANCE, ROOT

RATE, N, STRESS = 2, 3, 4
MIN_RATE = 1e-200  # in place of a rate of zero, whose derivative is wanted


@inner
def creep_of(y, dt, params):
    """(creep strain of the step that a remaining deviator y drives, its slope over y)."""
    power = dt * params[RATE] * (y / (ROOT * params[STRESS])) ** params[N]
    return power, params[N] * power / y


@inner
def remaining(trial, stiffness, dt, params):
    """y > 0 of the equation at the top, all real; -1 where Newton does not converge.

    Convex and increasing in y: from above, Newton comes down without overshooting. It starts at the smaller of two
    bounds: the whole trial, and the value that alone would flow as much as the whole trial can.
    """
    y = trial
    if creep_of(y, dt, params)[0].real > ROOT * trial / stiffness:
        most = ROOT * trial / (stiffness * dt * params[RATE].real)
        y = min(y, ROOT * params[STRESS].real * most ** (1.0 / params[N].real))
    for _ in range(MAX_ITERATIONS):
        flow, slope = creep_of(y, dt, params)
        step = (flow.real - ROOT * (trial - y) / stiffness) / (slope.real + ROOT / stiffness)
        y = y - step
        if abs(step) <= RELATIVE_TOLERANCE * y:
            return y
    return -1.0


def update(F, state, params, dt, P, state_new):
    """One point, real or complex."""
    G, kappa = elastoplastic.shear_and_bulk(params[0], params[1])
    J, fi, b, mean, dev, norm, shrink = elastoplastic.trial_state(F, state)
    if not J.real > 0.0:
        return 1
    keep = 1.0 + 0.0 * J
    for m in range(7):
        state_new[m] = state[m]
    if dt > 0.0 and norm.real > 0.0:
        stiffness = 2.0 * G * mean
        real = remaining(G.real * norm.real, stiffness.real, dt, params)
        if not real > 0.0:
            return 1
        flow, slope = creep_of(real + 0.0 * norm, dt, params)  # one more step, in complex: exact derivative
        y = real + (ROOT * (G * norm - real) / stiffness - flow) / (slope.real + ROOT / stiffness.real)
        x = (G * norm - y) / stiffness
        keep = y / (G * norm)
        elastoplastic.cp_after(fi, keep, mean, dev, 1.0 / shrink, state_new)
        state_new[6] = state[6] + ROOT * x
    tau = tensors.scaled(keep * G, dev, kappa * (J - 1.0) * J)
    tensors.store(tensors.times_transposed(tau, fi), P)
    return 0


@inner
def real_step(F, state, params, dt, P, state_new):
    """One point, real: (status, trial state, (flowing, x, keep, inverse slope), (y, its slope))."""
    G, kappa = elastoplastic.shear_and_bulk(params[0], params[1])
    trial = elastoplastic.trial_state(F, state)
    J, fi, b, mean, dev, norm, shrink = trial
    for m in range(7):
        state_new[m] = state[m]
    flowing, x, keep, y, slope, inverse_slope = J > 0.0 and dt > 0.0 and norm > 0.0, 0.0, 1.0, 0.0, 0.0, 0.0
    if flowing:
        stiffness = 2.0 * G * mean
        y = remaining(G * norm, stiffness, dt, params)
        if not y > 0.0:
            return 1, trial, (flowing, x, keep, inverse_slope), (y, slope)
        slope = max(creep_of(y, dt, params)[1], MIN_RATE)
        x = (G * norm - y) / stiffness
        keep = y / (G * norm)
        inverse_slope = 1.0 / (stiffness + ROOT / slope)
        elastoplastic.cp_after(fi, keep, mean, dev, 1.0 / shrink, state_new)
        state_new[6] = state[6] + ROOT * x
    tensors.store(tensors.times_transposed(tensors.scaled(keep * G, dev, kappa * (J - 1.0) * J), fi), P)
    return (0 if J > 0.0 else 1), trial, (flowing, x, keep, inverse_slope), (y, slope)


def tangent(F, state, params, dt, P, state_new, A, work):
    """`update` and its tangent."""
    status, trial, solution, _ = real_step(F, state, params, dt, P, state_new)
    if status == 0:
        elastoplastic.closed_tangent(state, trial, solution, elastoplastic.shear_and_bulk(params[0], params[1]), 0.0, A)
    return status


def linearise(F, state, params, dt, dF, dstate, dparams, P, state_new, dP, dstate_new):
    """`update` and its derivative (as ``composed/isotropic_return.py``, with the creep law for the flow stress)."""
    status, trial, step, end = real_step(F, state, params, dt, P, state_new)
    if status != 0:
        return 1
    G, kappa = elastoplastic.shear_and_bulk(params[0], params[1])
    J, fi, b, mean, dev, norm, shrink = trial
    flowing, x, keep, inverse_slope = step
    y, slope = end
    tau = tensors.scaled(keep * G, dev, kappa * (J - 1.0) * J)
    solution = (flowing, x, keep, inverse_slope, 0.0, 1.0 / shrink, tau)
    for k in range(dF.shape[0]):
        dG, dkappa, dflow, dp = 0.0, 0.0, 0.0, 0.0
        if dparams.shape[0] > 0:
            dG, dkappa = elastoplastic.elastic_change(params, dparams[k])
            if flowing:
                dflow = -creep_change(y, dt, params, dparams[k]) / (ROOT * slope)
        if dstate.shape[0] > 0:
            dp = dstate[k, 6]
        elastoplastic.one_direction(F, trial, solution, (G, kappa, dG, dkappa, dflow, dp), k, dF, dstate,
                                    dP, dstate_new)
    return 0


@inner
def creep_change(y, dt, params, d):
    """Change of the step's creep strain with rate, n and stress at fixed y; real."""
    ratio = y / (ROOT * params[STRESS])
    power = dt * ratio ** params[N]
    return power * (d[RATE] + params[RATE] * (math.log(ratio) * d[N] - params[N] / params[STRESS] * d[STRESS]))


LAW = register(LawSpec(
    name="creep",
    parameters=(
        *ELASTIC_PARAMETERS,
        LawParameter("rate", "1/s", "creep strain rate at the reference stress", default=1e-3, null=0.0),
        LawParameter("n", "-", "stress exponent", default=4.0, null=1.0, bounds=(1.0, 50.0)),
        LawParameter("stress", "MPa", "reference stress, one of the test; locked", default=200.0),
    ),
    updates={"finite": update},
    linearise={"finite": linearise},
    tangents={"finite": tangent},
    state_names=(*elastoplastic.STATE_NAMES[:6], "creep_strain"),
    reference="dp/dt = rate (q / stress)^n, q the Mises stress; Norton, The Creep of Steel at High Temperatures "
              "(1929); return: Simo (1992), doi:10.1016/0045-7825(92)90123-2",
    alternatives=ELASTIC_ALTERNATIVES,
))
