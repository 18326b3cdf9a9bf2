"""Isotropic hardening: flow stress over equivalent plastic strain p, for the ``j2_*`` laws.

One branch per law; ``kind`` is a constant in each law's file (functions passed as arguments would defeat the disk
cache). Parameters start at index 2, behind E and nu. Real or complex.

``POWER`` is Ludwik's form (``j2_power``), ``POWER_REFERENCE`` the same with p / ep0 for p (``j2_power_reference``);
``SWIFT`` has no separate yield stress: K eps0^n takes its place.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

LINEAR, VOCE, POWER, SWIFT, POWER_REFERENCE = 0, 1, 2, 3, 4


@njit
def flow_stress(kind, p, params):
    """(sigma, d sigma/dp). The power law's slope at p = 0, infinite for n < 1, is returned as 0: it is not used."""
    sigma, slope = params[2] + 0.0 * p, 0.0 * p + 0.0 * params[3]
    if kind == LINEAR:  # yield_stress, hardening_modulus
        sigma += params[3] * p
        slope += params[3]
    elif kind == VOCE:  # yield_stress, Q, b, hardening_modulus
        decay = np.exp(-params[4] * p)
        sigma += params[3] * (1.0 - decay) + params[5] * p
        slope += params[3] * params[4] * decay + params[5]
    elif kind == SWIFT:  # K, eps0, n
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


@njit
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
