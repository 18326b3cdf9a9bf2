"""Isotropic elastic damage: stiffness is lost for good where the equivalent strain exceeds a threshold.

    stress = (1 - d) (lam tr(e) I + 2 mu e),   k = largest sqrt(e : C : e / E) so far
    d = 0 up to k = threshold,  1 - exp(-softening (k - threshold)) beyond

e is the small strain or Green's (then the stress is the second Piola-Kirchhoff stress). In tension k is the strain, and
the stress still rises beyond the threshold until k = 1 / softening. Unloading goes straight back to zero strain:
that, not the loading branch, tells damage from plastic flow. The dissipation (e : C : e / 2) dd/dt is never negative.
A softening body localises into one row of elements: its response after the peak depends on the mesh.
"""

from __future__ import annotations

import math

import numpy as np

from idic.materials.core import symmetric, tensors
from idic.materials.core.inner import inner
from idic.materials.core.law import LawParameter, LawSpec, register
from idic.materials.elastic import ELASTIC_ALTERNATIVES, ELASTIC_PARAMETERS, lame, lame_change

THRESHOLD, SOFTENING = 2, 3


@inner
def strain_change(finite, f, d):
    """Change of the strain along a 9-tuple d; of Green's strain at f."""
    if finite:
        return symmetric.cauchy_green(f, d)
    return d[0], d[4], d[8], 0.5 * (d[1] + d[3]), 0.5 * (d[2] + d[6]), 0.5 * (d[5] + d[7])


@inner
def strain(finite, f):
    """Green's or the small strain of a 9-tuple, as a 6-tuple."""
    if finite:
        return tensors.scaled(0.5, symmetric.cauchy_green(f, f), -0.5)
    return tensors.scaled(1.0, strain_change(finite, f, f), -1.0)


@inner
def store(finite, f, s, P):
    """The first Piola-Kirchhoff stress of s into P."""
    if finite:
        tensors.store(symmetric.times(f, s), P)
    else:
        P[0, 0], P[1, 1], P[2, 2], P[0, 1], P[0, 2], P[1, 2] = s
        P[1, 0], P[2, 0], P[2, 1] = s[3], s[4], s[5]


@inner
def update(finite, F, state, params, P, state_new):
    """One point, real or complex."""
    lam, mu = lame(params[0], params[1])
    f = tensors.load(F)
    e = strain(finite, f)
    s = tensors.scaled(2.0 * mu, e, lam * (e[0] + e[1] + e[2]))
    energy = tensors.contract(s, e)
    largest = state[0]
    if energy.real > params[0].real * largest.real * largest.real:
        largest = np.sqrt(energy / params[0])
    keep = 1.0 + 0.0 * largest
    if largest.real > params[THRESHOLD].real:
        keep = np.exp(-params[SOFTENING] * (largest - params[THRESHOLD]))
    state_new[0] = largest
    store(finite, f, tensors.scaled(keep, s, 0.0), P)
    return 0


@inner
def linearise(finite, F, state, params, dF, dstate, dparams, P, state_new, dP, dstate_new):
    """`update` and its derivative."""
    lam, mu = lame(params[0], params[1])
    f = tensors.load(F)
    e = strain(finite, f)
    trace = e[0] + e[1] + e[2]
    s = tensors.scaled(2.0 * mu, e, lam * trace)
    energy, largest, keep = tensors.contract(s, e), state[0], 1.0
    grows = energy > params[0] * largest * largest
    if grows:
        largest = math.sqrt(energy / params[0])
    damaged = largest > params[THRESHOLD]
    if damaged:
        keep = math.exp(-params[SOFTENING] * (largest - params[THRESHOLD]))
    state_new[0] = largest
    whole = tensors.scaled(keep, s, 0.0)
    store(finite, f, whole, P)
    for k in range(dF.shape[0]):
        d = tensors.load(dF[k])
        de = strain_change(finite, f, d)
        ds = tensors.scaled(2.0 * mu, de, lam * (de[0] + de[1] + de[2]))
        denergy = 2.0 * tensors.contract(s, de)
        dlargest = dstate[k, 0] if dstate.shape[0] > 0 else 0.0
        dkeep = 0.0
        if dparams.shape[0] > 0:
            dlam, dmu = lame_change(params[0], params[1], dparams[k, 0], dparams[k, 1])
            own = tensors.scaled(2.0 * dmu, e, dlam * trace)
            ds = tensors.combine(1.0, ds, 1.0, own, 0.0)
            denergy += tensors.contract(own, e) - energy / params[0] * dparams[k, 0]
        if grows:
            dlargest = denergy / (2.0 * params[0] * largest)
        if damaged:
            dkeep = -params[SOFTENING] * dlargest
            if dparams.shape[0] > 0:
                dkeep += params[SOFTENING] * dparams[k, THRESHOLD] \
                    - (largest - params[THRESHOLD]) * dparams[k, SOFTENING]
        store(finite, f, tensors.combine(keep, ds, keep * dkeep, s, 0.0), dP[k])
        if finite:
            moved = symmetric.times(d, whole)
            for i in range(3):
                for j in range(3):
                    dP[k, i, j] += moved[3 * i + j]
        if k < dstate_new.shape[0]:
            dstate_new[k, 0] = dlargest
    return 0


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
    name="elastic_damage",
    parameters=(
        *ELASTIC_PARAMETERS,
        LawParameter("threshold", "-", "equivalent strain at which damage starts", default=0.005, null=math.inf,
                     activation_factor=0.6),
        LawParameter("softening", "-", "loss of stiffness per equivalent strain beyond the threshold", default=20.0,
                     null=0.0),
    ),
    updates={"small": update_small, "finite": update_finite},
    linearise={"small": linearise_small, "finite": linearise_finite},
    state_names=("largest_strain",),
    reference="stress = (1 - d) C : e with d of the largest sqrt(e : C : e / E); Simo & Ju, Int. J. Solids Struct. 23 "
              "(1987) 821, doi:10.1016/0020-7683(87)90083-7; exponential softening: Lemaitre & Chaboche, Mechanics of "
              "Solid Materials (1990), ch. 7",
    alternatives=ELASTIC_ALTERNATIVES,
))
