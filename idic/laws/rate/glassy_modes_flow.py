"""Flow of the Eindhoven Glassy Polymer with several Maxwell modes: still one scalar equation per time step.

All viscosities fall by the same factor a, so with E = dt / a each mode has x_i = (G_i / eta0_i) E and, as with one mode
(``glassy_flow.py``), Y_i = Cp_i + x_i Ct, D_i = det Y_i. With T_i = Ct adj(Cp_i), U_i = Cp_i adj(Ct):

    N = sum G_i N_i,  N_i = D_i^(-2/3) (dev T_i - x_i dev U_i),  tau = sqrt(tr(N N) / 2)          (all modes together)
    gamma = gamma_n + x_1 sqrt(q_1),  q_1 = tr(N_1 N_1) / 2                                        (the first mode)
    r(z) = z - ln dt + mu p/tau0 + L(tau/tau0) + S(gamma) = 0,  z = ln E

A mode is a row of an array: Cp (6 entries), the coefficients of D (3), dev T (9), dev U (9).
"""

from __future__ import annotations

import math

import numpy as np

from idic.laws.core.inner import inner
from idic.laws.core.symmetric import adjugate, deviatoric_product, trace_of_product
from idic.laws.rate.glassy_flow import (
    bracketed_step,
    MAX_Z,
    MAX_ITERATIONS,
    KAPPA,
    MIN_SHEAR,
    MU,
    TAU0,
    sheared,
    softening,
    thinning,
)

N_SHARED_PARAMETERS = 8                    # parameters in front of G1, eta01, G2, eta02, ...
D0, T, U = 6, 9, 18  # places in the row of a mode, after Cp


@inner
def nine(row, first):
    """Nine entries of a row as a 9-tuple."""
    return (row[first], row[first + 1], row[first + 2], row[first + 3], row[first + 4], row[first + 5], row[first + 6],
            row[first + 7], row[first + 8])


@inner
def six(row, first):
    """Six entries of a row as a 6-tuple."""
    return row[first], row[first + 1], row[first + 2], row[first + 3], row[first + 4], row[first + 5]


@inner
def put(values, row, first):
    """A tuple into a row."""
    for m in range(len(values)):
        row[first + m] = values[m]


@inner
def plus(a, x, b):
    """a + x b of two 9-tuples."""
    return (a[0] + x * b[0], a[1] + x * b[1], a[2] + x * b[2], a[3] + x * b[3], a[4] + x * b[4], a[5] + x * b[5],
            a[6] + x * b[6], a[7] + x * b[7], a[8] + x * b[8])


@inner
def load_modes(state, Ct, Ct_adj, modes):
    """Fill the rows of all modes from the state at the beginning of the step."""
    for i in range(modes.shape[0]):
        c = six(state, 6 * i)
        Cp = (1.0 + c[0], 1.0 + c[1], 1.0 + c[2], c[3], c[4], c[5])
        Cp_adj = adjugate(Cp)
        c1, t = deviatoric_product(Ct, Cp_adj)
        c2, u = deviatoric_product(Cp, Ct_adj)
        row = modes[i]
        put(Cp, row, 0)
        row[D0], row[D0 + 1], row[D0 + 2] = Cp[0] * Cp_adj[0] + Cp[3] * Cp_adj[3] + Cp[4] * Cp_adj[4], c1, c2
        put(t, row, T)
        put(u, row, U)


@inner
def pulled(row, x):
    """(dev T - x dev U, D, dD/dln x) of one mode."""
    d0, c1, c2 = row[D0], row[D0 + 1], row[D0 + 2]
    return (plus(nine(row, T), -x, nine(row, U)), d0 + x * (c1 + x * (c2 + x)), x * (c1 + x * (2.0 * c2 + 3.0 * x)))


@inner
def first_shear(tensor, x, shrink):
    """q_1, not below its floor, of dev T - x dev U and D^(-2/3); and whether it is above."""
    norm = trace_of_product(tensor, tensor)
    if sheared(norm.real, x.real):
        return 0.5 * shrink * shrink * norm, True
    return 0.5 * shrink * shrink * MIN_SHEAR * (1.0 + x * x) + 0.0 * norm, False


@inner
def residual(z, E, modes, gamma_n, constant, params):
    """(r, dr/dz); ``constant`` = mu p/tau0 - ln dt."""
    zero = 0.0 * E * modes[0, D0]
    N = (zero, zero, zero, zero, zero, zero, zero, zero, zero)
    N_z, x1, q1, q1_z = N, zero, zero, zero
    for i in range(modes.shape[0]):
        G = params[N_SHARED_PARAMETERS + 2 * i]
        x = G / params[N_SHARED_PARAMETERS + 2 * i + 1] * E
        tensor, D, D_z = pulled(modes[i], x)
        shrink = D ** (-2.0 / 3.0)
        u = nine(modes[i], U)
        N = plus(N, G * shrink, tensor)
        N_z = plus(plus(N_z, -2.0 / 3.0 * D_z / D * G * shrink, tensor), -G * shrink * x, u)
        if i == 0:
            x1, (q1, above) = x, first_shear(tensor, x, shrink)
            change = -trace_of_product(tensor, u) if above else MIN_SHEAR * x
            q1_z = shrink * shrink * x * change - 4.0 / 3.0 * D_z / D * q1
    Q, Q_z = 0.5 * trace_of_product(N, N), trace_of_product(N, N_z)
    if not Q.real > 0.0:
        Q, Q_z = 0.0 * Q, 0.0 * Q_z
    tau0 = params[TAU0]
    shear = np.sqrt(q1)
    L, L_slope = thinning(np.sqrt(Q) / tau0)
    S, S_slope = softening(gamma_n + x1 * shear, params)
    slope = 1.0 + 0.5 * L_slope / tau0 * Q_z / tau0 + S_slope * x1 * (shear + 0.5 * q1_z / shear)
    return z + constant + L + S, slope


@inner
def constant_part(J, dt, params):
    """The part of r that does not depend on z."""
    return -math.log(dt) - params[MU] * params[KAPPA] * (J - 1.0) / params[TAU0]


@inner
def fastest(params):
    """The largest G_i / eta0_i, 1/s; real."""
    rate = 0.0
    for i in range((params.shape[0] - N_SHARED_PARAMETERS) // 2):
        rate = max(rate, params[N_SHARED_PARAMETERS + 2 * i].real / params[N_SHARED_PARAMETERS + 2 * i + 1].real)
    return rate


@inner
def real_root(modes, gamma_n, constant, E_before, params):
    """Root z of r, all real; NaN where there is none. ``E_before``: E at the rate of the last step, or 0.

    As with one mode, in the x of the fastest mode: from no flow at all where that is little, else from the last rate.
    """
    shift = math.log(fastest(params))
    z = -residual(0.0, 0.0, modes, gamma_n, constant, params)[0]
    if z + shift > -4.0:
        z = min(z, math.log(E_before) if math.exp(shift) * E_before > 1e-3 else -1.0 - shift)
    low, high = -math.inf, MAX_Z - shift
    for _ in range(MAX_ITERATIONS):
        r, slope = residual(z, math.exp(z), modes, gamma_n, constant, params)
        if not math.isfinite(r):
            return math.nan
        z, low, high, is_root = bracketed_step(z, r, slope, low, high)
        if is_root:
            return z
    return math.nan
