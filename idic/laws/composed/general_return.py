"""The return of a composed law with back stresses, Hill's surface or damage; all derivatives but the tangent by the
complex step.

s and the back strains a_i stand in axes that turn with the material (R of F = R U; with Hill also by ``angle`` about
z). One unknown, the growth of p, for any number of terms (symbols of ``plasticity/elastoplastic.py``):

    w_i = 1 / (1 + gamma_i growth),  z = growth / resistance,  h = 2 G I + sum 2/3 C_i w_i
    xi = (1 + z h A)^-1 (s - sum 2/3 C_i w_i a_i),     q(xi) = sqrt(xi : A xi) = resistance(p + growth, growth / dt)
    strain = z A xi,  s+ = s - 2 G I strain,  a_i+ = w_i (a_i + strain)

(A = 3/2 on deviators: Mises; ``plasticity/hill48.py`` has Hill's, ``plasticity/free_locus.py`` a free surface, of which
A xi stands for q dq/dxi). gamma = 0 is Prager's back stress. Damage acts on
the stress of this effective material: tau = (1 - D) (s+ + kappa (J - 1) J 1), with Lemaitre's

    dD = (Y / S)^s dp,   Y = q^2 / (2 E) (2/3 (1 + nu) + 3 (1 - 2 nu) (mean stress / q)^2)   beyond p = threshold,

q and the mean stress of the effective stress at the end of the step. Growth falls to nothing as mean stress / q goes
from 0 to -1/3, uniaxial compression (cut-off: Bao & Wierzbicki, Eng. Fract. Mech. 72 (2005) 1049,
doi:10.1016/j.engfracmech.2004.07.011; smooth between), and D ends at 0.99. Hardening follows p of the effective
material, so the return does not depend on D. Free surface: docs/method.md, equation 12.10.
"""

from __future__ import annotations

import math

import numpy as np
from numba import types
from numba.extending import overload

from idic.laws.composed.flow_stress import flow_stress, most_growth, resistance
from idic.laws.composed.isotropic_return import HILL48, MISES, flows
from idic.laws.composed.elastic_strain import full, inverse, stretch
from idic.laws.composed.strain_steps import IDENTITY, change_of_stretch, symmetric_product
from idic.laws.core import symmetric, tensors
from idic.laws.core.inner import inner
from idic.laws.core.rotation import real_parts, rotation, to_axes
from idic.laws.plasticity.elastoplastic import (
    ABSOLUTE_TOLERANCE,
    MAX_ITERATIONS,
    RELATIVE_TOLERANCE,
    ROOT,
    shear_and_bulk,
    trial_state,
)
from idic.laws.plasticity import free_locus
from idic.laws.plasticity.hill48 import coefficients, flow_direction, returned

PRAGER, ARMSTRONG_FREDERICK = 1, 2
ANGLE = 3  # place of the angle behind Hill's r0, r45, r90
MOST_DAMAGE = 0.99
UNKNOWN = (math.nan, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
LENGTH_OF_FREE = 3  # of the tuple of a free surface: code, place, knots on a ring


@inner
def hill_coefficients(surface, first, params):
    """(f, g, h, n) of the yield condition as in ``hill48.py``, r0, r45, r90 from place `first` on; of Mises too."""
    if surface != HILL48:
        half = 0.5 + 0.0 * params[0]
        return half, half, half, 3.0 * half
    return coefficients(first, params)


@inner
def back_strain(state, term):
    """The back strain of a term (0, 1, ...), as a 6-tuple."""
    i = 7 + 6 * term
    return state[i], state[i + 1], state[i + 2], state[i + 3], state[i + 4], state[i + 5]


@inner
def recovery(back, term, growth, params):
    """(2/3 C, gamma, w) of a term."""
    first = back[2 * term + 1]
    gamma = params[first + 1] if back[2 * term] == ARMSTRONG_FREDERICK else 0.0 * params[first]
    return 2.0 / 3.0 * params[first], gamma, 1.0 / (1.0 + gamma * growth)


@inner
def relative(back, s, growth, state, params):
    """(s - sum 2/3 C w a, its slope over growth, sum 2/3 C w, its slope)."""
    zero = 0.0 * growth
    A, dA, sum_C, dsum_C = s, (zero, zero, zero, zero, zero, zero), zero, zero
    for term in range(len(back) // 2 - 1):
        C, gamma, w = recovery(back, term, growth, params)
        a = back_strain(state, term)
        A = tensors.combine(1.0, A, -C * w, a, 0.0)
        dA = tensors.combine(1.0, dA, C * gamma * w * w, a, 0.0)
        sum_C += C * w
        dsum_C -= C * gamma * w * w
    return A, dA, sum_C, dsum_C


@inner
def yield_function(surface, hardening, back, rate, s, twice_shear, state, p, growth, dt, hill, params, xi_start):
    """(value, its slope over growth, strain, xi, slope of xi): the equation at the top, beside Mises as 1 / resistance
    - 1 / q; xi_start : real, where the search for xi begins."""
    flow, dflow, _ = resistance(hardening, rate, p, growth, dt, 0.0 * p, params)
    A, dA, sum_C, dsum_C = relative(back, s, growth, state, params)
    h = twice_shear + sum_C
    if surface[0] == MISES:
        norm = np.sqrt(tensors.contract(A, A))
        slope = tensors.contract(A, dA) / norm / ROOT - 1.5 * (h + dsum_C * growth) - dflow
        return norm / ROOT - 1.5 * h * growth - flow, slope, tensors.scaled(growth / ROOT / norm, A, 0.0), A, dA
    z = growth / flow
    w, dw = z * h, (1.0 - z * dflow) / flow * h + z * dsum_C
    xi, direction, dxi = returned_to(surface, A, dA, w, dw, hill, params, xi_start)
    q = np.sqrt(tensors.contract(direction, xi))
    dq = tensors.contract(direction, dxi) / q
    return 1.0 / flow - 1.0 / q, dq / (q * q) - dflow / (flow * flow), tensors.scaled(z, direction, 0.0), xi, dxi


def returned_to(surface, A, dA, w, dw, hill, params, xi_start):
    """(xi, q dq/dxi, slope of xi over growth) of (1 + w q dq/dxi) xi = A, where A and w have the slopes dA and dw.

    xi_start : of a free surface, where the search begins; in complex passes the real solution. A free surface is a
    tuple of three, any other one of two: laws without it do not compile it.
    """
    raise TypeError("returned_to is called by compiled functions only")


@overload(returned_to, strict=False)
def _returned_to(surface, A, dA, w, dw, hill, params, xi_start):
    if surface.count == LENGTH_OF_FREE:
        solve = free_locus.returned_with_derivative if isinstance(w, types.Complex) else free_locus.returned

        def implementation(surface, A, dA, w, dw, hill, params, xi_start):
            n, first = surface[2], surface[1] + 1
            xi = solve(n, first, A, w, params, xi_start)
            direction, change = free_locus.direction_and_change(n, first, xi, w, dA, dw, params)
            return xi, direction, change
    else:
        def implementation(surface, A, dA, w, dw, hill, params, xi_start):
            xi = returned(A, w, hill)
            direction = flow_direction(xi, hill)
            return xi, direction, returned(tensors.combine(1.0, dA, -dw, direction, 0.0), w, hill)
    return implementation


def direction_of(surface, s, hill, params):
    """q dq/ds of a deviator in material axes."""
    raise TypeError("direction_of is called by compiled functions only")


@overload(direction_of, strict=False)
def _direction_of(surface, s, hill, params):
    if surface.count == LENGTH_OF_FREE:
        return lambda surface, s, hill, params: free_locus.direction(surface[2], surface[1] + 1, s, params)
    return lambda surface, s, hill, params: flow_direction(s, hill)


@inner
def plastic_growth(surface, hardening, back, rate, s, twice_shear, state, p, q, dt, hill, params):
    """(root of the yield function, xi there), all real; -1 where there is none. Newton inside a bracket, from the
    middle."""
    size = np.sqrt(tensors.contract(s, s)) / ROOT
    for term in range(len(back) // 2 - 1):
        a = back_strain(state, term)
        size += 2.0 / 3.0 * params[back[2 * term + 1]] * np.sqrt(tensors.contract(a, a)) / ROOT
    largest = size / (1.5 * twice_shear)
    sigma = flow_stress(hardening, p, params)[0]
    limit = max(most_growth(hardening, rate, max(size, q), p, sigma, dt, params), ABSOLUTE_TOLERANCE * largest)
    low, high = 0.0, limit if surface[0] != MISES else min(largest, limit)
    x = 0.5 * min((q - sigma) / (1.5 * twice_shear), high)
    xi_start = tensors.scaled(1.0 / (1.0 + 1.5 * twice_shear * x / max(sigma, 1e-3 * size)), s,
                              0.0)  # xi of Mises, about
    for _ in range(MAX_ITERATIONS):
        value, slope, _, xi, dxi = yield_function(surface, hardening, back, rate, s, twice_shear, state, p, x, dt,
                                                  hill, params, xi_start)
        if value > 0.0:
            low = x
        else:
            high = x
        next_growth = x - value / slope
        converged = abs(next_growth - x) <= RELATIVE_TOLERANCE * x
        if not low <= next_growth <= high:
            next_growth, converged = (2.0 * low + largest if high == math.inf else 0.5 * (low + high)), False
        if converged or abs(next_growth - x) <= ABSOLUTE_TOLERANCE * largest:
            strong = flow_stress(hardening, p + next_growth, params)[0] > 0.0  # else softened away
            root = next_growth if strong and (surface[0] != MISES or next_growth < (1.0 - 1e-10) * largest) else -1.0
            return root, tensors.combine(1.0, xi, next_growth - x, dxi, 0.0)
        xi_start = tensors.combine(1.0, xi, next_growth - x, dxi, 0.0)
        x = next_growth
    return -1.0, xi_start


@inner
def damage_growth(first, s, spherical, p, growth, params):
    """Growth of D over a step that ends with the effective stress s + spherical 1 and p + growth."""
    if not growth.real > 0.0:
        return 0.0 * growth
    q = np.sqrt(tensors.contract(s, s)) / ROOT
    nu, ratio = params[1], spherical / q
    energy = q * q / (2.0 * params[0]) * (2.0 / 3.0 * (1.0 + nu) + 3.0 * (1.0 - 2.0 * nu) * ratio * ratio)
    return damage_growth_of(first, energy, ratio, p, growth, params)


@inner
def damage_growth_of(first, energy, ratio, p, growth, params):
    """Growth of D of a step that ends with the energy density Y, ``ratio`` = mean stress / q, and p + growth."""
    p_new = p + growth
    if not (growth.real > 0.0 and p_new.real > params[first + 2].real):
        return 0.0 * growth
    opened = 1.0 + 3.0 * ratio  # 0 in uniaxial compression, 1 in shear
    if not opened.real > 0.0:
        return 0.0 * growth
    weight = opened * opened * (3.0 - 2.0 * opened) if opened.real < 1.0 else 1.0 + 0.0 * opened
    counted = growth if p.real > params[first + 2].real else p_new - params[first + 2]
    if params[first + 3].real > 0.0:  # length over size of the element: plastic opening counts, not strain
        counted = counted / params[first + 3]
    return (energy / params[first]) ** params[first + 1] * counted * weight


@inner
def put(s, out, place):
    """A 6-tuple into the state."""
    for m in range(6):
        out[place + m] = s[m]


@inner
def update(surface, hardening, back, rate, damage, F, state, params, dt, P, state_new):
    """One point, real or complex."""
    return turned(surface, hardening, back, rate, damage, rotation(tensors.load(F)), UNKNOWN, F, state, params, dt, P,
                  state_new)[0]


@inner
def tangent(surface, hardening, back, rate, damage, F, state, params, dt, P, state_new, A, work):
    """`update` and its tangent, from the changes of the second Piola-Kirchhoff stress along six strains."""
    f = tensors.load(F)
    R = rotation(f)
    U = stretch(R, f)
    inverse_U, F_U, P_U = inverse(U), work[1, 0].reshape((3, 3)), work[1, 1].reshape((3, 3))
    tensors.store(full(U), F_U)
    status, growth, xi_start = turned(surface, hardening, back, rate, damage, IDENTITY, UNKNOWN, F_U, state, params, dt,
                                      P_U, state_new)
    if status != 0:
        return 1
    S = symmetric_product(inverse_U, P_U)
    tensors.store(symmetric.times(f, S), P)
    G, kappa = shear_and_bulk(params[0], params[1])
    J, fi, b, mean, dev, _, _ = trial_state(F_U, state)
    turn, hill, trial = IDENTITY, hill_coefficients(surface[0], surface[1], params), tensors.scaled(G, dev, 0.0)
    if surface[0] != MISES:
        turn = to_axes(IDENTITY, params[surface[1] + (ANGLE if surface[0] == HILL48 else 0)])
        trial = tensors.congruence(turn, trial)
    plastic, twice_shear, spherical, damage_place = growth > 0.0, 2.0 * G * mean, kappa * (J - 1.0) * J, len(state) - 1
    slope, strain, xi, dxi = 0.0, tensors.scaled(0.0, trial, 0.0), trial, trial
    if plastic:
        _, slope, strain, xi, dxi = yield_function(surface, hardening, back, rate, trial, twice_shear, state, state[6],
                                                   growth, dt, hill, params, xi_start)
    flow = resistance(hardening, rate, state[6], growth, dt, 0.0, params)[0] if plastic else 1.0
    end = tensors.combine(1.0, trial, -twice_shear, strain, 0.0)
    tau = tensors.scaled(1.0, tensors.congruence(tensors.transposed(turn), end), spherical)
    damaged = damage > 0 and plastic and state_new[damage_place] < MOST_DAMAGE
    keep = 1.0 - state_new[damage_place] if damage > 0 else 1.0
    for k in range(6):
        dU = change_of_stretch(U, inverse_U, tensors.unit_strain(k))
        ell = tensors.product(dU, full(inverse_U))
        t = ell[0] + ell[4] + ell[8]
        dmean, ddev = tensors.deviator(tensors.combine(1.0, tensors.twice_symmetric(ell, b), -2.0 / 3.0 * t, b, 0.0))
        dtrial, dshear, dgrowth, dD = tensors.scaled(G, ddev, 0.0), 2.0 * G * dmean, 0.0, 0.0
        dspherical = kappa * (2.0 * J - 1.0) * J * t
        if surface[0] != MISES:
            dtrial = tensors.congruence(turn, dtrial)
        dend = dtrial
        if plastic:
            dgrowth, dstrain = change_of_return(surface, back, trial, twice_shear, state, growth, flow, slope, strain,
                                                xi, dxi, dtrial, dshear, hill, params)
            dend = tensors.combine(1.0, dtrial, -dshear, strain, 0.0)
            dend = tensors.combine(1.0, dend, -twice_shear, dstrain, 0.0)
        if damaged:
            dD = damage_change(damage, end, spherical, state[6], growth, dend, dspherical, dgrowth, params)
        dtau = tensors.scaled(keep, tensors.congruence(tensors.transposed(turn), dend), keep * dspherical)
        dtau = tensors.combine(1.0, dtau, -dD, tau, 0.0)
        moved = tensors.twice_symmetric(tensors.product(full(inverse_U), dU), S)
        dS = tensors.combine(1.0, tensors.congruence(full(inverse_U), dtau), -1.0, moved, 0.0)
        D = work[0]
        D[0, k], D[1, k], D[2, k], D[3, k], D[4, k], D[5, k] = dS
    tensors.push_tangent(f, S, work[0], A)
    return 0


@inner
def change_of_return(surface, back, trial, twice_shear, state, growth, flow, slope, strain, xi, dxi, dtrial, dshear,
                     hill, params):
    """(change of the growth, of the strain) where s changes by dtrial and 2 G I by dshear; real.

    slope : of the yield function over the growth; dxi : of xi. From z h A xi = (s - sum 2/3 C w a) - xi follows the
    change of the strain z A xi whatever the surface.
    """
    shifted, dshifted, sum_C, dsum_C = relative(back, trial, growth, state, params)
    if surface[0] == MISES:
        norm = np.sqrt(tensors.contract(shifted, shifted))
        along = tensors.contract(shifted, dtrial) / norm
        dgrowth = -(along / ROOT - 1.5 * dshear * growth) / slope
        along += dgrowth * tensors.contract(shifted, dshifted) / norm
        change = tensors.combine(1.0, dtrial, dgrowth, dshifted, 0.0)
        unit = growth / ROOT / norm
        return dgrowth, tensors.combine(unit, change, dgrowth / ROOT / norm - unit * along / norm, shifted, 0.0)
    h, z = twice_shear + sum_C, growth / flow
    xi_end, direction, change = returned_to(surface, shifted, dtrial, z * h, z * dshear, hill, params, xi)
    q = np.sqrt(tensors.contract(direction, xi_end))
    dgrowth = -tensors.contract(direction, change) / (q * q * q) / slope
    difference = tensors.combine(1.0, dtrial, dgrowth, dshifted, 0.0)
    difference = tensors.combine(1.0, difference, -1.0, tensors.combine(1.0, change, dgrowth, dxi, 0.0), 0.0)
    return dgrowth, tensors.combine(1.0 / h, difference, -(dshear + dgrowth * dsum_C) / h, strain, 0.0)


@inner
def damage_change(first, s, spherical, p, growth, ds, dspherical, dgrowth, params):
    """Change of `damage_growth` along ds, dspherical and dgrowth; by the complex step."""
    h = 1e-30j
    step = (s[0] + h * ds[0], s[1] + h * ds[1], s[2] + h * ds[2], s[3] + h * ds[3], s[4] + h * ds[4], s[5] + h * ds[5])
    return damage_growth(first, step, spherical + h * dspherical, p, growth + h * dgrowth, params).imag / 1e-30


@inner
def turned(surface, hardening, back, rate, damage, R, root, F, state, params, dt, P, state_new):
    """(status, growth, xi) of one point whose material axes are turned by R; growth and xi are real.

    root : (growth, xi) where they are known, else growth is NaN
    """
    G, kappa = shear_and_bulk(params[0], params[1])
    J, fi, b, mean, dev, _, shrink = trial_state(F, state)
    if not J.real > 0.0:
        return 1, root[0], root[1]
    p, real_params, real_state = state[6], params.real, state.real
    for m in range(state.shape[0]):
        state_new[m] = state[m]
    turn = tensors.transposed(R)
    if surface[0] != MISES:
        turn = to_axes(R, params[surface[1] + (ANGLE if surface[0] == HILL48 else 0)])
    spherical = kappa * (J - 1.0) * J
    s = tensors.scaled(G, dev, 0.0)
    local, hill = tensors.congruence(turn, s), hill_coefficients(surface[0], surface[1], params)
    A = relative(back, local, 0.0 * p, state, params)[0]
    real_A, real_hill = real_parts(A), (hill[0].real, hill[1].real, hill[2].real, hill[3].real)
    q = np.sqrt(tensors.contract(real_A, direction_of(surface, real_A, real_hill, real_params)))
    growth = 0.0 * p
    if flows(hardening, rate, q, p.real, dt, 0.0, real_params):
        twice_shear = 2.0 * G * mean
        real, xi_start = root
        if not real >= 0.0:
            real, xi_start = plastic_growth(surface, hardening, back, rate, real_parts(local), twice_shear.real,
                                            real_state, p.real, q, dt, real_hill, real_params)
        if real < 0.0:
            return 1, real, xi_start
        root = (real, xi_start)
        growth, strain = real + 0.0 * p, tensors.scaled(0.0 * p, local, 0.0)
        for sweep in range(2):  # one more step, in complex: exact derivative; then the strain that belongs to it
            value, slope, strain, _, _ = yield_function(surface, hardening, back, rate, local, twice_shear, state, p,
                                                        growth, dt, hill, params, xi_start)
            growth -= value / slope.real if sweep == 0 else 0.0 * value
        local = tensors.combine(1.0, local, -twice_shear, strain, 0.0)
        s = tensors.congruence(tensors.transposed(turn), local)
        scale = 1.0 / shrink
        c = tensors.congruence(fi, tensors.scaled(scale / G, s, mean * scale))
        put((c[0] - 1.0, c[1] - 1.0, c[2] - 1.0, c[3], c[4], c[5]), state_new, 0)
        state_new[6] = p + growth
        for term in range(len(back) // 2 - 1):
            w = recovery(back, term, growth, params)[2]
            put(tensors.combine(w, back_strain(state, term), w, strain, 0.0), state_new, 7 + 6 * term)
    keep = 1.0 + 0.0 * p
    if damage > 0:
        damage_place = state.shape[0] - 1
        D = state[damage_place] + damage_growth(damage, local, spherical, p, growth, params)
        if D.real > MOST_DAMAGE:
            D = MOST_DAMAGE + 0.0 * D
        state_new[damage_place] = D
        keep = 1.0 - D
    tau = tensors.scaled(keep, s, keep * spherical)
    tensors.store(tensors.times_transposed(tau, fi), P)
    return 0, root[0], root[1]
