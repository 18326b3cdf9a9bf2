"""J2 plasticity with kinematic hardening (Prager; Armstrong-Frederick) and linear isotropic hardening.

The return of ``elastoplastic.py`` (symbols there) with a back stress, beta = 2/3 C R a R^T: R is the rotation of
F = R U and ``a``, a back strain, stays in the reference configuration (the Green-Naghdi rate, without a rate):

    beta0 = 2/3 C R a R^T,  w = 1 / (1 + gamma dp),  A = s - w beta0,  n = A / |A|,  dp = sqrt(2/3) x
    |A| - (2 G I + 2/3 C w) x - sqrt(2/3) (yield_stress + hardening_modulus (p + dp)) = 0
    s+ = s - 2 G I x n,  a+ = w (a + x R^T n R),  tau = s+ + kappa (J - 1) J 1

so that da/dt = (plastic strain rate) - gamma a dp/dt. gamma = 0 is Prager's linear hardening, C = 0 is ``j2_linear``;
in tension the back stress saturates at C / gamma.
"""

from __future__ import annotations

import numpy as np

from idic.materials.core import tensors
from idic.materials.core.inner import inner
from idic.materials.core.law import LawParameter, LawSpec, register
from idic.materials.plasticity import elastoplastic
from idic.materials.plasticity.elastoplastic import ABSOLUTE_TOLERANCE, MAX_ITERATIONS, RELATIVE_TOLERANCE, ROOT
from idic.materials.plasticity.j2_isotropic import LINEAR, flow_stress

C_MODULUS, GAMMA = 4, 5
MAX_POLAR_ITERATIONS = 60
POLAR_TOLERANCE = 1e-4  # change of R, quadratic: 1e-8 and 1e-16 in the next two iterations, which are still made


@inner
def rotation(f):
    """R of f = R U, det f > 0, real or complex: Newton's iteration (Higham 1986) of the mean of R and R^-T."""
    det, inv = tensors.inverse(f)
    size = det ** (-1.0 / 3.0)
    r = (size * f[0], size * f[1], size * f[2], size * f[3], size * f[4], size * f[5], size * f[6], size * f[7],
         size * f[8])
    left = MAX_POLAR_ITERATIONS
    while left > 0:
        left -= 1
        det, inv = tensors.inverse(r)
        new = (0.5 * (r[0] + inv[0]), 0.5 * (r[1] + inv[3]), 0.5 * (r[2] + inv[6]),
               0.5 * (r[3] + inv[1]), 0.5 * (r[4] + inv[4]), 0.5 * (r[5] + inv[7]),
               0.5 * (r[6] + inv[2]), 0.5 * (r[7] + inv[5]), 0.5 * (r[8] + inv[8]))
        change = (abs(new[0].real - r[0].real) + abs(new[1].real - r[1].real) + abs(new[2].real - r[2].real)
                  + abs(new[3].real - r[3].real) + abs(new[4].real - r[4].real) + abs(new[5].real - r[5].real)
                  + abs(new[6].real - r[6].real) + abs(new[7].real - r[7].real) + abs(new[8].real - r[8].real))
        r = new
        if change < POLAR_TOLERANCE:
            left = min(left, 2)
    return r


@inner
def transposed(a):
    """a^T of a 9-tuple."""
    return a[0], a[3], a[6], a[1], a[4], a[7], a[2], a[5], a[8]


@inner
def yield_function(s, beta, x, stiffness, p, params):
    """(value, slope over x, w, A, |A|) of the equation at the top."""
    dp = ROOT * x
    w = 1.0 / (1.0 + params[GAMMA] * dp)
    A = tensors.combine(1.0, s, -w, beta, 0.0)
    norm = np.sqrt(tensors.contract(A, A))
    flow, hardening = flow_stress(LINEAR, p + dp, params)
    back = 2.0 / 3.0 * params[C_MODULUS] * w
    value = norm - (stiffness + back * x) - ROOT * flow
    slope = ROOT * params[GAMMA] * w * w * tensors.contract(A, beta) / norm - back * w - 2.0 / 3.0 * hardening
    return value, slope, w, A, norm


@inner
def real_parts(s):
    """Real parts of a 6-tuple."""
    return s[0].real, s[1].real, s[2].real, s[3].real, s[4].real, s[5].real


@inner
def plastic_multiplier(s, beta, twice_shear, p, params):
    """Root x > 0 of the yield function (all real but params); -1 where there is none. Bracketed Newton."""
    high = (np.sqrt(tensors.contract(s, s)) + np.sqrt(tensors.contract(beta, beta))) / twice_shear
    largest, low, x = high, 0.0, 0.0
    for _ in range(MAX_ITERATIONS):
        value, slope, _, _, _ = yield_function(s, beta, x, twice_shear * x, p, params)
        if value.real > 0.0:
            low = x
        else:
            high = x
        new = x + value.real / (twice_shear - slope.real)
        converged = abs(new - x) <= RELATIVE_TOLERANCE * x
        if not low < new < high:
            new, converged = 0.5 * (low + high), False
        if converged or abs(new - x) <= ABSOLUTE_TOLERANCE * largest:
            strong = flow_stress(LINEAR, p + ROOT * new, params)[0].real > 0.0  # else softened away
            return new if strong and new < (1.0 - 1e-10) * largest else -1.0
        x = new
    return -1.0


def update(F, state, params, dt, P, state_new):
    """One point, real or complex."""
    G, kappa = elastoplastic.shear_and_bulk(params[0], params[1])
    J, fi, b, mean, dev, _, shrink = elastoplastic.trial_state(F, state)
    if not J.real > 0.0:
        return 1
    p = state[6]
    for m in range(13):
        state_new[m] = state[m]
    s = tensors.scaled(G, dev, 0.0)
    R = rotation(tensors.load(F))
    a = tensors.congruence(R, (state[7], state[8], state[9], state[10], state[11], state[12]))
    beta = tensors.scaled(2.0 / 3.0 * params[C_MODULUS], a, 0.0)
    if yield_function(s, beta, 0.0 * p, 0.0 * p, p, params)[0].real > 0.0:
        twice_shear = 2.0 * G * mean
        x = plastic_multiplier(real_parts(s), real_parts(beta), twice_shear.real, p.real, params)
        if x < 0.0:
            return 1
        value, slope, _, _, _ = yield_function(s, beta, x + 0.0 * p, twice_shear * x, p, params)
        x = x + value / (twice_shear.real - slope.real)  # one more step, in complex: exact derivative
        _, _, w, A, norm = yield_function(s, beta, x, twice_shear * x, p, params)
        n = tensors.scaled(1.0 / norm, A, 0.0)
        s = tensors.combine(1.0, s, -twice_shear * x, n, 0.0)
        scale = 1.0 / shrink
        c = tensors.congruence(fi, tensors.scaled(scale / G, s, mean * scale))
        state_new[0], state_new[1], state_new[2] = c[0] - 1.0, c[1] - 1.0, c[2] - 1.0
        state_new[3], state_new[4], state_new[5] = c[3], c[4], c[5]
        state_new[6] = p + ROOT * x
        after = tensors.congruence(transposed(R), tensors.combine(w, a, w * x, n, 0.0))
        state_new[7], state_new[8], state_new[9] = after[0], after[1], after[2]
        state_new[10], state_new[11], state_new[12] = after[3], after[4], after[5]
    tau = tensors.scaled(1.0, s, kappa * (J - 1.0) * J)
    tensors.store(tensors.times_transposed(tau, fi), P)
    return 0


LAW = register(LawSpec(
    name="j2_kinematic",
    parameters=(
        *elastoplastic.PARAMETERS,
        LawParameter("hardening_modulus", "MPa", "isotropic part: slope of the size of the elastic range over plastic "
                     "strain", default=500.0, null=0.0, positive=False, bounds=(-np.inf, np.inf)),
        LawParameter("C", "MPa", "kinematic modulus: initial slope of the back stress over plastic strain",
                     default=5000.0, null=0.0),
        LawParameter("gamma", "-", "recovery of the back stress (0: Prager's linear hardening)", default=50.0,
                     null=0.0),
    ),
    updates={"finite": update},
    state_names=(*elastoplastic.STATE_NAMES, *(f"back{c}" for c in ("11", "22", "33", "12", "13", "23"))),
    reference="back stress: Prager (1956), J. Appl. Mech. 23, 493; Armstrong & Frederick (1966), reprinted in Mater. "
              "High Temp. 24 (2007) 1; rotated with R of F = R U (Green & Naghdi); return: Simo (1992), "
              "doi:10.1016/0045-7825(92)90123-2",
    alternatives=elastoplastic.ALTERNATIVES,
))
