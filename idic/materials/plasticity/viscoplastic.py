"""J2 viscoplasticity of Perzyna's kind: plastic flow at the rate (f / eta)^m, f the stress above the flow stress.

``j2_linear`` with the overstress eta (dp/dt)^(1/m) added to the flow stress, backward Euler in time:

    |s| - 2 G I x - sqrt(2/3) (sigma(p + dp) + eta (dp / dt)^(1/m)) = 0,  dp = sqrt(2/3) x

(symbols: ``elastoplastic.py``). The rate is counted in 1/s, so eta is in MPa s for every m: the overstress at 1/s.
With eta = 0 it is ``j2_linear``; with eta > 0 nothing flows where no time passes.
"""

from __future__ import annotations

import math


from idic.materials.core import tensors
from idic.materials.core.inner import inner
from idic.materials.core.law import LawParameter, LawSpec, register
from idic.materials.plasticity import elastoplastic
from idic.materials.plasticity.elastoplastic import ABSOLUTE_TOLERANCE, MAX_ITERATIONS, RELATIVE_TOLERANCE, ROOT
from idic.materials.plasticity.j2_isotropic import HARDENING_MODULUS, LINEAR, flow_stress, flow_stress_change

ETA, M = 4, 5


@inner
def overstress(growth, dt, params):
    """(eta (growth/dt)^(1/m), its slope over growth) of a growth > 0 of the plastic strain."""
    if params[ETA].real == 0.0 and not dt > 0.0:
        return 0.0 * growth, 0.0 * growth
    power = params[ETA] * (growth / dt) ** (1.0 / params[M])
    return power, power / (params[M] * growth)


@inner
def growth_of_strain(trial, stiffness, p, dt, params):
    """Root x > 0 of the equation at the top, all real; -1 where there is none. Newton inside a shrinking bracket.

    No more flows than the whole trial stress as overstress would drive, which is little in a short time.
    """
    low, high = 0.0, trial / stiffness
    beyond = trial - ROOT * flow_stress(LINEAR, p, params)[0].real
    x = 0.5 * beyond / stiffness
    if params[ETA].real > 0.0:
        m, eta, least = params[M].real, ROOT * params[ETA].real, ABSOLUTE_TOLERANCE * high
        high = min(high, max(dt / ROOT * (trial / eta) ** m, least))
        x = min(x, max(dt / ROOT * (beyond / eta) ** m, 0.5 * least))
    for _ in range(MAX_ITERATIONS):
        flow, slope = flow_stress(LINEAR, p + ROOT * x, params)
        over, steepness = overstress(ROOT * x, dt, params)
        excess = trial - stiffness * x - ROOT * (flow.real + over.real)
        if excess > 0.0:
            low = x
        else:
            high = x
        new = x + excess / (stiffness + 2.0 / 3.0 * (slope.real + steepness.real))
        converged = abs(new - x) <= RELATIVE_TOLERANCE * x
        if not low < new <= high:
            new, converged = 0.5 * (low + high), False
        if converged or abs(new - x) <= ABSOLUTE_TOLERANCE * trial / stiffness:
            strong = flow_stress(LINEAR, p + ROOT * new, params)[0].real > 0.0  # else softened away
            return new if strong and new < (1.0 - 1e-10) * trial / stiffness else -1.0
        x = new
    return -1.0


@inner
def flows(G, norm, p, dt, params):
    """Whether the trial state is beyond yield and time, or no viscosity, lets it flow."""
    beyond = G.real * norm.real > ROOT * flow_stress(LINEAR, p.real, params)[0].real
    return beyond and (dt > 0.0 or params[ETA].real == 0.0)


def update(F, state, params, dt, P, state_new):
    """One point, real or complex."""
    G, kappa = elastoplastic.shear_and_bulk(params[0], params[1])
    J, fi, b, mean, dev, norm, shrink = elastoplastic.trial_state(F, state)
    if not J.real > 0.0:
        return 1
    p = state[6]
    keep = 1.0 + 0.0 * J
    for m in range(7):
        state_new[m] = state[m]
    if flows(G, norm, p, dt, params):
        stiffness = 2.0 * G * mean
        real = growth_of_strain(G.real * norm.real, stiffness.real, p.real, dt, params)
        if real < 0.0:
            return 1
        flow, slope = flow_stress(LINEAR, p + ROOT * real, params)  # one more step, in complex: exact derivative
        over, steepness = overstress(ROOT * real + 0.0 * p, dt, params)
        excess = G * norm - stiffness * real - ROOT * (flow + over)
        x = real + excess / (stiffness.real + 2.0 / 3.0 * (slope.real + steepness.real))
        keep = 1.0 - 2.0 * mean * x / norm
        elastoplastic.cp_after(fi, keep, mean, dev, 1.0 / shrink, state_new)
        state_new[6] = p + ROOT * x
    tau = tensors.scaled(keep * G, dev, kappa * (J - 1.0) * J)
    tensors.store(tensors.times_transposed(tau, fi), P)
    return 0


def linearise(F, state, params, dt, dF, dstate, dparams, P, state_new, dP, dstate_new):
    """`update` and its derivative (as ``j2_isotropic.py``)."""
    G, kappa = elastoplastic.shear_and_bulk(params[0], params[1])
    trial = elastoplastic.trial_state(F, state)
    J, fi, b, mean, dev, norm, shrink = trial
    if not J > 0.0:
        return 1
    p = state[6]
    for m in range(7):
        state_new[m] = state[m]
    x, keep, inverse_slope, slope, scale = 0.0, 1.0, 0.0, 0.0, 1.0 / shrink
    plastic = flows(G, norm, p, dt, params)
    if plastic:
        x = growth_of_strain(G * norm, 2.0 * G * mean, p, dt, params)
        if x < 0.0:
            return 1
        keep = 1.0 - 2.0 * mean * x / norm
        slope = flow_stress(LINEAR, p + ROOT * x, params)[1]
        inverse_slope = 1.0 / (2.0 * G * mean + 2.0 / 3.0 * (slope + overstress(ROOT * x, dt, params)[1]))
        elastoplastic.cp_after(fi, keep, mean, dev, scale, state_new)
        state_new[6] = p + ROOT * x
    tau = tensors.scaled(keep * G, dev, kappa * (J - 1.0) * J)
    tensors.store(tensors.times_transposed(tau, fi), P)
    solution = (plastic, x, keep, inverse_slope, slope, scale, tau)
    for k in range(dF.shape[0]):
        dG, dkappa, dflow, dp = 0.0, 0.0, 0.0, 0.0
        if dparams.shape[0] > 0:
            dG, dkappa = elastoplastic.elastic_change(params, dparams[k])
            if plastic:
                dflow = flow_stress_change(LINEAR, state_new[6], params, dparams[k]) \
                    + overstress_change(ROOT * x, dt, params, dparams[k])
        if dstate.shape[0] > 0:
            dp = dstate[k, 6]
        elastoplastic.one_direction(F, trial, solution, (G, kappa, dG, dkappa, dflow, dp), k, dF, dstate,
                                    dP, dstate_new)
    return 0


@inner
def overstress_change(growth, dt, params, d):
    """Change of the overstress with eta and m at fixed growth; real."""
    if not dt > 0.0:
        return 0.0
    power = (growth / dt) ** (1.0 / params[M])
    return power * (d[ETA] - params[ETA] * math.log(growth / dt) / (params[M] * params[M]) * d[M])


LAW = register(LawSpec(
    name="viscoplastic",
    parameters=(
        *elastoplastic.PARAMETERS, HARDENING_MODULUS,
        LawParameter("eta", "MPa*s", "viscosity: the overstress at a plastic strain rate of 1/s", default=100.0,
                     null=0.0),
        LawParameter("m", "-", "rate exponent, overstress = eta rate^(1/m) with the rate in 1/s", default=3.0,
                     null=1.0, bounds=(0.1, 1000.0)),
    ),
    updates={"finite": update},
    linearise={"finite": linearise},
    state_names=elastoplastic.STATE_NAMES,
    reference="dp/dt = (f / eta)^m, f = Mises stress - (yield_stress + hardening_modulus p); Perzyna, Adv. Appl. "
              "Mech. 9 (1966) 243, doi:10.1016/S0065-2156(08)70009-7; return: Simo (1992), "
              "doi:10.1016/0045-7825(92)90123-2",
    alternatives=elastoplastic.ALTERNATIVES,
))
