"""The flow stress of a composed law: a sum of hardening terms, and its dependence on the rate of plastic strain.

    sigma(p) = yield_stress + sum of   H p   |   Q (1 - exp(-b p))   |   K p^n   |   K0 (p / ep0)^n
                                     |   K (eps0 + p)^n - yield_stress   |   s(p) - yield_stress
                                     |   H max(p - length, 0)  (a plateau of length)
    resistance = sigma(p) + eta (dp/dt)^(1/m)                       (norton)
               = sigma(p) (1 + (tau dp/dt)^(1/m))                   (perzyna)
               = sigma(p) (1 + C ln(1 + (dp/dt) / reference_rate))  (johnson_cook)

Swift's K (eps0 + p)^n takes the place of the yield stress: K stands where yield_stress stands in other laws. s of a
free curve is linear between its values yield_stress, s2 ... sn at the knots range ((k - 1) / (n - 1))^2, and beyond the
last; a value below the previous one is replaced by that one, so that the curve never falls. Terms come as a flat tuple
of integers (kind, place of its first parameter, kind, place, ..., NONE, 0): a constant in the code of each combination.
dp/dt is growth / dt, backward Euler.
"""

from __future__ import annotations

import math

import numpy as np

from idic.laws.composed.on_knots import on_knots, on_knots_change
from idic.laws.core.inner import inner

NONE, LINEAR, VOCE, POWER, SWIFT, POWER_REFERENCE, PLATEAU, FREE = 0, 1, 2, 3, 4, 5, 6, 16  # n free knots: FREE + n
NORTON, PERZYNA, JOHNSON_COOK = 1, 2, 3
YIELD = 2


@inner
def flow_stress(hardening, p, params):
    """(sigma, d sigma/dp) at p, real or complex; infinite slopes of power laws at p = 0 are returned as 0: not used."""
    sigma, slope = params[YIELD] + 0.0 * p, 0.0 * p + 0.0 * params[YIELD]
    for i in range(0, len(hardening) - 2, 2):
        kind, first = hardening[i], hardening[i + 1]
        if kind == LINEAR:  # H
            sigma += params[first] * p
            slope += params[first]
        elif kind == VOCE:  # Q, b
            decay = np.exp(-params[first + 1] * p)
            sigma += params[first] * (1.0 - decay)
            slope += params[first] * params[first + 1] * decay
        elif kind == PLATEAU:  # H, length
            if p.real > params[first + 1].real:
                sigma += params[first] * (p - params[first + 1])
                slope += params[first]
        elif kind >= FREE:  # range, s2 ... sn
            value, theta = on_knots(kind - FREE, first, YIELD, first + 1, True, p, params)
            sigma += value - params[YIELD]
            slope += theta
        elif kind == SWIFT:  # K in the place of the yield stress, eps0, n
            base = params[first + 1] + p
            power = params[first] * base ** params[first + 2]
            sigma += power - params[YIELD]
            if base.real > 0.0:
                slope += params[first + 2] * power / base
        elif p.real > 0.0 and kind == POWER_REFERENCE:  # K0, n, ep0
            power = params[first] * (p / params[first + 2]) ** params[first + 1]
            sigma += power
            slope += params[first + 1] * power / p
        elif p.real > 0.0:  # K, n
            power = params[first] * p ** params[first + 1]
            sigma += power
            slope += params[first + 1] * power / p
    return sigma, slope


@inner
def flow_stress_change(hardening, p, params, d):
    """Change of sigma with the parameters at fixed p; real."""
    change = d[YIELD]
    for i in range(0, len(hardening) - 2, 2):
        kind, first = hardening[i], hardening[i + 1]
        if kind == LINEAR:
            change += p * d[first]
        elif kind == VOCE:
            decay = math.exp(-params[first + 1] * p)
            change += (1.0 - decay) * d[first] + params[first] * p * decay * d[first + 1]
        elif kind == PLATEAU:
            if p > params[first + 1]:
                change += (p - params[first + 1]) * d[first] - params[first] * d[first + 1]
        elif kind >= FREE:
            change += on_knots_change(kind - FREE, first, YIELD, first + 1, True, p, params, d) - d[YIELD]
        elif kind == SWIFT:
            base, n = params[first + 1] + p, params[first + 2]
            power = base ** n
            change += power * (d[first] + params[first] * (n / base * d[first + 1] + math.log(base) * d[first + 2])) \
                - d[YIELD]
        elif p > 0.0 and kind == POWER_REFERENCE:
            n, ep0 = params[first + 1], params[first + 2]
            change += (p / ep0) ** n * (d[first] + params[first] * (math.log(p / ep0) * d[first + 1]
                                                                    - n / ep0 * d[first + 2]))
        elif p > 0.0:
            change += p ** params[first + 1] * (d[first] + params[first] * math.log(p) * d[first + 1])
    return change


@inner
def resistance(hardening, rate, p, growth, dt, friction_stress, params):
    """(resistance, its slope over the growth of p, its slope over p at fixed growth) at p + growth, growth > 0."""
    sigma, slope = flow_stress(hardening, p + growth, params)
    sigma = sigma + friction_stress
    kind, first = rate[0], rate[1]
    if kind == NONE or without_viscosity(rate, params):
        return sigma, slope, slope
    if kind == JOHNSON_COOK:
        reference = params[first + 1] * dt
        factor, steepness = 1.0 + params[first] * np.log(1.0 + growth / reference), params[first] / (reference + growth)
        return sigma * factor, slope * factor + sigma * steepness, slope * factor
    exponent = 1.0 / params[first + 1]
    if kind == NORTON:
        over = params[first] * (growth / dt) ** exponent
        return sigma + over, slope + exponent * over / growth, slope
    over = (params[first] * growth / dt) ** exponent
    return sigma * (1.0 + over), slope * (1.0 + over) + sigma * exponent * over / growth, slope * (1.0 + over)


@inner
def resistance_change(hardening, rate, p, growth, dt, friction_stress, params, d, dfriction_stress):
    """Change of the resistance with the parameters (and friction_stress) at fixed p (at the end) and growth; real."""
    dsigma = flow_stress_change(hardening, p, params, d) + dfriction_stress
    kind, first = rate[0], rate[1]
    if kind == NONE or without_viscosity(rate, params):
        return dsigma
    sigma = flow_stress(hardening, p, params)[0] + friction_stress
    if kind == JOHNSON_COOK:
        speed = growth / (params[first + 1] * dt)
        return dsigma * (1.0 + params[first] * math.log(1.0 + speed)) + sigma * (
            math.log(1.0 + speed) * d[first] - params[first] * speed / (1.0 + speed) / params[first + 1] * d[first + 1])
    m = params[first + 1]
    if kind == NORTON:
        speed = growth / dt
        return dsigma + speed ** (1.0 / m) * (d[first] - params[first] * math.log(speed) / (m * m) * d[first + 1])
    speed = params[first] * growth / dt
    over = speed ** (1.0 / m)
    return dsigma * (1.0 + over) + sigma * over * (d[first] / (m * params[first])
                                                   - math.log(speed) / (m * m) * d[first + 1])


@inner
def straight(hardening, rate):
    """Whether the resistance is linear in the growth: one Newton step is exact."""
    for i in range(0, len(hardening) - 2, 2):
        if hardening[i] != LINEAR:
            return False
    return rate[0] == NONE


@inner
def without_viscosity(rate, params):
    """Whether the rate has no effect: its first parameter is zero."""
    return rate[0] == NONE or params[rate[1]].real == 0.0


@inner
def weakest(hardening, p, sigma, params):
    """Lower bound of the flow stress, sigma at p, from there on; -inf where it falls without end; all real."""
    least = sigma
    for i in range(0, len(hardening) - 2, 2):
        kind, first = hardening[i], hardening[i + 1]
        if kind in (LINEAR, PLATEAU) and params[first] < 0.0:
            return -math.inf
        if kind == VOCE and params[first] < 0.0:
            least += params[first] * math.exp(-params[first + 1] * p)
    return least


@inner
def most_growth(hardening, rate, trial, p, sigma, dt, params):
    """Upper bound of the growth, at which the rate term alone balances a trial stress above sigma at p; all real."""
    if without_viscosity(rate, params):
        return math.inf
    kind, first = rate[0], rate[1]
    strength, rate_param = params[first], params[first + 1]
    if kind == NORTON:
        return dt * (trial / strength) ** rate_param
    least = weakest(hardening, p, sigma, params)
    if least < min(sigma, 1e-6 * trial):
        return math.inf  # softened away within the step: no bound
    base = max(least, 1e-6 * trial)
    if kind == JOHNSON_COOK:
        exponent = (trial / base - 1.0) / strength
        return rate_param * dt * math.expm1(exponent) if exponent < 500.0 else math.inf
    return dt / strength * (trial / base - 1.0) ** rate_param if trial > base else 0.0
