"""Plasticity with Hosford's yield surface, which is no quadratic form: a truth that shares no code with idic's laws.

Finite strains by Hencky's energy and principal stretches; sigma = [(|t1 - t2|^m + |t2 - t3|^m + |t3 - t1|^m) / 2]^(1/m)
of the Kirchhoff stresses t, m = 8 (Hosford, J. Appl. Mech. 39 (1972) 607, doi:10.1115/1.3422732).
"""

import numpy as np
from numba import njit

from idic.laws import LawParameter, LawSpec, all_laws, compile, register

M = 8  # the powers below are written for it
MOST_STEPS, TOLERANCE = 60, 1e-11
STATE = ("c11", "c22", "c33", "c12", "unused_1", "unused_2", "p")  # in-plane inverse plastic metric, plastic strain
NAMES = ("E", "nu", "yield_stress", "Q", "b", "hardening_modulus")


@njit
def sixth(x):
    """Powers of complex numbers by products: a power by logarithms adds more imaginary part than the complex step."""
    return x * x * x * x * x * x


@njit
def surface(t):
    """Hosford's stress and its gradient, and the second derivative of (its M-th power)/M."""
    a, b, c = t[0] - t[1], t[1] - t[2], t[2] - t[0]
    a6, b6, c6 = sixth(a), sixth(b), sixth(c)
    q = np.sqrt(np.sqrt(np.sqrt(0.5 * (a6 * a * a + b6 * b * b + c6 * c * c))))
    over = 0.5 / (sixth(q) * q)
    g = np.empty_like(t)
    g[0], g[1], g[2] = a6 * a - c6 * c, b6 * b - a6 * a, c6 * c - b6 * b
    H = np.empty((3, 3), dtype=t.dtype)
    ka, kb, kc = (M - 1) * a6, (M - 1) * b6, (M - 1) * c6
    H[0, 0], H[1, 1], H[2, 2] = ka + kc, ka + kb, kb + kc
    H[0, 1] = H[1, 0] = -ka
    H[1, 2] = H[2, 1] = -kb
    H[0, 2] = H[2, 0] = -kc
    return q, over * g, over * H


@njit
def flow_stress(params, p):
    """Voce and linear hardening, and their slope."""
    falling = np.exp(-params[4] * p)
    return (params[2] + params[3] * (1.0 - falling) + params[5] * p, params[3] * params[4] * falling + params[5])


@njit
def lame_of(params):
    """Shear modulus, Lamé's first constant."""
    G = params[0] / (2.0 * (1.0 + params[1]))
    return G, 2.0 * G * params[1] / (1.0 - 2.0 * params[1])


@njit
def returned(trial, params, p):
    """Principal logarithmic elastic strains after the return, the increment of p, whether Newton ended."""
    G, lame = lame_of(params)
    e, x = trial.copy(), 0.0 * trial[0]
    t = 2.0 * G * e + lame * (e[0] + e[1] + e[2])
    if surface(t)[0].real <= flow_stress(params, p)[0].real:
        return e, x, True
    ended = False
    for _ in range(MOST_STEPS):
        t = 2.0 * G * e + lame * (e[0] + e[1] + e[2])
        q, n, H = surface(t)
        flow, slope = flow_stress(params, p + x)
        r = np.empty(4, dtype=t.dtype)
        r[:3], r[3] = e - trial + x * n, (q - flow) / G
        if ended:
            return e, x, True
        ended = np.abs(r).max() < TOLERANCE  # one step more: derivatives by the complex step follow one behind
        curve = H - (M - 1) / q * np.outer(n, n)  # of q over t
        A = np.zeros((4, 4), dtype=t.dtype)
        for i in range(3):
            for j in range(3):
                A[i, j] = (1.0 if i == j else 0.0) + x * 2.0 * G * curve[i, j]  # curve has no trace: no volume
            A[i, 3], A[3, i] = n[i], 2.0 * G * n[i] / G
        A[3, 3] = -slope / G
        step = np.linalg.solve(A, r)
        size = 1.0
        if np.abs(step[:3]).max() > 0.5 * np.abs(e).max():  # far steps end on the wrong side of an edge
            size = 0.5 * np.abs(e).max() / np.abs(step[:3]).max()
        e, x = e - size * step[:3], x - size * step[3]
    return e, x, False


def update(F, state, params, dt, P, state_new):
    """Stress of an F without shear out of the plane."""
    area = F[0, 0] * F[1, 1] - F[0, 1] * F[1, 0]
    if not (area * F[2, 2]).real > 0.0:
        return 1
    c11, c22, c33, c12 = state[0], state[1], state[2], state[3]
    b11 = F[0, 0] * (c11 * F[0, 0] + c12 * F[0, 1]) + F[0, 1] * (c12 * F[0, 0] + c22 * F[0, 1])
    b22 = F[1, 0] * (c11 * F[1, 0] + c12 * F[1, 1]) + F[1, 1] * (c12 * F[1, 0] + c22 * F[1, 1])
    b12 = F[0, 0] * (c11 * F[1, 0] + c12 * F[1, 1]) + F[0, 1] * (c12 * F[1, 0] + c22 * F[1, 1])
    mean, half = 0.5 * (b11 + b22), 0.5 * (b11 - b22)
    r = np.sqrt(half * half + b12 * b12 + 1e-24)
    trial = 0.5 * np.log(np.array([mean + r, mean - r, c33 * F[2, 2] ** 2]))
    e, x, ended = returned(trial, params, state[6])
    if not ended:
        return 1
    G, lame = lame_of(params)
    t = 2.0 * G * e + lame * (e[0] + e[1] + e[2])
    middle, steep = 0.5 * (t[0] + t[1]), 0.5 * (t[0] - t[1]) / r
    s11, s22, s12 = middle + steep * half, middle - steep * half, steep * b12
    i11, i12, i21, i22 = F[1, 1] / area, -F[0, 1] / area, -F[1, 0] / area, F[0, 0] / area
    P[:, :] = 0.0
    P[0, 0], P[0, 1] = s11 * i11 + s12 * i12, s11 * i21 + s12 * i22
    P[1, 0], P[1, 1] = s12 * i11 + s22 * i12, s12 * i21 + s22 * i22
    P[2, 2] = t[2] / F[2, 2]
    l1, l2 = np.exp(2.0 * e[0]), np.exp(2.0 * e[1])
    middle, steep = 0.5 * (l1 + l2), 0.5 * (l1 - l2) / r
    e11, e22, e12 = middle + steep * half, middle - steep * half, steep * b12
    state_new[0] = i11 * (e11 * i11 + e12 * i12) + i12 * (e12 * i11 + e22 * i12)
    state_new[1] = i21 * (e11 * i21 + e12 * i22) + i22 * (e12 * i21 + e22 * i22)
    state_new[2] = np.exp(2.0 * e[2]) / F[2, 2] ** 2
    state_new[3] = i11 * (e11 * i21 + e12 * i22) + i12 * (e12 * i21 + e22 * i22)
    state_new[4], state_new[5], state_new[6] = state[4], state[5], state[6] + x
    return 0


def hosford(stress: np.ndarray) -> np.ndarray:
    """Hosford's stress of plane stresses 11, 22, 12  # (m, 3) → (m,)"""
    mean, r = 0.5 * (stress[:, 0] + stress[:, 1]), np.hypot(0.5 * (stress[:, 0] - stress[:, 1]), stress[:, 2])
    a, b = mean + r, mean - r
    return (0.5 * (a**M + b**M + (a - b) ** M)) ** (1.0 / M)


def hosford_law():
    """The law, registered once."""
    if "true_hosford" not in all_laws():
        register(LawSpec("true_hosford", tuple(LawParameter(name, "-", name) for name in NAMES), {"finite": update},
                         state_names=STATE, initial_state=(1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0),
                         reference="truth of a test"))
    return compile("true_hosford")
