"""Eindhoven Glassy Polymer with several Maxwell modes: the same viscosity factor for all, an elastic state for each.

    sigma = kappa (J - 1) 1 + sum G_i dev(Be_i) + Gr dev(B),  dCp_i/dt = (G_i/eta_i) [Ct - tr(Ct Cp_i^-1)/3 Cp_i]
    eta_i = eta0_i a,  a = (tau/tau0) / sinh(tau/tau0) exp(mu p/tau0) exp(S(gamma)),  tau = |sum G_i dev Be_i| / sqrt(2)
    dgamma/dt = tau_1/eta_1: the first mode, by convention that of the highest viscosity, drives the softening

Symbols and time step as in ``glassy_polymer.py``, the equation of a step in ``glassy_modes_flow.py``. One function for
any number of modes, which follows from the number of parameters. State: Cp_i - 1 of every mode, gamma, and 1/a, where
the next search begins.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from idic.laws.core import tensors
from idic.laws.core.inner import array_maker, inner
from idic.laws.core.law import LawSpec
from idic.laws.core.symmetric import adjugate, applied, cauchy_green, crossed, determinant, times, trace_of_product
from idic.laws.rate.glassy_flow import KAPPA, MU, TAU0, softening, softening_change, thinning
from idic.laws.rate.glassy_modes_flow import (
    D0,
    N_SHARED_PARAMETERS,
    T,
    U,
    constant_part,
    fastest,
    first_shear,
    load_modes,
    nine,
    plus,
    pulled,
    put,
    real_root,
    residual,
    six,
)

# places in the row of a mode at the end of the step, from Cp of its beginning (0) on
X, D, ROOT, Y, Y_ADJ, R_Y, R_X, TRACE, N_I, ROW = 27, 28, 29, 30, 36, 42, 48, 49, 50, 59
N_SLOPES = 24  # r_C (0), q1_C (6), q1_Y (12); r_Sa, r_r0, r_r1, r_r2, r_tau0, r_mu (18 ...)


@inner
def kinematics(f, J):
    """(C, C^-1, J^(1/3), Ct, adj Ct)."""
    C = cauchy_green(f, f)
    third = J ** (1.0 / 3.0)
    Ct = tensors.scaled(1.0 / (third * third), C, 0.0)
    Ct_adj = adjugate(Ct)
    return C, tensors.scaled(1.0 / (third * third), Ct_adj, 0.0), third, Ct, Ct_adj


@inner
def end_of_step(E, modes, Ct, params, state_new):
    """(sum of G_i M_i, the flow's part of the new state kept); fills X, D, ROOT, Y, Y_ADJ of the modes."""
    zero = 0.0 * E * Ct[0]
    A = (zero, zero, zero, zero, zero, zero)
    for i in range(modes.shape[0]):
        row, G = modes[i], params[N_SHARED_PARAMETERS + 2 * i]
        x = G / params[N_SHARED_PARAMETERS + 2 * i + 1] * E
        end = tensors.combine(1.0, six(row, 0), x, Ct, 0.0)
        end_adj = adjugate(end)
        det = row[D0] + x * (row[D0 + 1] + x * (row[D0 + 2] + x))
        root = det ** (1.0 / 3.0)
        row[X], row[D], row[ROOT] = x, det, root
        put(end, row, Y)
        put(end_adj, row, Y_ADJ)
        A = tensors.combine(1.0, A, G * root / det, end_adj, 0.0)
        elastic_state = tensors.scaled(1.0 / root, end, 0.0)
        put((elastic_state[0] - 1.0, elastic_state[1] - 1.0, elastic_state[2] - 1.0, elastic_state[3], elastic_state[4],
             elastic_state[5]), state_new, 6 * i)
    return A


@inner
def second_piola(A, C, Ci, third, J, params):
    """(S2, W, h) with S2 = J^(1/3) W + h C^-1, W = Gr 1 + sum G_i M_i."""
    W = tensors.scaled(1.0, A, params[0])
    h = params[KAPPA] * (J - 1.0) * J - third / 3.0 * tensors.contract(C, W)
    return tensors.combine(third, W, h, Ci, 0.0), W, h


@array_maker
def update(F, state, params, dt, P, state_new):
    """One point, real or complex."""
    f = tensors.load(F)
    J = determinant(f)
    if not J.real > 0.0:
        return 1
    C, Ci, third, Ct, Ct_adj = kinematics(f, J)
    n = (params.shape[0] - N_SHARED_PARAMETERS) // 2
    modes = np.empty((n, ROW), state.dtype)
    load_modes(state, Ct, Ct_adj, modes)
    gamma, rate, E = state[6 * n], state[6 * n + 1], 0.0 * J
    if dt > 0.0 and fastest(params) > 0.0:
        constant = constant_part(J, dt, params)
        z = real_root(modes.real, gamma.real, constant.real, rate.real * dt, params.real)
        if not math.isfinite(z):
            return 1
        at_root = residual(z, math.exp(z), modes, gamma, constant, params)  # one more step, in complex
        E = math.exp(z) * (1.0 - at_root[0] / at_root[1].real)
        rate = E / dt
    A = end_of_step(E, modes, Ct, params, state_new)
    tensor, det, _ = pulled(modes[0], modes[0, X])
    gamma += modes[0, X] * np.sqrt(first_shear(tensor, modes[0, X], det ** (-2.0 / 3.0))[0])
    tensors.store(times(f, second_piola(A, C, Ci, third, J, params)[0]), P)
    state_new[6 * n], state_new[6 * n + 1] = gamma, rate
    return 0


@inner
def symmetric_part(a):
    """6-tuple of a 9-tuple that is symmetric but for rounding."""
    return a[0], a[4], a[8], 0.5 * (a[1] + a[3]), 0.5 * (a[2] + a[6]), 0.5 * (a[5] + a[7])


@inner
def by_Y(row, B, factor):
    """factor times the derivative by Y of M : B, M = det(Y)^(-2/3) adj Y."""
    det, root = row[D], row[ROOT]
    end_adj = six(row, Y_ADJ)
    return tensors.combine(factor * root / det, crossed(six(row, Y), B),
                           -2.0 / 3.0 * factor * root / det / det * tensors.contract(B, end_adj), end_adj, 0.0)


@inner
def gradients(A, modes, Ct, J, gamma, params, slopes):
    """Fill R_Y, R_X, TRACE, N_I of the modes and the slopes; (q_1, S', dr/dz)."""
    zero = 0.0
    N = (zero, zero, zero, zero, zero, zero, zero, zero, zero)
    tau0 = params[TAU0]
    q1, above, x1 = 0.0, False, modes[0, X]
    for i in range(modes.shape[0]):
        row = modes[i]
        tensor, shrink = plus(nine(row, T), -row[X], nine(row, U)), row[ROOT] / row[D]
        if i == 0:
            q1, above = first_shear(tensor, x1, shrink)
        put(plus((zero, zero, zero, zero, zero, zero, zero, zero, zero), shrink, tensor), row, N_I)
        N = plus(N, params[N_SHARED_PARAMETERS + 2 * i], nine(row, N_I))
    first = nine(modes[0], N_I)
    shear, s2 = math.sqrt(q1), 0.5 * trace_of_product(N, N) / tau0 / tau0
    thin = thinning(math.sqrt(max(s2, 0.0)))[1]
    S, S_slope = softening(gamma, params)
    r_Q, r_q1 = 0.5 * thin / tau0 / tau0, 0.5 * S_slope * x1 / shear if above else 0.0
    B, B1 = symmetric_part(times(N, Ct)), symmetric_part(times(first, Ct))
    q1_Y = by_Y(modes[0], B1, 1.0 if above else 0.0)
    M1 = tensors.scaled(modes[0, ROOT] / modes[0, D], six(modes[0], Y_ADJ), 0.0)
    q1_C = tensors.scaled(1.0 if above else 0.0, symmetric_part(times(tensors.transposed(first), M1)), 0.0)
    r_C = tensors.combine(r_Q, symmetric_part(times(tensors.transposed(N), A)), r_q1, q1_C, 0.0)
    r_z = 1.0 + S_slope * x1 * shear
    for i in range(modes.shape[0]):
        row = modes[i]
        r_Y = by_Y(row, B, r_Q * params[N_SHARED_PARAMETERS + 2 * i])
        if i == 0:
            r_Y = tensors.combine(1.0, r_Y, r_q1, q1_Y, 0.0)
        put(r_Y, row, R_Y)
        row[R_X] = tensors.contract(r_Y, Ct)
        r_z += row[X] * row[R_X]
        row[R_X] += S_slope * shear if i == 0 else 0.0
        row[TRACE] = r_Q * trace_of_product(N, nine(row, N_I))
        r_C = tensors.combine(1.0, r_C, row[X], r_Y, 0.0)
    put(r_C, slopes, 0)
    put(q1_C, slopes, 6)
    put(q1_Y, slopes, 12)
    p = -params[KAPPA] * (J - 1.0)
    put(softening_change(gamma, S, params), slopes, 18)
    slopes[22], slopes[23] = -(thin * s2 + params[MU] * p / tau0) / tau0, p / tau0
    return q1, S_slope, r_z


@inner
def without_history(modes, params, K):
    """(sum of G x D^(-2/3) Y); K (6, 6) such that the change of sum G_i M_i is crossed(that, V) - K V.

    V = dCt + dz Ct, where all Y_i change by x_i V: directions of the motion alone.
    """
    K[:] = 0.0
    together = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    for i in range(modes.shape[0]):
        row = modes[i]
        factor = params[N_SHARED_PARAMETERS + 2 * i] * row[ROOT] / row[D] * row[X]
        together = tensors.combine(1.0, together, factor, six(row, Y), 0.0)
        factor *= 2.0 / 3.0 / row[D]
        for a in range(6):
            for b in range(6):
                K[a, b] += factor * row[Y_ADJ + a] * row[Y_ADJ + b] * (1.0 if b < 3 else 2.0)
    return together


@inner
def change_of_E(modes, slopes, t, J, E, S_slope, r_z, params, dCt, k, dstate, dparams):
    """dz: that of r at fixed z, over -dr/dz."""
    tau0, n = params[TAU0], modes.shape[0]
    dr = tensors.contract(six(slopes, 0), dCt) - params[MU] * params[KAPPA] / tau0 * J * t
    if dstate.shape[0] > 0:
        dr += S_slope * dstate[k, 6 * n]
        for i in range(n):
            dr += tensors.contract(six(modes[i], R_Y), six(dstate[k], 6 * i))
    if dparams.shape[0] > 0:
        dr -= params[MU] * (J - 1.0) / tau0 * dparams[k, KAPPA]
        for m in range(6):
            dr += slopes[18 + m] * dparams[k, 1 + m]
        for i in range(n):
            dr += modes[i, TRACE] * dparams[k, N_SHARED_PARAMETERS + 2 * i]
            dr += modes[i, R_X] * change_of_x(E, params, dparams, k, i)
    return -dr / r_z


@inner
def change_of_x(E, params, dparams, k, i):
    """dx_i at fixed z."""
    G, eta = params[N_SHARED_PARAMETERS + 2 * i], params[N_SHARED_PARAMETERS + 2 * i + 1]
    return E * (dparams[k, N_SHARED_PARAMETERS + 2 * i] - G / eta * dparams[k, N_SHARED_PARAMETERS + 2 * i + 1]) / eta


@inner
def with_history(modes, slopes, q1, E, params, Ct, dCt, dz, flowing, k, dstate, dparams, dstate_new, dt):
    """Change of sum G_i M_i, mode by mode, and row k of the new state's where that is wanted."""
    n = modes.shape[0]
    dA = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    for i in range(n):
        row, G, dG = modes[i], params[N_SHARED_PARAMETERS + 2 * i], 0.0
        dx = row[X] * dz
        if dparams.shape[0] > 0:
            dG = dparams[k, N_SHARED_PARAMETERS + 2 * i]
            dx += change_of_x(E, params, dparams, k, i)
        dY = tensors.combine(row[X], dCt, dx, Ct, 0.0)
        if dstate.shape[0] > 0:
            dY = tensors.combine(1.0, dY, 1.0, six(dstate[k], 6 * i), 0.0)
        end, end_adj = six(row, Y), six(row, Y_ADJ)
        dlogD, size = tensors.contract(end_adj, dY) / row[D], row[ROOT] / row[D]
        dA = tensors.combine(1.0, dA, G * size, crossed(end, dY), 0.0)
        dA = tensors.combine(1.0, dA, (dG - 2.0 / 3.0 * G * dlogD) * size, end_adj, 0.0)
        if k < dstate_new.shape[0]:
            put(tensors.combine(1.0 / row[ROOT], dY, -dlogD / (3.0 * row[ROOT]), end, 0.0), dstate_new[k], 6 * i)
            if i == 0:
                shear = math.sqrt(q1)
                dq = tensors.contract(six(slopes, 6), dCt) + tensors.contract(six(slopes, 12), dY)
                dstate_new[k, 6 * n] = dx * shear + 0.5 * row[X] * dq / shear
                dstate_new[k, 6 * n + 1] = E / dt * dz if flowing else 0.0
                if dstate.shape[0] > 0:
                    dstate_new[k, 6 * n] += dstate[k, 6 * n]
                    if not flowing:
                        dstate_new[k, 6 * n + 1] = dstate[k, 6 * n + 1]
    return dA


@array_maker
def linearise(F, state, params, dt, dF, dstate, dparams, P, state_new, dP, dstate_new):
    """`update` and its derivative by hand (see `LawSpec.linearise`)."""
    f = tensors.load(F)
    J = determinant(f)
    if not J > 0.0:
        return 1
    C, Ci, third, Ct, Ct_adj = kinematics(f, J)
    n = (params.shape[0] - N_SHARED_PARAMETERS) // 2
    modes, slopes, K = np.empty((n, ROW)), np.empty(N_SLOPES), np.empty((6, 6))
    load_modes(state, Ct, Ct_adj, modes)
    E, flowing = 0.0, dt > 0.0 and fastest(params) > 0.0
    if flowing:
        z = real_root(modes, state[6 * n], constant_part(J, dt, params), state[6 * n + 1] * dt, params)
        if not math.isfinite(z):
            return 1
        E = math.exp(z)
    A = end_of_step(E, modes, Ct, params, state_new)
    tensor, det, _ = pulled(modes[0], modes[0, X])
    gamma = state[6 * n] + modes[0, X] * math.sqrt(first_shear(tensor, modes[0, X], det ** (-2.0 / 3.0))[0])
    state_new[6 * n], state_new[6 * n + 1] = gamma, E / dt if flowing else state[6 * n + 1]
    S2, W, h = second_piola(A, C, Ci, third, J, params)
    tensors.store(times(f, S2), P)
    q1, S_slope, r_z = gradients(A, modes, Ct, J, gamma, params, slopes)
    together = without_history(modes, params, K)
    for k in range(dF.shape[0]):
        d = tensors.load(dF[k])
        half = cauchy_green(f, d)
        dC, t = tensors.scaled(2.0, half, 0.0), tensors.contract(Ci, half)  # t = dJ / J
        dCt = tensors.combine(1.0 / (third * third), dC, -2.0 / 3.0 * t, Ct, 0.0)
        dz = 0.0
        if flowing:
            dz = change_of_E(modes, slopes, t, J, E, S_slope, r_z, params, dCt, k, dstate, dparams)
        if dstate.shape[0] > 0 or dparams.shape[0] > 0 or k < dstate_new.shape[0]:
            dW = with_history(modes, slopes, q1, E, params, Ct, dCt, dz, flowing, k, dstate, dparams, dstate_new, dt)
        else:
            V = tensors.combine(1.0, dCt, dz, Ct, 0.0)
            dW = tensors.combine(1.0, crossed(together, V), 1.0, applied(K, V), 0.0)
        dkappa = 0.0
        if dparams.shape[0] > 0:
            dW, dkappa = tensors.scaled(1.0, dW, dparams[k, 0]), dparams[k, KAPPA]
        dCW = tensors.contract(dC, W) + tensors.contract(C, dW)
        dh = (params[KAPPA] * (2.0 * J - 1.0) * J * t + dkappa * (J - 1.0) * J
              - third / 3.0 * (t / 3.0 * tensors.contract(C, W) + dCW))
        dS2 = tensors.combine(third / 3.0 * t, W, third, dW, 0.0)
        dS2 = tensors.combine(1.0, dS2, dh - 2.0 * h * t, Ci, 0.0)
        dS2 = tensors.combine(1.0, dS2, h / (J * J), crossed(C, dC), 0.0)
        tensors.store(plus(times(d, S2), 1.0, times(f, dS2)), dP[k])
    return 0


def several_modes(single: LawSpec, n: int) -> LawSpec:
    """The law with n > 1 modes, made of the single one: shared parameters first, then G1, eta01, G2, eta02, ...

    Typical values: the moduli of like modes add up to that of the single one; a decade of viscosity from mode to mode.
    """
    shared, (modulus, viscosity) = single.parameters[:N_SHARED_PARAMETERS], single.parameters[N_SHARED_PARAMETERS:]
    G, eta = (float(p.default or 0.0) for p in (modulus, viscosity))
    mode_parameters = []
    for i in range(1, n + 1):
        label = "1, whose flow drives the softening: the highest viscosity" if i == 1 else str(i)
        mode_parameters += [replace(modulus, name=f"G{i}", description=f"shear modulus of Maxwell mode {label}",
                                    default=G / n),
                            replace(viscosity, name=f"eta0{i}",
                                    description=f"viscosity of Maxwell mode {i}, fully softened, "
                                    "at no stress", default=eta / n * 0.1 ** (i - 1))]
    states = tuple(f"mode {i}, {name}" for i in range(1, n + 1) for name in single.state_names[:6])
    return LawSpec(name=f"{single.name}_{n}", parameters=(*shared, *mode_parameters), updates={"finite": update},
                   linearise={"finite": linearise}, state_names=(*states, *single.state_names[6:]),
                   reference=single.reference)
