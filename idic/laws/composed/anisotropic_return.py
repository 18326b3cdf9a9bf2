"""The return of a composed law with orthotropic or nonlinear elasticity or in-plane-shear yield; complex step.

Strain e and stress t are those of ``elastic_strain.py``, in the material axes (``angle`` about z, turning with R of
F = R U). One unknown, the growth of p, as in ``general_return.py``, with any stiffness D = dt/de:

    e+ = e - z A xi,   xi = t(e+) - sum 2/3 C w (a + z A xi),   z = growth / resistance
    (1 + z (D + sum 2/3 C w) A) xi = t + D (e - e_k) - sum 2/3 C w a        (one pass where t is linear in e)
    q(xi) = sqrt(xi : A xi) = resistance(p + growth, growth / dt)

Mises and Hill: A as in ``plasticity/hill48.py``. In-plane shear: q = |xi12|, p the plastic shear strain (doubled).
"""

from __future__ import annotations

import math

import numpy as np

from idic.laws.composed.elastic_strain import about_z, first_piola, full, of_strain, strain_of, stretch
from idic.laws.composed.elastic_strain import inverse as inverse_of
from idic.laws.composed.elasticity import elastic_stress, weight
from idic.laws.composed.flow_stress import flow_stress, most_growth, resistance
from idic.laws.composed.general_return import MOST_DAMAGE, damage_growth_of, hill_coefficients, recovery
from idic.laws.composed.isotropic_return import IN_PLANE_SHEAR, flows
from idic.laws.core import tensors
from idic.laws.core.inner import inner, inner_with_arrays
from idic.laws.plasticity.elastoplastic import ABSOLUTE_TOLERANCE, MAX_ITERATIONS, RELATIVE_TOLERANCE, ROOT
from idic.laws.core.rotation import rotation

STRAIN_TOLERANCE = 1e-9   # of a pass where the elasticity is nonlinear, over the trial strain; quadratic
MOST_PASSES = 60


@inner
def flow_matrix(surface, first, params, A):
    """A (6, 6) of the yield condition, on components of a tensor; ``first``: place of Hill's r0, r45, r90."""
    A[:, :] = 0.0
    if surface == IN_PLANE_SHEAR:
        A[3, 3] = 0.5
        return
    f, g, h, n = hill_coefficients(surface, first, params)
    A[0, 0], A[1, 1], A[2, 2] = g + h, f + h, f + g
    A[0, 1], A[1, 0], A[0, 2], A[2, 0], A[1, 2], A[2, 1] = -h, -h, -g, -g, -f, -f
    A[3, 3], A[4, 4], A[5, 5] = n, 1.5, 1.5


@inner
def product(s, t):
    """s : t of two 6-vectors."""
    total = 0.0 * (s[0] + t[0])
    for i in range(6):
        total += weight(i) * s[i] * t[i]
    return total


@inner
def times(A, s, out):
    """out = A s; most entries of A are zero."""
    for i in range(6):
        out[i] = 0.0
        for j in range(6):
            if A[i, j] != 0.0:
                out[i] += A[i, j] * s[j]


@inner
def solve(K, x):
    """x = K^-1 x for the two right-hand sides in the columns of x (6, 2); K is overwritten.

    Without pivoting: K = 1 + z (positive) (semidefinite) has positive principal minors in the order taken.
    """
    for i in range(6):
        for j in range(i + 1, 6):
            factor = K[j, i] / K[i, i]
            if factor != 0.0:
                for m in range(i, 6):
                    K[j, m] -= factor * K[i, m]
                x[j, 0] -= factor * x[i, 0]
                x[j, 1] -= factor * x[i, 1]
    for back in range(6):
        i = 5 - back
        for m in range(i + 1, 6):
            x[i, 0] -= K[i, m] * x[m, 0]
            x[i, 1] -= K[i, m] * x[m, 1]
        x[i, 0] /= K[i, i]
        x[i, 1] /= K[i, i]


@inner
def shifted(back, stress, growth, state, params, A, dA):
    """stress - sum 2/3 C w a into A and its slope over growth into dA; returns (sum 2/3 C w, its slope)."""
    total, slope = 0.0 * growth, 0.0 * growth
    for i in range(6):
        A[i], dA[i] = stress[i], 0.0
    for term in range(len(back) // 2 - 1):
        C, gamma, w = recovery(back, term, growth, params)
        for i in range(6):
            A[i] -= C * w * state[7 + 6 * term + i]
            dA[i] += C * gamma * w * w * state[7 + 6 * term + i]
        total += C * w
        slope -= C * gamma * w * w
    return total, slope


@inner_with_arrays
def relaxed(elastic, back, hardening, rate, A, trial, p, growth, dt, state, params, flow_params, e, xi, flowing, passes,
            sloped):
    """The strain e, xi and A xi that belong to a growth: (1 / resistance - 1 / q, its slope over growth if ``sloped``).

    e is the start and is overwritten. ``passes`` bounds the Newton passes on the strain: 1 in the complex step.
    """
    flow, dflow, _ = resistance(hardening, rate, p, growth, dt, 0.0 * p, flow_params)
    z, dz = growth / flow, (1.0 - growth / flow * dflow) / flow
    t, D = np.empty_like(e), np.empty((6, 6), e.dtype)
    K, columns, shift, dshift, moved = (np.empty((6, 6), e.dtype), np.empty((6, 2), e.dtype), np.empty_like(e),
                                        np.empty_like(e), np.empty_like(e))
    size = math.sqrt(product(trial, trial).real)
    total, dtotal = 0.0 * growth, 0.0 * growth
    for _ in range(passes):
        elastic_stress(elastic[0], elastic[1:], e, params, t, D)
        for i in range(6):
            moved[i] = t[i]
            for j in range(6):
                moved[i] += D[i, j] * (trial[j] - e[j])
        total, dtotal = shifted(back, moved, growth, state, flow_params, shift, dshift)
        for i in range(6):
            columns[i, 0], columns[i, 1] = shift[i], 0.0
        stiffness_times(D, A, total, z, K)
        solve(K, columns)
        change = 0.0
        for i in range(6):
            xi[i] = columns[i, 0]
        times(A, xi, flowing)
        for i in range(6):
            next_strain = trial[i] - z * flowing[i]
            change += abs(next_strain.real - e[i].real)
            e[i] = next_strain
        if len(elastic) <= 3 or change <= STRAIN_TOLERANCE * size:
            break
    q = np.sqrt(product(xi, flowing))
    if not sloped:
        return 1.0 / flow - 1.0 / q, 0.0 * q
    for i in range(6):  # slope: (1 + z (D + total) A) dxi = dshift - (dz (D + total) + z dtotal) A xi
        columns[i, 0], columns[i, 1] = 0.0, dshift[i] - (dz * total + z * dtotal) * flowing[i]
        for j in range(6):
            columns[i, 1] -= dz * D[i, j] * flowing[j]
    stiffness_times(D, A, total, z, K)
    solve(K, columns)
    dq = 0.0 * q
    for i in range(6):
        dq += weight(i) * flowing[i] * columns[i, 1] / q
    return 1.0 / flow - 1.0 / q, dq / (q * q) - dflow / (flow * flow)


@inner
def stiffness_times(D, A, total, z, K):
    """K = 1 + z (D + total) A; most entries of both are zero."""
    for i in range(6):
        for j in range(6):
            K[i, j] = (1.0 if i == j else 0.0) + z * total * A[i, j]
        for m in range(6):
            if D[i, m] != 0.0:
                stiffness = z * D[i, m]
                for j in range(6):
                    if A[m, j] != 0.0:
                        K[i, j] += stiffness * A[m, j]


@inner_with_arrays
def plastic_growth(elastic, back, hardening, rate, A, trial, q, modulus, p, dt, state, params, flow_params):
    """Root of the yield condition, all real; -1 where there is none. Newton inside a bracket, from the middle."""
    e, xi, flowing = np.empty(6), np.empty(6), np.empty(6)
    sigma, largest = flow_stress(hardening, p, flow_params)[0], q / modulus
    low, high = 0.0, max(most_growth(hardening, rate, q, p, sigma, dt, flow_params), ABSOLUTE_TOLERANCE * largest)
    x = 0.5 * min((q - sigma) / modulus, high)
    for _ in range(MAX_ITERATIONS):
        for m in range(6):  # not e[:]: that takes three seconds to compile
            e[m] = trial[m]
        value, slope = relaxed(elastic, back, hardening, rate, A, trial, p, x, dt, state, params, flow_params, e, xi,
                               flowing, MOST_PASSES, True)
        if not math.isfinite(value):
            return -1.0
        if value > 0.0:
            low = x
        else:
            high = x
        next_growth = x - value / slope
        converged = abs(next_growth - x) <= RELATIVE_TOLERANCE * x
        if not low <= next_growth <= high:
            next_growth, converged = (2.0 * low + largest if high == math.inf else 0.5 * (low + high)), False
        if converged or abs(next_growth - x) <= ABSOLUTE_TOLERANCE * largest:
            return next_growth if flow_stress(hardening, p + next_growth, flow_params)[0] > 0.0 else -1.0
        x = next_growth
    return -1.0


@inner_with_arrays
def update(elastic, shift, angle, surface, hill, hardening, back, rate, damage, F, state, params, dt, P, state_new):
    """One point, real or complex; ``elastic``: symmetry and terms, ``shift``: place in `params` of the flow's."""
    f = tensors.load(F)
    J, _ = tensors.inverse(f)
    if not J.real > 0.0:
        return 1
    flow_params, p = params[shift:], state[6]
    for m in range(state.shape[0]):
        state_new[m] = state[m]
    R = rotation(f)
    U, inverse_cp = stretch(R, f), (1.0 + state[0], 1.0 + state[1], 1.0 + state[2], state[3], state[4], state[5])
    g = tensors.congruence(full(U), inverse_cp)
    turn = about_z(params[angle] if angle >= 0 else 0.0 * params[0])
    local = tensors.congruence(turn, strain_of(g))
    trial, t, e, xi, flowing, slope = (np.empty(6, F.dtype), np.empty(6, F.dtype), np.empty(6, F.dtype),
                                       np.empty(6, F.dtype), np.empty(6, F.dtype), np.empty(6, F.dtype))
    D, A = np.empty((6, 6), F.dtype), np.empty((6, 6), F.dtype)
    trial[0], trial[1], trial[2], trial[3], trial[4], trial[5] = local
    for m in range(6):
        e[m] = trial[m]
    elastic_stress(elastic[0], elastic[1:], e, params, t, D)
    flow_matrix(surface, hill, flow_params, A)
    shifted(back, t, 0.0 * p, state, flow_params, xi, slope)
    times(A, xi, flowing)
    square, growth = product(xi, flowing), 0.0 * p
    q = math.sqrt(max(square.real, 0.0))
    if flows(hardening, rate, q, p.real, dt, 0.0, flow_params.real):
        times(D, flowing, slope)
        modulus = (product(flowing, slope) / square).real
        real = plastic_growth(elastic, back, hardening, rate, A.real.copy(), trial.real.copy(), q, modulus, p.real, dt,
                              state.real.copy(), params.real.copy(), params.real.copy()[shift:])
        if real < 0.0:
            return 1
        growth = real + 0.0 * p
        for sweep in range(3):  # the real solution, a step in complex: exact derivative, the strain that belongs to it
            value, steep = relaxed(elastic, back, hardening, rate, A, trial, p, growth, dt, state, params, flow_params,
                                   e, xi, flowing, MOST_PASSES if sweep == 0 else 1, sweep == 1)
            growth -= value / steep.real if sweep == 1 else 0.0 * value
        elastic_stress(elastic[0], elastic[1:], e, params, t, D)
        g = remember(back, U, e, turn, trial, growth, state, flow_params, state_new)
        inverse_cp = (1.0 + state_new[0], 1.0 + state_new[1], 1.0 + state_new[2], state_new[3], state_new[4],
                      state_new[5])
    keep = 1.0 + 0.0 * p
    if damage > 0:
        damage_place = state.shape[0] - 1
        mean, deviator = tensors.deviator((t[0], t[1], t[2], t[3], t[4], t[5]))
        size = tensors.contract(deviator, deviator)
        D_new = state[damage_place]
        if size.real > 0.0:
            D_new += damage_growth_of(damage, 0.5 * product(t, e), mean / (np.sqrt(size) / ROOT), p, growth,
                                      flow_params)
        if D_new.real > MOST_DAMAGE:
            D_new = MOST_DAMAGE + 0.0 * D_new
        state_new[damage_place] = D_new
        keep = 1.0 - D_new
    stress = tensors.congruence(tensors.transposed(turn), (keep * t[0], keep * t[1], keep * t[2], keep * t[3],
                                                           keep * t[4], keep * t[5]))
    tensors.store(first_piola(R, U, inverse_cp, g, stress), P)
    return 0


@inner
def remember(back, U, e, turn, trial, growth, state, flow_params, state_new):
    """Cp^-1, p and back strains after a plastic step into the state; returns g."""
    g_new = tensors.congruence(tensors.transposed(turn), of_strain((e[0], e[1], e[2], e[3], e[4], e[5])))
    u = inverse_of(U)
    c = tensors.congruence(full(u), g_new)
    state_new[0], state_new[1], state_new[2] = c[0] - 1.0, c[1] - 1.0, c[2] - 1.0
    state_new[3], state_new[4], state_new[5] = c[3], c[4], c[5]
    state_new[6] = state[6] + growth
    for term in range(len(back) // 2 - 1):
        w = recovery(back, term, growth, flow_params)[2]
        for i in range(6):
            m = 7 + 6 * term + i
            state_new[m] = w * (state[m] + trial[i] - e[i])
    return g_new
