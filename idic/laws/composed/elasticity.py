"""Elastic stress in material axes and its tangent: isotropic or orthotropic, with reversible nonlinear terms.

    t = C : e
    t11 += gamma E1 e11^2                                        (fibre: secant modulus E1 (1 + gamma e11))
    t   += gamma k C : e,  k = sqrt(e : C : e / E)               (stiffening: in tension E (1 + gamma |e|))
    2 e12 = t12/G12 + K |t12/G12|^n sign(t12)                    (ramberg_osgood on orthotropic elasticity: shear)
    2 e12 = t12/G12 + alpha t12^3                                (hahn_tsai)
    q_e = x + K x^n,  dev t = 2 G (x / q_e) dev e                (ramberg_osgood on isotropic elasticity)

with q_e^2 = 2/3 dev e : dev e. Every term is the derivative of an energy, so nothing is dissipated. E is E1 where the
body is orthotropic. Terms come as in ``flow_stress.py``; stiffness matrices (6, 6) act on (11, 22, 33, 12, 13, 23) of
the tensor e, shear strains not doubled.
"""

from __future__ import annotations

import numpy as np

from idic.laws.core.inner import inner, inner_with_arrays
from idic.laws.elastic import lame
from idic.laws.orthotropic import stiffness

ISOTROPIC, ORTHOTROPIC = 0, 1
FIBRE, STIFFENING, RAMBERG_OSGOOD, HAHN_TSAI = 1, 2, 3, 4
MAX_ITERATIONS = 200
RELATIVE_TOLERANCE = 1e-9
SMALL = 1e-30  # squared strain that is none


@inner
def linear_stiffness(symmetry, params, C):
    """C of isotropic (E, nu) or orthotropic (E1, E2, nu12, G12) elasticity into (6, 6); returns the shear modulus
    12."""
    C[:, :] = 0.0
    if symmetry == ORTHOTROPIC:
        C11, C12, C13, C22, C23, C33, G12, G23, _, _ = stiffness(params)
    else:
        lam, mu = lame(params[0], params[1])
        C11, C22, C33, C12, C13, C23 = lam + 2.0 * mu, lam + 2.0 * mu, lam + 2.0 * mu, lam, lam, lam
        G12, G23 = mu, mu
    C[0, 0], C[1, 1], C[2, 2] = C11, C22, C33
    C[0, 1], C[0, 2], C[1, 0], C[2, 0] = C12, C13, C12, C13
    C[1, 2], C[2, 1] = C23, C23
    C[3, 3], C[4, 4], C[5, 5] = 2.0 * G12, 2.0 * G12, 2.0 * G23
    return G12


@inner
def compliance(terms, x, G, params):
    """(strain, its slope) over x = stress / modulus of the terms that soften; x >= 0."""
    strain, slope = x, 1.0 + 0.0 * x
    for i in range(0, len(terms) - 2, 2):
        kind, first = terms[i], terms[i + 1]
        if kind == RAMBERG_OSGOOD and x.real > 0.0:
            part = params[first] * x ** params[first + 1]
            strain += part
            slope += params[first + 1] * part / x
        elif kind == HAHN_TSAI:
            part = params[first] * G * G * G
            strain += part * x * x * x
            slope += 3.0 * part * x * x
    return strain, slope


@inner
def inverted(terms, strain, G, params):
    """(x, its slope) of `compliance` = strain >= 0: Newton from above, where the curve is convex; exact in complex."""
    x, real_params, shear = strain.real, params.real, G.real
    for _ in range(MAX_ITERATIONS):
        value, slope = compliance(terms, x, shear, real_params)
        step = (value - strain.real) / slope
        x -= step
        if abs(step) <= RELATIVE_TOLERANCE * x:
            break
    y = x + 0.0 * strain
    value, slope = compliance(terms, y, G, params)
    y -= (value - strain) / slope
    return y, 1.0 / compliance(terms, y, G, params)[1]


@inner
def times(D, e, t):
    """t = D e."""
    for i in range(6):
        t[i] = 0.0
        for j in range(6):
            t[i] += D[i, j] * e[j]


@inner
def weight(i):
    """How often a component of a 6-vector stands in the tensor."""
    return 1.0 if i < 3 else 2.0


@inner_with_arrays
def elastic_stress(symmetry, terms, e, params, t, D):
    """Stress t (6,) and tangent D (6, 6) of the strain e (6,)."""
    G = linear_stiffness(symmetry, params, D)
    times(D, e, t)
    if len(terms) <= 2:
        return
    linear, C = t.copy(), D.copy()
    softens = False
    for i in range(0, len(terms) - 2, 2):
        kind = terms[i]
        softens = softens or kind in (RAMBERG_OSGOOD, HAHN_TSAI)
    if softens and symmetry == ORTHOTROPIC:
        sign = -1.0 if e[3].real < 0.0 else 1.0
        x, slope = inverted(terms, 2.0 * sign * e[3], G, params)
        t[3], D[3, 3] = sign * G * x, 2.0 * G * slope
    elif softens:
        soften_deviator(terms, e, G, params, t, D)
    for i in range(0, len(terms) - 2, 2):
        kind, gamma = terms[i], params[terms[i + 1]]
        if kind == FIBRE:
            t[0] += gamma * params[0] * e[0] * e[0]
            D[0, 0] += 2.0 * gamma * params[0] * e[0]
        elif kind == STIFFENING:
            energy = 0.0 * params[0] + 0.0 * e[0]
            for j in range(6):
                energy += weight(j) * linear[j] * e[j]
            if energy.real > SMALL * params[0].real:
                k = np.sqrt(energy / params[0])
                for j in range(6):
                    t[j] += gamma * k * linear[j]
                    for m in range(6):
                        D[j, m] += gamma * (k * C[j, m] + linear[j] * linear[m] * weight(m) / (k * params[0]))


@inner_with_arrays
def soften_deviator(terms, e, G, params, t, D):
    """The deviator of isotropic elasticity with Ramberg and Osgood's term, into t and D."""
    mean = (e[0] + e[1] + e[2]) / 3.0
    d = e.copy()
    size = 0.0 * (e[0] + G)
    for i in range(6):
        d[i] = e[i] - mean if i < 3 else e[i]
        size += 2.0 / 3.0 * weight(i) * d[i] * d[i]
    if not size.real > SMALL:
        return
    equivalent = np.sqrt(size)
    x, slope = inverted(terms, equivalent, G, params)
    secant = x / equivalent
    for i in range(6):
        t[i] += 2.0 * G * (secant - 1.0) * d[i]
        for j in range(6):
            unit = (1.0 if i == j else 0.0) - (1.0 / 3.0 if i < 3 and j < 3 else 0.0)
            D[i, j] += 2.0 * G * ((secant - 1.0) * unit + (slope - secant) * 2.0 / 3.0 * d[i] * d[j] * weight(j) / size)
