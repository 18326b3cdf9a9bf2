"""Plasticity with Hill's (1948) quadratic yield condition for rolled sheet, and Voce hardening.

The split and the elasticity are those of ``elastoplastic.py`` (symbols there). The stress is turned back with R of
F = R U and into material axes (1 the rolling direction, at ``angle`` from the mesh's x axis about z; 3 = z):

    q^2 = f (s22 - s33)^2 + g (s33 - s11)^2 + h (s11 - s22)^2 + 3 (s23^2 + s13^2) + 2 n s12^2 = s : A s
    g = 1 / (1 + r0),  h = r0 g,  f = h / r90,  n = (r0 + r90) (1 + 2 r45) g / (2 r90)
    s+ = s - 2 G I z A s+,  q(s+) = sigma(p+),  p+ = p + q(s+) z,  tau = R s+ R^T + kappa (J - 1) J 1

r0, r45, r90 are the ratios of width to thickness strain (Lankford) of tension strips cut at 0, 45 and 90 degrees, sigma
is the flow stress of the strip along the rolling direction, and p is conjugate to it. Shear through the thickness is as
in the isotropic law; elasticity is isotropic. With r0 = r45 = r90 = 1 it is ``j2_voce``. The yield surface is convex
as long as the ratios are positive.
"""

from __future__ import annotations

import math

import numpy as np

from idic.materials.core import tensors
from idic.materials.core.inner import inner
from idic.materials.core.law import LawParameter, LawSpec, register
from idic.materials.plasticity import elastoplastic
from idic.materials.plasticity.elastoplastic import ABSOLUTE_TOLERANCE, MAX_ITERATIONS, RELATIVE_TOLERANCE
from idic.materials.plasticity.j2_isotropic import VOCE, VOCE_PARAMETERS, flow_stress
from idic.materials.plasticity.j2_kinematic import real_parts, rotation, transposed

R0, R45, R90, ANGLE = 6, 7, 8, 9


@inner
def coefficients(params):
    """(f, g, h, n) of the yield condition; real or complex."""
    g = 1.0 / (1.0 + params[R0])
    h = params[R0] * g
    return h / params[R90], g, h, 0.5 * (params[R0] + params[R90]) * (1.0 + 2.0 * params[R45]) * g / params[R90]


@inner
def to_axes(R, angle):
    """Rotation from the current frame into the material axes, (R Q)^T, as a 9-tuple."""
    c, s = np.cos(angle * (math.pi / 180.0)), np.sin(angle * (math.pi / 180.0))
    return transposed((c * R[0] + s * R[1], c * R[1] - s * R[0], R[2],
                       c * R[3] + s * R[4], c * R[4] - s * R[3], R[5],
                       c * R[6] + s * R[7], c * R[7] - s * R[6], R[8]))


@inner
def returned(s, z, a):
    """s+ of s+ + z A s+ = s, a deviator in material axes; a = (f, g, h, n)."""
    f, g, h, n = a
    a11, a12 = 1.0 + z * (2.0 * g + h), z * (g - h)  # s33 = -s11 - s22 is eliminated
    a21, a22 = z * (f - h), 1.0 + z * (2.0 * f + h)
    below = 1.0 / (a11 * a22 - a12 * a21)
    s11, s22 = (a22 * s[0] - a12 * s[1]) * below, (a11 * s[1] - a21 * s[0]) * below
    across = 1.0 / (1.0 + 1.5 * z)
    return s11, s22, -s11 - s22, s[3] / (1.0 + z * n), s[4] * across, s[5] * across


@inner
def flow_direction(s, a):
    """A s of a deviator in material axes."""
    f, g, h, n = a
    return ((g + h) * s[0] - h * s[1] - g * s[2], (f + h) * s[1] - h * s[0] - f * s[2],
            (f + g) * s[2] - g * s[0] - f * s[1], n * s[3], 1.5 * s[4], 1.5 * s[5])


@inner
def yield_function(s, w, stiffness, p, a, params):
    """(q(s+), its slope over w, sigma(p+), its slope over w, s+) at w = z stiffness, with stiffness = 2 G I.

    s+ = B^-1 s with B = 1 + w A, so dq/dw = -(A s+) : B^-1 (A s+) / q.
    """
    after = returned(s, w, a)
    direction = flow_direction(after, a)
    q = np.sqrt(tensors.contract(after, direction))
    dq = -tensors.contract(direction, returned(direction, w, a)) / q
    flow, hardening = flow_stress(VOCE, p + q * w / stiffness, params)
    return q, dq, flow, hardening * (q + w * dq) / stiffness, after


@inner
def plastic_multiplier(s, stiffness, p, a, params):
    """Root w > 0 of q(s+) = sigma(p+), all real but params; -1 where there is none.

    Newton on 1/q - 1/sigma, nearly a straight line in w, bracketed; without an upper end a bad step doubles the lower.
    """
    a = (a[0].real, a[1].real, a[2].real, a[3].real)
    low, high, x = 0.0, math.inf, 0.0
    for _ in range(MAX_ITERATIONS):
        q, dq, sigma, dsigma, _ = yield_function(s, x, stiffness, p, a, params)
        flow = sigma.real
        if not flow > 0.0:  # softened away
            return -1.0
        if q > flow:
            low = x
        else:
            high = x
        step = (1.0 / flow - 1.0 / q) / (dsigma.real / (flow * flow) - dq / (q * q))
        new = x + step
        converged = abs(step) <= RELATIVE_TOLERANCE * x
        if not low <= new <= high:
            new, converged = (2.0 * low + 1.0 if high == math.inf else 0.5 * (low + high)), False
        if converged or abs(new - x) <= ABSOLUTE_TOLERANCE:
            return new
        x = new
    return -1.0


def update(F, state, params, dt, P, state_new):
    """One point, real or complex."""
    G, kappa = elastoplastic.shear_and_bulk(params[0], params[1])
    J, fi, b, mean, dev, _, shrink = elastoplastic.trial_state(F, state)
    if not J.real > 0.0:
        return 1
    p = state[6]
    for m in range(7):
        state_new[m] = state[m]
    s = tensors.scaled(G, dev, 0.0)
    turn = to_axes(rotation(tensors.load(F)), params[ANGLE])
    local, a = tensors.congruence(turn, s), coefficients(params)
    q = np.sqrt(tensors.contract(local, flow_direction(local, a)))
    if q.real > flow_stress(VOCE, p, params)[0].real:
        stiffness = 2.0 * G * mean
        x = plastic_multiplier(real_parts(local), stiffness.real, p.real, a, params)
        if x < 0.0:
            return 1
        q, dq, flow, dflow, _ = yield_function(local, x + 0.0 * p, stiffness, p, a, params)
        x = x + (q - flow) / (dflow.real - dq.real)  # one more step, in complex: exact derivative
        q, _, _, _, after = yield_function(local, x, stiffness, p, a, params)
        s = tensors.congruence(transposed(turn), after)
        scale = 1.0 / shrink
        c = tensors.congruence(fi, tensors.scaled(scale / G, s, mean * scale))
        state_new[0], state_new[1], state_new[2] = c[0] - 1.0, c[1] - 1.0, c[2] - 1.0
        state_new[3], state_new[4], state_new[5] = c[3], c[4], c[5]
        state_new[6] = p + q * x / stiffness
    tau = tensors.scaled(1.0, s, kappa * (J - 1.0) * J)
    tensors.store(tensors.times_transposed(tau, fi), P)
    return 0


def _ratio(name: str, where: str, default: float) -> LawParameter:
    return LawParameter(name, "-", f"width over thickness strain of a strip {where} the rolling direction",
                        default=default, null=1.0, bounds=(0.05, 20.0))


LAW = register(LawSpec(
    name="j2_hill",
    parameters=(
        *elastoplastic.PARAMETERS, *VOCE_PARAMETERS,
        _ratio("r0", "along", 1.6), _ratio("r45", "at 45 degrees to", 1.2), _ratio("r90", "across", 2.0),
        LawParameter("angle", "deg", "from the mesh's x axis to the rolling direction, about z", default=0.0, null=0.0,
                     positive=False, bounds=(-np.inf, np.inf)),
    ),
    updates={"finite": update},
    state_names=elastoplastic.STATE_NAMES,
    isotropic=False,
    reference="q(s) = yield_stress + Q (1 - exp(-b p)) + hardening_modulus p; Hill, Proc. R. Soc. Lond. A 193 (1948) "
              "281, doi:10.1098/rspa.1948.0045; turned with R of F = R U (Green & Naghdi); split: Simo (1992), "
              "doi:10.1016/0045-7825(92)90123-2",
    alternatives=elastoplastic.ALTERNATIVES,
))
