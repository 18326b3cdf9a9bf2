"""Flow of the Eindhoven Glassy Polymer: one scalar equation per time step, and all derivatives of its root.

The step's unknown is x = G dt / eta, the new viscous strain Cp ~ Y = Cp_n + x Ct. With
T = Ct adj(Cp_n), U = Cp_n adj(Ct), D(x) = det Y = d0 + c1 x + c2 x² + x³ (c1 = tr T, c2 = tr U) the shear stress is

    tau = G sqrt(q),  q = D^(-4/3) tr[(dev T - x dev U)²] / 2,  gamma = gamma_n + x sqrt(q),

a formula without cancellation at small strain, and the step's equation, in logarithms because exp(S) reaches 5e11, is

    r(z) = z + ln eta0 + L(tau/tau0) + mu p/tau0 + S(gamma) - ln(G dt) = 0,  z = ln x,  L(s) = ln(s / sinh s)
    S(gamma) = Sa [(1 + (r0 e^gamma)^r1) / (1 + r0^r1)]^((r2-1)/r1)
"""

from __future__ import annotations

import math

import numpy as np

from idic.laws.core.inner import inner

SA, R0, R1, R2, TAU0, MU, KAPPA, G1, ETA0 = range(1, 10)  # places in the parameters; Gr, 0, does not flow

MIN_SHEAR = 1e-24  # floor of tr[(dev T - x dev U)²] over 1 + x²: the root of q keeps a derivative; 1e-12 of G
MAX_ITERATIONS = 200
MAX_LAST_STEP = 1e-8          # of z: Newton's next error is 1e-16 times the curvature, at most tau/tau0
MAX_Z = 150.0       # of z: x⁴ stays a number; beyond, nothing is left of the stress since z = 30
MAX_STEP = 8.0            # largest step of z


@inner
def sheared(norm, x):
    """Whether tr[(dev T - x dev U)²] is above its floor."""
    return norm > MIN_SHEAR * (1.0 + x * x)


@inner
def intensity(x, d0, c1, c2, n0, n1, n2):
    """(D, D^(1/3), D^(-4/3), q, dq/dx), with q not below its floor."""
    D = d0 + x * (c1 + x * (c2 + x))
    root = D ** (1.0 / 3.0)
    inverse = 1.0 / (D * root)
    norm, norm_x = n0 + x * (n1 + x * n2), n1 + 2.0 * x * n2
    if not sheared(norm.real, x.real):
        norm, norm_x = MIN_SHEAR * (1.0 + x * x) + 0.0 * norm, 2.0 * MIN_SHEAR * x + 0.0 * norm
    q = 0.5 * inverse * norm
    return D, root, inverse, q, 0.5 * inverse * norm_x - 4.0 / 3.0 * q * (c1 + x * (2.0 * c2 + 3.0 * x)) / D


@inner
def thinning(s):
    """(L, L'/s) of L(s) = ln(s / sinh s); a series below s = 0.1, where the term left out is 3e-17."""
    if s.real < 0.1:
        w = s * s
        return (-w * (1.0 / 6.0 - w * (1.0 / 180.0 - w * (1.0 / 2835.0 - w * (1.0 / 37800.0 - w / 467775.0)))),
                -1.0 / 3.0 + w * (1.0 / 45.0 - w * (2.0 / 945.0 - w * (1.0 / 4725.0 - w * (2.0 / 93555.0)))))
    if s.real > 20.0:  # exp(-2 s) < 5e-18
        return np.log(2.0 * s) - s, (1.0 / s - 1.0) / s
    decay = np.exp(-2.0 * s)
    return np.log(2.0 * s / (1.0 - decay)) - s, (1.0 / s - (1.0 + decay) / (1.0 - decay)) / s


@inner
def softplus(u):
    """(ln(1 + e^u), its slope), for any u without overflow."""
    if u.real > 0.0:
        decay = np.exp(-u)
        return u + np.log(1.0 + decay), 1.0 / (1.0 + decay)
    growth = np.exp(u)
    return np.log(1.0 + growth), growth / (1.0 + growth)


@inner
def softening(gamma, params):
    """(S, dS/dgamma)."""
    start = params[R1] * np.log(params[R0])
    value, slope = softplus(start + params[R1] * gamma)
    S = params[SA] * np.exp((params[R2] - 1.0) / params[R1] * (value - softplus(start)[0]))
    return S, S * (params[R2] - 1.0) * slope


@inner
def softening_change(gamma, S, params):
    """dS/d(Sa, r0, r1, r2) at fixed gamma; real."""
    r0, r1, less = params[R0], params[R1], params[R2] - 1.0
    log = math.log(r0)
    softplus_start, slope_before = softplus(r1 * log)
    softplus_end, slope = softplus(r1 * (log + gamma))
    grown = (softplus_end - softplus_start) / r1
    return (math.exp(less * grown), S * less * (slope - slope_before) / r0,
            S * less / r1 * (slope * (log + gamma) - slope_before * log - grown), S * grown)


@inner
def residual(z, x, invariants, gamma_n, constant, params):
    """(r, dr/dz, q, dq/dx, D, D^(1/3), D^(-4/3)); ``constant`` = ln eta0 + mu p/tau0 - ln(G dt)."""
    d0, c1, c2, n0, n1, n2 = invariants
    D, root, inverse, q, q_x = intensity(x, d0, c1, c2, n0, n1, n2)
    shear = np.sqrt(q)
    stiffness = params[G1] / params[TAU0]
    L, L_slope = thinning(stiffness * shear)
    S, S_slope = softening(gamma_n + x * shear, params)
    slope = 1.0 + x * (0.5 * L_slope * stiffness * stiffness * q_x + S_slope * (shear + 0.5 * x * q_x / shear))
    return z + constant + L + S, slope, q, q_x, D, root, inverse


@inner
def constant_part(J, dt, params):
    """The part of r that does not depend on z."""
    pressure = -params[KAPPA] * (J - 1.0)
    return np.log(params[ETA0] / params[G1]) - math.log(dt) + params[MU] * pressure / params[TAU0]


@inner
def bracketed_step(z, r, slope, low, high):
    """(next z, bracket, whether it is the root) of a Newton step that stays inside its bracket; all real."""
    if r > 0.0:
        high = z
    else:
        low = z
    step = -r / slope
    if slope > 0.0 and abs(step) <= MAX_LAST_STEP:
        return z + step, low, high, True
    if not slope > 0.0:
        step = -math.copysign(MAX_STEP, r)
    z_new = z + min(max(step, -MAX_STEP), MAX_STEP)
    if not low < z_new < high:
        z_new = 0.5 * (low + high) if low > -math.inf else high - MAX_STEP
    return z_new, low, high, high - low <= 1e-14 * (1.0 + abs(high))


@inner
def real_root(invariants, gamma_n, constant, rate_dt, params):
    """Root z of r, all real; NaN where there is none below `MAX_Z`. ``rate_dt``: x of the last step's rate, or 0.

    Newton inside a bracket that only shrinks. It starts from what no flow at all would give (exact while the point
    is elastic), where that flows, from the rate of the last step.
    """
    d0, c1, c2, n0, n1, n2 = invariants
    shear = math.sqrt(max(0.5 * n0, MIN_SHEAR))
    z = -constant - thinning(params[G1] / params[TAU0] * shear)[0] - softening(gamma_n, params)[0]
    if z > -4.0:
        z = min(z, math.log(rate_dt) if rate_dt > 1e-3 else -1.0)
    low, high = -math.inf, MAX_Z
    for _ in range(MAX_ITERATIONS):
        r, slope = residual(z, math.exp(z), invariants, gamma_n, constant, params)[:2]
        if not math.isfinite(r):
            return math.nan
        z, low, high, is_root = bracketed_step(z, r, slope, low, high)
        if is_root:
            return z
    return math.nan


@inner
def explicit_gradient(x, J, gamma, q, S, params):
    """dr/d(Sa, r0, r1, r2, tau0, mu, kappa, G1, eta0) at fixed z, invariants, J and gamma_n; real."""
    tau0, mu, kappa = params[TAU0], params[MU], params[KAPPA]
    s = params[G1] / tau0 * math.sqrt(q)
    thin = thinning(s)[1] * s * s
    p = -kappa * (J - 1.0)
    by_Sa, by_r0, by_r1, by_r2 = softening_change(gamma, S, params)
    return (by_Sa, by_r0, by_r1, by_r2, -(thin + mu * p / tau0) / tau0, p / tau0, -mu * (J - 1.0) / tau0,
            (thin - 1.0) / params[G1], 1.0 / params[ETA0])
