"""Reversible nonlinear elasticity: the secant stiffness falls, or rises, with the strain energy; unloading retraces
loading.

    stress = exp(-nonlinearity k) (lam tr(e) I + 2 mu e),   k = sqrt(e : C : e / E)

e is the small strain or Green's (then the stress is the second Piola-Kirchhoff stress). The factor depends on the
energy
e : C : e / 2 alone, so that a potential exists and nothing is dissipated. In tension k is the strain; the tangent
modulus is E exp(-nonlinearity k) (1 - nonlinearity k), which stays positive up to k = 1 / nonlinearity. A negative
value stiffens. Under a load that only grows the law is that of isotropic damage without a threshold; unloading
separates the two.
"""

from __future__ import annotations

import math

import numpy as np

from idic.laws.core import symmetric, tensors
from idic.laws.core.inner import inner
from idic.laws.core.law import LawParameter, LawSpec, register
from idic.laws.elastic import ELASTIC_ALTERNATIVES, ELASTIC_PARAMETERS, isotropic_tangent, lame, lame_change
from idic.laws.elastic_damage import store, strain, strain_change

NONLINEARITY = 2


@inner
def update(finite, F, state, params, P, state_new):
    """One point, real or complex."""
    lam, mu = lame(params[0], params[1])
    f = tensors.load(F)
    e = strain(finite, f)
    s = tensors.scaled(2.0 * mu, e, lam * (e[0] + e[1] + e[2]))
    energy = tensors.contract(s, e)
    k = 0.0 * energy
    if energy.real > 0.0:
        k = np.sqrt(energy / params[0])
    store(finite, f, tensors.scaled(np.exp(-params[NONLINEARITY] * k), s, 0.0), P)
    return 0


@inner
def linearise(finite, F, state, params, dF, dstate, dparams, P, state_new, dP, dstate_new):
    """`update` and its derivative."""
    lam, mu = lame(params[0], params[1])
    f = tensors.load(F)
    e = strain(finite, f)
    trace = e[0] + e[1] + e[2]
    s = tensors.scaled(2.0 * mu, e, lam * trace)
    energy, k = tensors.contract(s, e), 0.0
    if energy > 0.0:
        k = math.sqrt(energy / params[0])
    keep = math.exp(-params[NONLINEARITY] * k)
    stress = tensors.scaled(keep, s, 0.0)
    store(finite, f, stress, P)
    for j in range(dF.shape[0]):
        d = tensors.load(dF[j])
        de = strain_change(finite, f, d)
        ds = tensors.scaled(2.0 * mu, de, lam * (de[0] + de[1] + de[2]))
        denergy, dk = 2.0 * tensors.contract(s, de), 0.0
        if dparams.shape[0] > 0:
            dlam, dmu = lame_change(params[0], params[1], dparams[j, 0], dparams[j, 1])
            modulus_change = tensors.scaled(2.0 * dmu, e, dlam * trace)
            ds = tensors.combine(1.0, ds, 1.0, modulus_change, 0.0)
            denergy += tensors.contract(modulus_change, e) - energy / params[0] * dparams[j, 0]
        if k > 0.0:
            dk = denergy / (2.0 * params[0] * k)
        dkeep = -params[NONLINEARITY] * dk
        if dparams.shape[0] > 0:
            dkeep -= k * dparams[j, NONLINEARITY]
        store(finite, f, tensors.combine(keep, ds, keep * dkeep, s, 0.0), dP[j])
        if finite:
            moved = symmetric.times(d, stress)
            for i in range(3):
                for m in range(3):
                    dP[j, i, m] += moved[3 * i + m]
    return 0


@inner
def tangent(finite, F, params, P, A):
    """`update` and its tangent."""
    lam, mu = lame(params[0], params[1])
    f = tensors.load(F)
    e = strain(finite, f)
    s = tensors.scaled(2.0 * mu, e, lam * (e[0] + e[1] + e[2]))
    energy, k = tensors.contract(s, e), 0.0
    if energy > 0.0:
        k = math.sqrt(energy / params[0])
    keep, fall = math.exp(-params[NONLINEARITY] * k), 0.0
    if k > 0.0:
        fall = -params[NONLINEARITY] * keep / (params[0] * k)
    stress = tensors.scaled(keep, s, 0.0)
    store(finite, f, stress, P)
    isotropic_tangent(finite, f, keep * lam, keep * mu, s, tensors.scaled(fall, s, 0.0), stress, A)
    return 0


def tangent_small(F, state, params, dt, P, state_new, A, work):
    """`update_small` and its tangent."""
    return tangent(False, F, params, P, A)


def tangent_finite(F, state, params, dt, P, state_new, A, work):
    """`update_finite` and its tangent."""
    return tangent(True, F, params, P, A)


def update_small(F, state, params, dt, P, state_new):
    """Small strain."""
    return update(False, F, state, params, P, state_new)


def update_finite(F, state, params, dt, P, state_new):
    """Green's strain."""
    return update(True, F, state, params, P, state_new)


def linearise_small(F, state, params, dt, dF, dstate, dparams, P, state_new, dP, dstate_new):
    """`update_small` and its derivative."""
    return linearise(False, F, state, params, dF, dstate, dparams, P, state_new, dP, dstate_new)


def linearise_finite(F, state, params, dt, dF, dstate, dparams, P, state_new, dP, dstate_new):
    """`update_finite` and its derivative."""
    return linearise(True, F, state, params, dF, dstate, dparams, P, state_new, dP, dstate_new)


LAW = register(LawSpec(
    name="nonlinear_elastic",
    parameters=(
        *ELASTIC_PARAMETERS,
        LawParameter("nonlinearity", "-",
                     "loss of secant stiffness per equivalent strain, reversible; negative stiffens",
                     default=10.0, null=0.0, positive=False, bounds=(-math.inf, math.inf)),
    ),
    updates={"small": update_small, "finite": update_finite},
    linearise={"small": linearise_small, "finite": linearise_finite},
    tangents={"small": tangent_small, "finite": tangent_finite},
    reference="stress = exp(-n k) C : e with k = sqrt(e : C : e / E): a potential in e : C : e exists, hence no "
              "dissipation; Ogden, Non-Linear Elastic Deformations (1997), ch. 4",
    alternatives=ELASTIC_ALTERNATIVES,
))
