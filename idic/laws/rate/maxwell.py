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

from idic.laws.core import tensors
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
def relaxed(tau, dt, state, first, C_old, C_new, state_new):
    """(weight, adjugate) of a branch after a step: weight times adjugate is its Ci^-1, which goes into `state_new`."""
    keep, weight_old, weight_new = weights(dt / tau)
    updated = tensors.combine(keep, plus_identity(state, first), weight_old, C_old, 0.0)
    updated = tensors.combine(1.0, updated, weight_new, C_new, 0.0)
    det, adjugate = symmetric_inverse(updated)
    size = det ** (1.0 / 3.0)
    keep_tensor(tensors.scaled(1.0 / size, updated, 0.0), state_new, first)
    return size / det, adjugate


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
    state_names=tuple(f"{tensor}{c}" for tensor in ("c", "ci1_", "ci2_", "ci3_") for c in COMPONENTS),
    reference="tau = G (1 - sum g_i) dev b + sum g_i G dev b_i + kappa (J - 1) J 1; Reese & Govindjee, Int. J. Solids "
              "Struct. 35 (1998) 3455, doi:10.1016/S0020-7683(97)00217-5; step: Shutov, Landgraf & Ihlemann (2013), "
              "arXiv:1304.3380",
    alternatives=ELASTIC_ALTERNATIVES,
    time_order=2,
))
