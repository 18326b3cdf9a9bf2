"""Eindhoven Glassy Polymer with one Maxwell mode: glassy flow with softening, parallel to an elastic network.

    sigma = kappa (J - 1) 1 + G1 dev(Be) + Gr dev(B),  B = J^(-2/3) F F^T,  Be = J^(-2/3) F Cp^-1 F^T
    eta = eta0 (tau/tau0) / sinh(tau/tau0) exp(mu p/tau0) exp(S(gamma)),  tau = |G1 dev Be| / sqrt(2)
    dCp/dt = (G1/eta) [Ct - tr(Ct Cp^-1)/3 Cp],  dgamma/dt = tau/eta,  p = -kappa (J - 1),  Ct = J^(-2/3) F^T F

Backward Euler with the unimodular part taken is closed form: with x = G1 dt/eta, Y = Cp_n + x Ct, D = det Y:
Cp = Y / D^(1/3). The one equation for x and the softening S are in ``glassy_flow.py``. In the reference,

    S2 = J^(1/3) [W - (C:W)/3 C^-1] + kappa (J - 1) J C^-1,  W = Gr 1 + G1 M,  M = D^(-2/3) adj Y,  P = F S2

The stress is the source's, in Cauchy's form: J times that of a stored energy. A closed elastic cycle that changes the
volume therefore gives or takes work of the third order in the strain, and none at constant volume.

State: Cp - 1, gamma (equivalent plastic strain of the viscosity), and G1/eta (1/s), where the next search begins.
Where no time passes (dt = 0) nothing flows. With several modes: ``glassy_modes.py``.
"""

from __future__ import annotations

import math

import numpy as np

from idic.laws.core import tensors
from idic.laws.core.inner import inner
from idic.laws.core.law import LawParameter, LawSpec, Modes, register
from idic.laws.core.symmetric import (
    adjugate,
    cauchy_green,
    crossed,
    determinant,
    deviatoric_product,
    times,
    trace_of_product,
)
from idic.laws.rate.glassy_flow import (
    G1,
    KAPPA,
    MIN_SHEAR,
    MU,
    SA,
    TAU0,
    constant_part,
    explicit_gradient,
    intensity,
    real_root,
    residual,
    sheared,
    softening,
    thinning,
)
from idic.laws.rate.glassy_modes import several_modes


@inner
def kinematics(f, J, state):
    """(C, C^-1, J^(1/3), Ct, adj Ct, Cp_n, adj Cp_n, invariants of the flow equation)."""
    C = cauchy_green(f, f)
    third = J ** (1.0 / 3.0)
    Ct = tensors.scaled(1.0 / (third * third), C, 0.0)
    Ct_adj = adjugate(Ct)
    Ci = tensors.scaled(1.0 / (third * third), Ct_adj, 0.0)  # det Ct = 1
    Cp = (1.0 + state[0], 1.0 + state[1], 1.0 + state[2], state[3], state[4], state[5])
    Cp_adj = adjugate(Cp)
    d0 = Cp[0] * Cp_adj[0] + Cp[3] * Cp_adj[3] + Cp[4] * Cp_adj[4]
    c1, T = deviatoric_product(Ct, Cp_adj)
    c2, U = deviatoric_product(Cp, Ct_adj)
    invariants = (d0, c1, c2, trace_of_product(T, T), -2.0 * trace_of_product(T, U), trace_of_product(U, U))
    return C, Ci, third, Ct, Ct_adj, Cp, Cp_adj, invariants


@inner
def second_piola(x, D, root, C, Ci, third, J, Ct, Cp, params):
    """(S2, W, h, Y, adj Y, M) with S2 = J^(1/3) W + h C^-1."""
    Y = tensors.combine(1.0, Cp, x, Ct, 0.0)
    Y_adj = adjugate(Y)
    M = tensors.scaled(root / D, Y_adj, 0.0)
    W = tensors.scaled(params[G1], M, params[0])
    h = params[KAPPA] * (J - 1.0) * J - third / 3.0 * tensors.contract(C, W)
    return tensors.combine(third, W, h, Ci, 0.0), W, h, Y, Y_adj, M


@inner
def keep(Y, root, gamma, rate, state_new):
    """The new state."""
    r = 1.0 / root
    state_new[0], state_new[1], state_new[2] = r * Y[0] - 1.0, r * Y[1] - 1.0, r * Y[2] - 1.0
    state_new[3], state_new[4], state_new[5] = r * Y[3], r * Y[4], r * Y[5]
    state_new[6], state_new[7] = gamma, rate


def update(F, state, params, dt, P, state_new):
    """One point, real or complex."""
    f = tensors.load(F)
    J = determinant(f)
    if not J.real > 0.0:
        return 1
    C, Ci, third, Ct, Ct_adj, Cp, Cp_adj, invariants = kinematics(f, J, state)
    d0, c1, c2, n0, n1, n2 = invariants
    x, gamma, rate = 0.0 * J, state[6], state[7]
    if dt > 0.0 and params[G1].real > 0.0:
        constant = constant_part(J, dt, params)
        z = real_root((d0.real, c1.real, c2.real, n0.real, n1.real, n2.real), gamma.real, constant.real,
                      rate.real * dt, params.real)
        if not math.isfinite(z):
            return 1
        at_root = residual(z, math.exp(z), invariants, gamma, constant, params)  # one more step, in complex
        x = math.exp(z) * (1.0 - at_root[0] / at_root[1].real)
        rate = x / dt
    D, root, _, q, _ = intensity(x, d0, c1, c2, n0, n1, n2)
    gamma += x * np.sqrt(q)
    S2, W, h, Y, Y_adj, M = second_piola(x, D, root, C, Ci, third, J, Ct, Cp, params)
    tensors.store(times(f, S2), P)
    keep(Y, root, gamma, rate, state_new)
    return 0


@inner
def flow(J, invariants, state, dt, params):
    """(x, gamma, q, dq/dx, 1/(dr/dz), dr/dq, S, slope of S, D, D^(1/3), D^(-4/3), ok) of the step, real."""
    d0, c1, c2, n0, n1, n2 = invariants
    if not (dt > 0.0 and params[G1] > 0.0):
        root = d0 ** (1.0 / 3.0)
        return 0.0, state[6], MIN_SHEAR, 0.0, 0.0, 0.0, 0.0, 0.0, d0, root, 1.0 / (d0 * root), True
    constant = constant_part(J, dt, params)
    z = real_root(invariants, state[6], constant, state[7] * dt, params)
    if not math.isfinite(z):
        return 0.0, state[6], MIN_SHEAR, 0.0, 0.0, 0.0, 0.0, 0.0, d0, 1.0, 1.0, False
    x = math.exp(z)
    _, slope, q, q_x, D, root, inverse = residual(z, x, invariants, state[6], constant, params)
    shear, stiffness = math.sqrt(q), params[G1] / params[TAU0]
    gamma = state[6] + x * shear
    S, S_slope = softening(gamma, params)
    r_q = 0.5 * thinning(stiffness * shear)[1] * stiffness * stiffness + 0.5 * S_slope * x / shear
    return x, gamma, q, q_x, 1.0 / slope, r_q, S, S_slope, D, root, inverse, True


@inner
def gradients(x, q, r_q, D, inverse, J, third, Ci, Ct_adj, Cp_adj, cross, invariants, params):
    """(dr/dC, dr/dCp_n, dq/dC, dq/dCp_n) at fixed x, symmetric; real."""
    d0, c1, c2, n0, n1, n2 = invariants
    by_d0 = -4.0 / 3.0 * q / D
    by_c1, by_c2 = by_d0 * x, by_d0 * x * x
    if sheared(n0 + x * (n1 + x * n2), x):
        by_d0 -= inverse * (c2 + 3.0 * x)
        by_c1 += inverse / 3.0 * (2.0 * c1 + x * c2 - 3.0 * x * x)
        by_c2 += inverse / 3.0 * (x * c1 + 2.0 * x * x * c2 - 3.0 * d0)
    shrink = 1.0 / (third * third)
    q_C = tensors.combine(shrink * by_c1, Cp_adj, shrink * by_c2, cross, 0.0)
    q_C = tensors.combine(1.0, q_C, -(by_c1 * c1 + 2.0 * by_c2 * c2) / 3.0, Ci, 0.0)
    q_Cp = tensors.combine(1.0, tensors.combine(by_d0, Cp_adj, by_c1, cross, 0.0), by_c2, Ct_adj, 0.0)
    pressure = -0.5 * params[MU] * params[KAPPA] / params[TAU0] * J
    return tensors.combine(r_q, q_C, pressure, Ci, 0.0), tensors.scaled(r_q, q_Cp, 0.0), q_C, q_Cp


@inner
def stress_change(point, step, params, t, dC, dY, dGr, dG, dkappa):
    """(change of ln D, change of S2)."""
    C, Ci, third, Ct, J = point
    x, q, q_x, flexibility, S_slope, D, root, S2, W, h, Y, Y_adj, M = step
    dlogD = tensors.contract(Y_adj, dY) / D
    dW = tensors.combine(params[G1] * root / D, crossed(Y, dY), dG - 2.0 / 3.0 * params[G1] * dlogD, M, dGr)
    dCW = tensors.contract(dC, W) + tensors.contract(C, dW)
    dh = (params[KAPPA] * (2.0 * J - 1.0) * J * t + dkappa * (J - 1.0) * J
          - third / 3.0 * (t / 3.0 * tensors.contract(C, W) + dCW))
    dS2 = tensors.combine(third / 3.0 * t, W, third, dW, 0.0)
    dS2 = tensors.combine(1.0, dS2, dh - 2.0 * h * t, Ci, 0.0)
    return dlogD, tensors.combine(1.0, dS2, h / (J * J), crossed(C, dC), 0.0)


@inner
def one_direction(f, point, step, grads, params, flowing, dt, k, dF, dstate, dparams, dP, dstate_new):
    """Row k of dP and dstate_new: dx = -x dr / (dr/dz) with dr at fixed z, then everything that follows from Y."""
    C, Ci, third, Ct, J = point
    x, q, q_x, flexibility, S_slope, D, root, S2, W, h, Y, Y_adj, M = step
    r_C, r_Cp, q_C, q_Cp, r_params = grads
    d = tensors.load(dF[k])
    half = cauchy_green(f, d)
    dC = tensors.scaled(2.0, half, 0.0)
    t = tensors.contract(Ci, half)  # dJ / J
    dr, dq, dGr, dG, dkappa = tensors.contract(r_C, dC), tensors.contract(q_C, dC), 0.0, 0.0, 0.0
    dY = tensors.combine(x / (third * third), dC, -2.0 / 3.0 * x * t, Ct, 0.0)
    if dstate.shape[0] > 0:
        dCp = (dstate[k, 0], dstate[k, 1], dstate[k, 2], dstate[k, 3], dstate[k, 4], dstate[k, 5])
        dr += tensors.contract(r_Cp, dCp) + S_slope * dstate[k, 6]
        dq += tensors.contract(q_Cp, dCp)
        dY = tensors.combine(1.0, dY, 1.0, dCp, 0.0)
    if dparams.shape[0] > 0:
        dGr, dG, dkappa = dparams[k, 0], dparams[k, G1], dparams[k, KAPPA]
        for m in range(9):
            dr += r_params[m] * dparams[k, SA + m]
    dx = -x * dr * flexibility
    dY = tensors.combine(1.0, dY, dx, Ct, 0.0)
    dlogD, dS2 = stress_change(point, step, params, t, dC, dY, dGr, dG, dkappa)
    a, b = times(d, S2), times(f, dS2)
    tensors.store((a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3], a[4] + b[4], a[5] + b[5],
                   a[6] + b[6], a[7] + b[7], a[8] + b[8]), dP[k])
    if k < dstate_new.shape[0]:
        dCp = tensors.combine(1.0 / root, dY, -dlogD / (3.0 * root), Y, 0.0)
        for m in range(6):
            dstate_new[k, m] = dCp[m]
        shear = math.sqrt(q)
        dstate_new[k, 6] = dx * shear + 0.5 * x * (dq + q_x * dx) / shear
        dstate_new[k, 7] = dx / dt if flowing else 0.0
        if dstate.shape[0] > 0:
            dstate_new[k, 6] += dstate[k, 6]
            if not flowing:
                dstate_new[k, 7] = dstate[k, 7]


def tangent(F, state, params, dt, P, state_new, A, work):
    """`update` and its tangent, from the changes of S2 along six strains."""
    f = tensors.load(F)
    J = determinant(f)
    if not J > 0.0:
        return 1
    C, Ci, third, Ct, Ct_adj, Cp, Cp_adj, invariants = kinematics(f, J, state)
    x, gamma, q, q_x, flexibility, r_q, S, S_slope, D, root, inverse, ok = flow(J, invariants, state, dt, params)
    if not ok:
        return 1
    S2, W, h, Y, Y_adj, M = second_piola(x, D, root, C, Ci, third, J, Ct, Cp, params)
    tensors.store(times(f, S2), P)
    keep(Y, root, gamma, x / dt if flexibility != 0.0 else state[7], state_new)
    r_C = gradients(x, q, r_q, D, inverse, J, third, Ci, Ct_adj, Cp_adj, crossed(Cp, Ct), invariants, params)[0]
    point, step = (C, Ci, third, Ct, J), (x, q, q_x, flexibility, S_slope, D, root, S2, W, h, Y, Y_adj, M)
    columns = work[0]
    for b in range(6):
        E = tensors.unit_strain(b)
        dC, t = tensors.scaled(2.0, E, 0.0), tensors.contract(Ci, E)
        dx = -x * tensors.contract(r_C, dC) * flexibility
        dY = tensors.combine(x / (third * third), dC, dx - 2.0 / 3.0 * x * t, Ct, 0.0)
        dS2 = stress_change(point, step, params, t, dC, dY, 0.0, 0.0, 0.0)[1]
        columns[0, b], columns[1, b], columns[2, b], columns[3, b], columns[4, b], columns[5, b] = dS2
    tensors.push_tangent(f, S2, columns, A)
    return 0


def linearise(F, state, params, dt, dF, dstate, dparams, P, state_new, dP, dstate_new):
    """`update` and its derivative by hand (see `LawSpec.linearise`)."""
    f = tensors.load(F)
    J = determinant(f)
    if not J > 0.0:
        return 1
    C, Ci, third, Ct, Ct_adj, Cp, Cp_adj, invariants = kinematics(f, J, state)
    x, gamma, q, q_x, flexibility, r_q, S, S_slope, D, root, inverse, ok = flow(J, invariants, state, dt, params)
    if not ok:
        return 1
    S2, W, h, Y, Y_adj, M = second_piola(x, D, root, C, Ci, third, J, Ct, Cp, params)
    tensors.store(times(f, S2), P)
    flowing = flexibility != 0.0
    keep(Y, root, gamma, x / dt if flowing else state[7], state_new)
    r_C, r_Cp, q_C, q_Cp = gradients(x, q, r_q, D, inverse, J, third, Ci, Ct_adj, Cp_adj, crossed(Cp, Ct),
                                     invariants, params)
    r_params = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    if flowing and dparams.shape[0] > 0:
        r_params = explicit_gradient(x, J, gamma, q, S, params)
    point, grads = (C, Ci, third, Ct, J), (r_C, r_Cp, q_C, q_Cp, r_params)
    step = (x, q, q_x, flexibility, S_slope, D, root, S2, W, h, Y, Y_adj, M)
    for k in range(dF.shape[0]):
        one_direction(f, point, step, grads, params, flowing, dt, k, dF, dstate, dparams, dP, dstate_new)
    return 0


LAW = register(LawSpec(
    name="egp",
    parameters=(
        LawParameter("Gr", "MPa", "shear modulus of the network: hardening", default=26.0, null=0.0),
        LawParameter("Sa", "-", "softening: initial thermodynamic state, ln of the viscosity's fall", default=27.0,
                     null=0.0, stabilising_factor=0.5),
        LawParameter("r0", "-", "softening: e^-strain where it begins", default=0.965, bounds=(1e-6, np.inf),
                     max_step=0.05, start_values=(0.985, 0.95, 0.88)),  # strains of 0.015, 0.05, 0.13
        LawParameter("r1", "-", "softening: sharpness of its beginning", default=50.0, bounds=(1e-6, np.inf)),
        LawParameter("r2", "-", "softening: 1 - speed with strain", default=-3.0, null=1.0, positive=False,
                     bounds=(-np.inf, np.inf)),
        LawParameter("tau0", "MPa", "stress of the rate dependence", default=0.7, null=math.inf),
        LawParameter("mu", "-", "pressure dependence of the viscosity", default=0.08, null=0.0, positive=False,
                     bounds=(-np.inf, np.inf)),
        LawParameter("kappa", "MPa", "bulk modulus", default=3750.0),
        LawParameter("G1", "MPa", "shear modulus of the Maxwell mode", default=634.0, null=0.0),
        LawParameter("eta0", "MPa s", "viscosity of the Maxwell mode, fully softened, at no stress", default=1.47e11,
                     max_step=2.3),  # only its order of magnitude matters far from the answer
    ),
    updates={"finite": update},
    linearise={"finite": linearise},
    tangents={"finite": tangent},
    state_names=("cp11-1", "cp22-1", "cp33-1", "cp12", "cp13", "cp23", "gamma", "rate"),
    reference="Govaert, Timmermans & Brekelmans, J. Eng. Mater. Technol. 122 (2000) 177, doi:10.1115/1.482784; "
              "Klompen et al., Macromolecules 38 (2005) 6997, doi:10.1021/ma050498v; van Breemen et al., J. Mech. "
              "Phys. Solids 59 (2011) 2191, doi:10.1016/j.jmps.2011.05.001",
    modes=Modes(("G", "eta0"), several_modes),
))
