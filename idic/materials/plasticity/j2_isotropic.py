"""J2 plasticity at finite strain with isotropic hardening: five laws, which differ in their flow stress sigma(p).

    j2_linear             sigma = yield_stress + hardening_modulus p
    j2_voce               sigma = yield_stress + Q (1 - exp(-b p)) + hardening_modulus p     (Voce 1948)
    j2_power              sigma = yield_stress + K p^n                                       (Ludwik 1909)
    j2_power_reference    sigma = yield_stress + K0 (p / ep0)^n                              (K = K0 ep0^-n)
    j2_swift              sigma = K (eps0 + p)^n                                             (yields first at K eps0^n)

p is the equivalent plastic strain. The split, the trial state and the symbols are those of ``elastoplastic.py``; the
radial return (Simo, Comput. Methods Appl. Mech. Eng. 99 (1992) 61, doi:10.1016/0045-7825(92)90123-2) solves

    |s| - 2 G I x - sqrt(2/3) sigma(p + sqrt(2/3) x) = 0   where   |s| - sqrt(2/3) sigma(p) > 0.

``j2_power_reference`` serves tests at small strain. K is the stress that hardening would add at a plastic strain of 1;
where a test ends at less than 1 %, K and n cannot be told apart (correlation 0.999), while K0, the stress added at a
strain ep0 of the test, can be. ep0 is chosen, not identified: K0 and n follow it without any change of the curve.
"""

from __future__ import annotations

import math

import numpy as np

from idic.materials.core import tensors
from idic.materials.core.inner import inner
from idic.materials.core.law import DerivedQuantity, LawParameter, LawSpec, register
from idic.materials.elastic import ELASTIC_PARAMETERS
from idic.materials.plasticity.elastoplastic import (
    ABSOLUTE_TOLERANCE, ALTERNATIVES, MAX_ITERATIONS, PARAMETERS, RELATIVE_TOLERANCE, ROOT, STATE_NAMES, cp_after,
    elastic_change, one_direction, shear_and_bulk, trial_state)

LINEAR, VOCE, POWER, SWIFT, POWER_REFERENCE = 0, 1, 2, 3, 4  # kinds of hardening: a constant in the code of each law


@inner
def flow_stress(kind, p, params):
    """(sigma, d sigma/dp) at p, real or complex; the parameters start at index 2, behind E and nu.

    The power law's slope at p = 0, infinite for n < 1, is returned as 0: it is not used.
    """
    sigma, slope = params[2] + 0.0 * p, 0.0 * p + 0.0 * params[3]
    if kind == LINEAR:  # yield_stress, hardening_modulus
        sigma += params[3] * p
        slope += params[3]
    elif kind == VOCE:  # yield_stress, Q, b, hardening_modulus
        decay = np.exp(-params[4] * p)
        sigma += params[3] * (1.0 - decay) + params[5] * p
        slope += params[3] * params[4] * decay + params[5]
    elif kind == SWIFT:  # K, eps0, n: K eps0^n takes the place of a yield stress
        base = params[3] + p
        power = params[2] * base ** params[4]
        sigma = power
        if base.real > 0.0:  # with eps0 = 0 the slope at p = 0 is infinite, as the power law's
            slope += params[4] * power / base
    elif p.real > 0.0 and kind == POWER_REFERENCE:  # yield_stress, K0, n, ep0
        power = params[3] * (p / params[5]) ** params[4]
        sigma += power
        slope += params[4] * power / p
    elif p.real > 0.0:  # yield_stress, K, n
        power = params[3] * p ** params[4]
        sigma += power
        slope += params[4] * power / p
    return sigma, slope


@inner
def flow_stress_change(kind, p, params, d):
    """Change of sigma with the parameters at fixed p; real."""
    change = d[2]
    if kind == SWIFT:
        base = params[3] + p
        power = base ** params[4]
        change = power * d[2] + params[2] * power * (params[4] / base * d[3] + math.log(base) * d[4])
    elif kind == LINEAR:
        change += p * d[3]
    elif kind == VOCE:
        decay = math.exp(-params[4] * p)
        change += (1.0 - decay) * d[3] + params[3] * p * decay * d[4] + p * d[5]
    elif p > 0.0 and kind == POWER_REFERENCE:
        power = (p / params[5]) ** params[4]
        change += power * d[3] + params[3] * power * (math.log(p / params[5]) * d[4] - params[4] / params[5] * d[5])
    elif p > 0.0:
        power = p ** params[4]
        change += power * d[3] + params[3] * power * math.log(p) * d[4]
    return change


@inner
def plastic_multiplier(kind, trial, stiffness, p, params):
    """Root x >= 0 of trial - stiffness x - sqrt(2/3) sigma(p + sqrt(2/3) x), all real; -1 where there is none.

    Newton from the middle, bracketed by [0, trial/stiffness] (where no stress would be left): safe for an infinite
    initial slope (power law) and for softening.
    """
    low, high = 0.0, trial / stiffness
    x = 0.5 * (trial - ROOT * flow_stress(kind, p, params)[0].real) / stiffness
    for _ in range(MAX_ITERATIONS):
        flow, slope = flow_stress(kind, p + ROOT * x, params)
        excess = trial - stiffness * x - ROOT * flow.real
        if excess > 0.0:
            low = x
        else:
            high = x
        new = x + excess / (stiffness + 2.0 / 3.0 * slope.real)
        converged = abs(new - x) <= RELATIVE_TOLERANCE * x
        if not low <= new <= high:
            new, converged = 0.5 * (low + high), False
        if converged or abs(new - x) <= ABSOLUTE_TOLERANCE * trial / stiffness:
            return new if new < (1.0 - 1e-10) * trial / stiffness else -1.0  # no stress left: no strength left
        x = new
    return -1.0


@inner
def update_by_return(kind, F, state, params, P, state_new):
    """One point of a law with this hardening, real or complex."""
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
        cp_after(fi, keep, mean, dev, 1.0 / shrink, state_new)
        state_new[6] = p + ROOT * x
    tau = tensors.scaled(keep * G, dev, pressure)
    tensors.store(tensors.times_transposed(tau, fi), P)
    return 0


@inner
def linearise_by_return(kind, F, state, params, dF, dstate, dparams, P, state_new, dP, dstate_new):
    """`update_by_return` and its derivative along ``len(dF)`` directions, by hand (see `LawSpec.linearise`)."""
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
        cp_after(fi, keep, mean, dev, scale, state_new)
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


def isotropic_law(kind: int, name: str, parameters: tuple[LawParameter, ...], flow: str, **others) -> LawSpec:
    """Register the law whose flow stress is of this kind."""

    def update(F, state, params, dt, P, state_new):
        return update_by_return(kind, F, state, params, P, state_new)

    def linearise(F, state, params, dt, dF, dstate, dparams, P, state_new, dP, dstate_new):
        return linearise_by_return(kind, F, state, params, dF, dstate, dparams, P, state_new, dP, dstate_new)

    return register(LawSpec(
        name=name, parameters=parameters, updates={"finite": update}, linearise={"finite": linearise},
        state_names=STATE_NAMES, alternatives=ALTERNATIVES,
        reference=f"{flow}; return: Simo (1992), doi:10.1016/0045-7825(92)90123-2", **others))


def _hardening_modulus(description: str, default: float) -> LawParameter:
    return LawParameter("hardening_modulus", "MPa", description, default=default, null=0.0, positive=False,
                        bounds=(-np.inf, np.inf))


HARDENING_MODULUS = _hardening_modulus("slope of the flow stress over plastic strain", 1000.0)
VOCE_PARAMETERS = (
    LawParameter("Q", "MPa", "saturation of the hardening", default=100.0, null=0.0, positive=False,
                 bounds=(-np.inf, np.inf)),
    LawParameter("b", "-", "rate of the saturation over plastic strain", default=20.0, null=0.0),
    _hardening_modulus("final slope of the flow stress over plastic strain", 200.0))
EXPONENT = LawParameter("n", "-", "exponent of the power law", default=0.3, bounds=(0.0, 5.0))


def factor_at_one(K0, n, ep0):
    """K of ``j2_power``."""
    return K0 * ep0**-n


isotropic_law(LINEAR, "j2_linear", (*PARAMETERS, HARDENING_MODULUS), "sigma = yield_stress + hardening_modulus p")

isotropic_law(VOCE, "j2_voce", (*PARAMETERS, *VOCE_PARAMETERS),
              "sigma = yield_stress + Q (1 - exp(-b p)) + hardening_modulus p; Voce (1948)")

isotropic_law(POWER, "j2_power",
              (*PARAMETERS, LawParameter("K", "MPa", "factor of the power law", default=300.0, null=0.0), EXPONENT),
              "sigma = yield_stress + K p^n (Ludwik 1909)")

isotropic_law(POWER_REFERENCE, "j2_power_reference",
              (*PARAMETERS,
               LawParameter("K0", "MPa", "hardening stress at the plastic strain ep0", default=50.0, null=0.0),
               EXPONENT,
               LawParameter("ep0", "-", "plastic strain at which K0 is added; about half the largest of the test, "
                                         "locked",
                            default=2e-3)),
              "sigma = yield_stress + K0 (p / ep0)^n (Ludwik 1909)",
              derived={"K": DerivedQuantity("MPa", factor_at_one)})

isotropic_law(SWIFT, "j2_swift",
              (*ELASTIC_PARAMETERS,
               LawParameter("K", "MPa", "flow stress where eps0 + plastic strain is 1", default=500.0, null=math.inf),
               LawParameter("eps0", "-", "pre-strain; the initial yield stress is K eps0^n", default=0.01,
                            bounds=(0.0, 1.0)),
               LawParameter("n", "-", "exponent (0: no hardening, sigma = K)", default=0.2, null=0.0,
                            bounds=(0.0, 5.0))),
              "sigma = K (eps0 + p)^n; Swift, J. Mech. Phys. Solids 1 (1952) 1, doi:10.1016/0022-5096(52)90002-1")
