"""Generalised Maxwell viscoelasticity at finite strain: an elastic body whose shear stiffness relaxes in branches.

Each branch is a multiplicative Maxwell element with its inelastic right Cauchy-Green tensor Ci (det Ci = 1):

    C = J^(-2/3) F^T F,  b_i = J^(-2/3) F Ci^-1 F^T,  dCi/dt = (C - tr(C Ci^-1)/3 Ci) / tau_i
    tau = G (1 - sum g_i) dev b + sum g_i G dev b_i + kappa (J - 1) J 1,  P = tau F^-T

E and nu are instantaneous; bulk does not relax. At small strain G(t) = G (1 - sum g_i (1 - exp(-t/tau_i))), a Prony
series. Time step: Ci+ is the weighted sum of Ci, the old and the new C that is exact at small strain where C goes
linearly from step to step, scaled to det 1 (that scaling makes the implicit equation explicit: Shutov, Landgraf &
Ihlemann 2013); a step of any length is stable. A branch with tau_i = 0 is switched off.

State: C - 1 of the last step and Ci - 1 of every branch (11, 22, 33, 12, 13, 23).
"""

from __future__ import annotations

import numpy as np

from idic.laws.core import symmetric, tensors
from idic.laws.core.inner import inner
from idic.laws.core.law import LawParameter, LawSpec, register
from idic.laws.elastic import ELASTIC_ALTERNATIVES, ELASTIC_PARAMETERS
from idic.laws.plasticity.elastoplastic import shear_and_bulk

N_BRANCHES = 3
MAX_SERIES_STEP = 0.02  # of tau: below, a series; its first term left out is 0.02^7 / 40320 = 3e-17


@inner
def weights(h):
    """Weights (of the old Ci, the old C, the new C) for a step of h relaxation times; their sum is 1."""
    decay = np.exp(-h)
    if h.real < MAX_SERIES_STEP:
        new_weight = h * (1.0 / 2 - h * (1.0 / 6 - h * (1.0 / 24 - h * (1.0 / 120 - h * (1.0 / 720 - h / 5040)))))
    else:
        new_weight = 1.0 - (1.0 - decay) / h
    return decay, 1.0 - new_weight - decay, new_weight


@inner
def symmetric_inverse(s):
    """(det s, adjugate of s) of a symmetric 6-tuple; s^-1 = adjugate / det."""
    a, b, c = s[1] * s[2] - s[5] * s[5], s[4] * s[5] - s[3] * s[2], s[3] * s[5] - s[4] * s[1]
    return s[0] * a + s[3] * b + s[4] * c, (a, s[0] * s[2] - s[4] * s[4], s[0] * s[1] - s[3] * s[3], b, c,
                                            s[3] * s[4] - s[0] * s[5])


@inner
def plus_identity(state, first):
    """6-tuple of the tensor whose difference from 1 begins at ``state[first]``."""
    return (1.0 + state[first], 1.0 + state[first + 1], 1.0 + state[first + 2], state[first + 3], state[first + 4],
            state[first + 5])


@inner
def keep_tensor(s, state_new, first):
    """The inverse of `plus_identity`."""
    state_new[first], state_new[first + 1], state_new[first + 2] = s[0] - 1.0, s[1] - 1.0, s[2] - 1.0
    state_new[first + 3], state_new[first + 4], state_new[first + 5] = s[3], s[4], s[5]


@inner
def step_of_branch(tau, dt, state, first, C_old, C_new, state_new):
    """(weight, adjugate, Ci before it is scaled, its determinant, weight of the new C) of a branch, see `relaxed`."""
    keep, weight_old, weight_new = weights(dt / tau)
    updated = tensors.combine(keep, plus_identity(state, first), weight_old, C_old, 0.0)
    updated = tensors.combine(1.0, updated, weight_new, C_new, 0.0)
    det, adjugate = symmetric_inverse(updated)
    size = det ** (1.0 / 3.0)
    keep_tensor(tensors.scaled(1.0 / size, updated, 0.0), state_new, first)
    return size / det, adjugate, updated, det, weight_new


@inner
def relaxed(tau, dt, state, first, C_old, C_new, state_new):
    """(weight, adjugate) of a branch after a step: weight times adjugate is its Ci^-1, which goes into `state_new`."""
    return step_of_branch(tau, dt, state, first, C_old, C_new, state_new)[:2]


@inner
def begin_tangent(F, state, K, state_new):
    """(f, J, C^-1, C of the step before, isochoric C) of a point, real, the new C kept; K is cleared."""
    f = tensors.load(F)
    J = symmetric.determinant(f)
    shrink = J ** (-2.0 / 3.0) if J > 0.0 else 0.0
    C = symmetric.cauchy_green(f, f)
    C_new = tensors.scaled(shrink, C, 0.0)
    keep_tensor(C_new, state_new, 0)
    for a in range(6):
        for b in range(6):
            K[a, b] = 0.0
    return f, J, C, shrink, plus_identity(state, 0), C_new


@inner
def add_branch(modulus, tau, dt, state, first, C_old, C_new, total, crossing, K, state_new):
    """(total, crossing) with a branch added, and K: the change of total along V of C_new is crossed(crossing, V) - K V.

    total : sum of modulus Ci^-1
    """
    weight, adjugate, updated, det, weight_new = step_of_branch(tau, dt, state, first, C_old, C_new, state_new)
    factor = modulus * weight * weight_new
    for a in range(6):
        for b in range(6):
            K[a, b] += 2.0 / 3.0 * factor / det * adjugate[a] * adjugate[b] * (1.0 if b < 3 else 2.0)
    return (tensors.combine(1.0, total, modulus * weight, adjugate, 0.0),
            tensors.combine(1.0, crossing, factor, updated, 0.0))


@inner
def end_tangent(begin, total, crossing, K, D, kappa, P, A):
    """P = F S, S = J^(-2/3) total less its part along C^-1, plus the pressure's, and dP/dF."""
    f, J, C, shrink, _, C_new = begin
    adj, p = symmetric.adjugate(C), kappa * (J - 1.0) * J
    Ci, T = tensors.scaled(1.0 / (J * J), adj, 0.0), tensors.scaled(shrink, total, 0.0)
    mean = tensors.contract(T, C) / 3.0
    S = tensors.combine(1.0, T, p - mean, Ci, 0.0)
    tensors.store(symmetric.times(f, S), P)
    for b in range(6):
        E = tensors.unit_strain(b)
        t, dC = tensors.contract(Ci, E), tensors.scaled(2.0, E, 0.0)
        V = tensors.combine(shrink, dC, -2.0 / 3.0 * t, C_new, 0.0)
        dT = tensors.combine(shrink, symmetric.crossed(crossing, V), shrink, symmetric.applied(K, V), 0.0)
        dT = tensors.combine(1.0, dT, -2.0 / 3.0 * t, T, 0.0)
        dmean = (tensors.contract(dT, C) + tensors.contract(T, dC)) / 3.0
        dS = tensors.combine(1.0, dT, kappa * (2.0 * J - 1.0) * J * t - dmean, Ci, 0.0)
        dS = tensors.combine(1.0, dS, p - mean, symmetric.inverse_change(C, J, Ci, t, dC), 0.0)
        D[0, b], D[1, b], D[2, b], D[3, b], D[4, b], D[5, b] = dS
    tensors.push_tangent(f, S, D, A)


def tangent(F, state, params, dt, P, state_new, A, work):
    """`update` and its tangent, real."""
    G, kappa = shear_and_bulk(params[0], params[1])
    begin = begin_tangent(F, state, work[1], state_new)
    if not begin[1] > 0.0:
        return 1
    zero = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    remaining, total, crossing = G, zero, zero
    for i in range(N_BRANCHES):
        g, tau, first = params[2 + 2 * i], params[3 + 2 * i], 6 + 6 * i
        if tau > 0.0:
            remaining -= g * G
            total, crossing = add_branch(g * G, tau, dt, state, first, begin[4], begin[5], total, crossing, work[1],
                                         state_new)
        else:
            for m in range(first, first + 6):
                state_new[m] = state[m]
    end_tangent(begin, tensors.scaled(1.0, total, remaining), crossing, work[1], work[0], kappa, P, A)
    return 0


def update(F, state, params, dt, P, state_new):
    """One point, real or complex."""
    G, kappa = shear_and_bulk(params[0], params[1])
    f = tensors.load(F)
    J, fi = tensors.inverse(f)
    if not J.real > 0.0:
        return 1
    shrink = J ** (-2.0 / 3.0)
    identity = (1.0, 1.0, 1.0, 0.0, 0.0, 0.0)
    transposed = (f[0], f[3], f[6], f[1], f[4], f[7], f[2], f[5], f[8])
    C_old, C_new = plus_identity(state, 0), tensors.scaled(shrink, tensors.congruence(transposed, identity), 0.0)
    keep_tensor(C_new, state_new, 0)
    remaining = G
    total = tensors.scaled(0.0 * G, C_new, 0.0)  # sum of g_i G J^(-2/3) Ci^-1
    for i in range(N_BRANCHES):
        g, tau, first = params[2 + 2 * i], params[3 + 2 * i], 6 + 6 * i
        if not tau.real > 0.0:
            for m in range(first, first + 6):
                state_new[m] = state[m]
            continue
        weight, adjugate = relaxed(tau, dt, state, first, C_old, C_new, state_new)
        remaining -= g * G
        total = tensors.combine(1.0, total, g * G * shrink * weight, adjugate, 0.0)
    total = tensors.scaled(1.0, total, remaining * shrink)
    _, dev = tensors.deviator(tensors.congruence(f, total))
    tau_all = tensors.scaled(1.0, dev, kappa * (J - 1.0) * J)
    tensors.store(tensors.times_transposed(tau_all, fi), P)
    return 0


def _branch(i: int, g: float, tau: float) -> tuple[LawParameter, LawParameter]:
    return (LawParameter(f"g_{i}", "-", f"share of the shear modulus that branch {i} loses; the sum stays below 1",
                         default=g, null=0.0, positive=False, bounds=(0.0, 1.0)),
            LawParameter(f"tau_{i}", "s", f"relaxation time of branch {i} (0: no such branch)", default=tau, null=0.0))


COMPONENTS = ("11-1", "22-1", "33-1", "12", "13", "23")

LAW = register(LawSpec(
    name="maxwell",
    parameters=(
        *ELASTIC_PARAMETERS,
        *(parameter for i, (g, tau) in enumerate(((0.3, 1.0), (0.2, 10.0), (0.1, 100.0)), 1)
          for parameter in _branch(i, g, tau)),
    ),
    updates={"finite": update},
    tangents={"finite": tangent},
    state_names=tuple(f"{tensor}{c}" for tensor in ("c", "ci1_", "ci2_", "ci3_") for c in COMPONENTS),
    reference="tau = G (1 - sum g_i) dev b + sum g_i G dev b_i + kappa (J - 1) J 1; Reese & Govindjee, Int. J. Solids "
              "Struct. 35 (1998) 3455, doi:10.1016/S0020-7683(97)00217-5; step: Shutov, Landgraf & Ihlemann (2013), "
              "arXiv:1304.3380",
    alternatives=ELASTIC_ALTERNATIVES,
    time_order=2,
))
