"""Isotropic elastic damage: stiffness is lost for good where the equivalent strain exceeds a threshold.

    stress = (1 - d) (lam tr(e) I + 2 mu e),   k = largest sqrt(e : C : e / E) so far
    d = 0 up to k = threshold,  1 - exp(-softening (k - threshold)) beyond

e is the small strain or Green's (then the stress is the second Piola-Kirchhoff stress). In tension k is the strain, and
the stress still rises beyond the threshold until k = 1 / softening. Unloading goes straight back to zero strain:
this, not the loading branch, distinguishes damage from plastic flow. The dissipation (e : C : e / 2) dd/dt is never
negative.

Compression: k^2 is multiplied by w = c + (1 - c) m, with c the parameter ``compression`` and m(x) = x^2 (3 - 2 x),
x = 1 + tr(s) / q within 0 and 1, of the undamaged stress s and its Mises stress q: 1 from shear to tension, 0 from
uniaxial compression on. Stiffness that is lost in tension is lost in compression, too.

A softening body localises into one row of elements. With ``length`` l, and h the size of an element, the part of the
strain behind the peak that unloading does not give back is l / h times as large (crack band, ``core/crack_band.py``):
work per area of the band, and force over elongation of a bar, are those of elements of size l. Behind the peak,
k_p = max(threshold, 1 / softening), with the law's own strain x in the place of k,

    k = x l / h + (1 - l / h) x exp(-softening (x - k_p)),   (1 - d) k = x exp(-softening (x - threshold))
"""

from __future__ import annotations

import math

import numpy as np

from idic.laws.core import symmetric, tensors
from idic.laws.core.crack_band import CrackBand
from idic.laws.core.inner import inner
from idic.laws.core.law import LawParameter, LawSpec, register
from idic.laws.elastic import ELASTIC_ALTERNATIVES, ELASTIC_PARAMETERS, isotropic_tangent, lame, lame_change

THRESHOLD, SOFTENING, COMPRESSION, LENGTH = 2, 3, 4, 5
ITERATIONS = 60  # Newton takes 3 to 8, bisection 50
TOLERANCE = 1e-14


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
def behind_the_peak(k, peak, softening, ratio):
    """(x of k beyond the peak, the slope of k over x), all real; slope 0: the element is too large and snaps back."""
    low, high = (k, k / ratio) if ratio < 1.0 else (peak, k)
    x = low if ratio < 1.0 else high
    for _ in range(ITERATIONS):
        decay = math.exp(-softening * (x - peak))
        excess, slope = x * (ratio + (1.0 - ratio) * decay) - k, ratio + (1.0 - ratio) * (1.0 - softening * x) * decay
        low, high = (low, x) if excess > 0.0 else (x, high)
        x_new = x - excess / slope if slope > 0.0 else high
        if not low <= x_new <= high:
            x_new = 0.5 * (low + high)
        if abs(x_new - x) <= TOLERANCE * x:
            return x_new, ratio + (1.0 - ratio) * (1.0 - softening * x_new) * math.exp(-softening * (x_new - peak))
        x = x_new
    return x, 0.0


@inner
def kept(k, threshold, softening, ratio):
    """(1 - d, slopes of its ln over k, threshold, softening and ratio, status) at the largest strain k, all real."""
    if not k > threshold:
        return 1.0, 0.0, 0.0, 0.0, 0.0, 0
    keep = math.exp(-softening * (k - threshold))
    if not (ratio > 0.0 and softening * k > 1.0):
        return keep, -softening, softening, -(k - threshold), 0.0, 0
    early = softening * threshold < 1.0
    peak = 1.0 / softening if early else threshold
    x, slope = behind_the_peak(k, peak, softening, ratio)
    if not slope > 0.0:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 1
    decay = math.exp(-softening * (x - peak))
    share = (1.0 - ratio) * x * decay / slope  # of a change of ln(decay) in x
    x_softening = share * (x - peak + (1.0 / softening if early else 0.0))
    x_threshold = 0.0 if early else -share * softening
    x_ratio = -x * (1.0 - decay) / slope
    along = 1.0 / x - softening
    return (x / k * math.exp(-softening * (x - threshold)), along / slope - 1.0 / k, along * x_threshold + softening,
            along * x_softening - (x - threshold), along * x_ratio, 0)


@inner
def opened(s, compression):
    """(w, m's slope over x, tr s, q, dev s) of the undamaged stress, real or complex; slope 0 where m is constant."""
    mean, dev = tensors.deviator(s)
    trace, q = 3.0 * mean, np.sqrt(1.5 * tensors.contract(dev, dev))
    if trace.real >= 0.0:
        return 1.0 + 0.0 * q, 0.0 * q, trace, q, dev
    if q.real + trace.real <= 0.0:
        return compression + 0.0 * q, 0.0 * q, trace, q, dev
    x = 1.0 + trace / q
    return (compression + (1.0 - compression) * x * x * (3.0 - 2.0 * x),
            (1.0 - compression) * 6.0 * x * (1.0 - x), trace, q, dev)


@inner
def update(finite, F, state, params, P, state_new):
    """One point, real or complex."""
    lam, mu = lame(params[0], params[1])
    f = tensors.load(F)
    e = strain(finite, f)
    s = tensors.scaled(2.0 * mu, e, lam * (e[0] + e[1] + e[2]))
    energy = tensors.contract(s, e) * opened(s, params[COMPRESSION])[0]
    largest = state[0]
    if energy.real > params[0].real * largest.real * largest.real:
        largest = np.sqrt(energy / params[0])
    threshold, softening, ratio = params[THRESHOLD], params[SOFTENING], params[LENGTH]
    keep, by_k, by_threshold, by_softening, by_ratio, status = kept(largest.real, threshold.real, softening.real,
                                                                    ratio.real)
    growth = by_k * (largest - largest.real) + by_softening * (softening - softening.real) \
        + by_ratio * (ratio - ratio.real)  # 0 but for the complex step
    if largest.real > threshold.real:  # which may be infinite
        growth += by_threshold * (threshold - threshold.real)
    state_new[0] = largest
    store(finite, f, tensors.scaled(keep + keep * growth, s, 0.0), P)
    return status


@inner
def linearise(finite, F, state, params, dF, dstate, dparams, P, state_new, dP, dstate_new):
    """`update` and its derivative."""
    lam, mu = lame(params[0], params[1])
    f = tensors.load(F)
    e = strain(finite, f)
    tr_e = e[0] + e[1] + e[2]
    s = tensors.scaled(2.0 * mu, e, lam * tr_e)
    w, steep, trace, q, dev = opened(s, params[COMPRESSION])
    plain = tensors.contract(s, e)
    energy, largest = plain * w, state[0]
    grows = energy > params[0] * largest * largest
    if grows:
        largest = math.sqrt(energy / params[0])
    keep, by_k, by_threshold, by_softening, by_ratio, status = kept(largest, params[THRESHOLD], params[SOFTENING],
                                                                    params[LENGTH])
    if status != 0:
        return status
    state_new[0] = largest
    damaged_stress = tensors.scaled(keep, s, 0.0)
    store(finite, f, damaged_stress, P)
    for k in range(dF.shape[0]):
        d = tensors.load(dF[k])
        de = strain_change(finite, f, d)
        ds = tensors.scaled(2.0 * mu, de, lam * (de[0] + de[1] + de[2]))
        dplain = 2.0 * tensors.contract(s, de)
        dlargest, dkeep, dw = dstate[k, 0] if dstate.shape[0] > 0 else 0.0, 0.0, 0.0
        if dparams.shape[0] > 0:
            dlam, dmu = lame_change(params[0], params[1], dparams[k, 0], dparams[k, 1])
            modulus_change = tensors.scaled(2.0 * dmu, e, dlam * tr_e)
            ds = tensors.combine(1.0, ds, 1.0, modulus_change, 0.0)
            dplain += tensors.contract(modulus_change, e) - plain / params[0] * dparams[k, 0]
            if params[COMPRESSION] != 1.0:
                dw = (1.0 - w) / (1.0 - params[COMPRESSION]) * dparams[k, COMPRESSION]
            elif trace < 0.0:
                dw = (1.0 - opened(s, 0.0)[0]) * dparams[k, COMPRESSION]
        if steep != 0.0:
            dtrace = ds[0] + ds[1] + ds[2]
            dw += steep * (dtrace - trace * 1.5 * tensors.contract(dev, ds) / (q * q)) / q
        if grows:
            dlargest = (w * dplain + plain * dw) / (2.0 * params[0] * largest)
        if largest > params[THRESHOLD]:
            dkeep = by_k * dlargest
            if dparams.shape[0] > 0:
                dkeep += by_threshold * dparams[k, THRESHOLD] + by_softening * dparams[k, SOFTENING] \
                    + by_ratio * dparams[k, LENGTH]
        store(finite, f, tensors.combine(keep, ds, keep * dkeep, s, 0.0), dP[k])
        if finite:
            moved = symmetric.times(d, damaged_stress)
            for i in range(3):
                for j in range(3):
                    dP[k, i, j] += moved[3 * i + j]
        if k < dstate_new.shape[0]:
            dstate_new[k, 0] = dlargest
    return 0


@inner
def tangent(finite, F, state, params, P, state_new, A):
    """`update` and its tangent: what grows is the largest strain k, and the stress falls along s."""
    lam, mu = lame(params[0], params[1])
    f = tensors.load(F)
    e = strain(finite, f)
    s = tensors.scaled(2.0 * mu, e, lam * (e[0] + e[1] + e[2]))
    w, steep, trace, q, dev = opened(s, params[COMPRESSION])
    plain, largest = tensors.contract(s, e), state[0]
    grows = plain * w > params[0] * largest * largest
    if grows:
        largest = math.sqrt(plain * w / params[0])
    keep, by_k, _, _, _, status = kept(largest, params[THRESHOLD], params[SOFTENING], params[LENGTH])
    if status != 0:
        return status
    state_new[0] = largest
    stress, slope = tensors.scaled(keep, s, 0.0), tensors.scaled(0.0, s, 0.0)
    if grows and largest > params[THRESHOLD]:
        half = 0.5 * keep * by_k / (params[0] * largest)
        slope = tensors.scaled(2.0 * w * half, s, 0.0)
        if steep != 0.0:
            slope = tensors.combine(1.0, slope, -3.0 * mu * trace / (q * q) * half * plain * steep / q, dev,
                                    (3.0 * lam + 2.0 * mu) * half * plain * steep / q)
    store(finite, f, stress, P)
    isotropic_tangent(finite, f, keep * lam, keep * mu, s, slope, stress, A)
    return 0


def tangent_small(F, state, params, dt, P, state_new, A, work):
    """`update_small` and its tangent."""
    return tangent(False, F, state, params, P, state_new, A)


def tangent_finite(F, state, params, dt, P, state_new, A, work):
    """`update_finite` and its tangent."""
    return tangent(True, F, state, params, P, state_new, A)


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


def largest_element(values):
    """Size of the largest element over `length` that does not snap back: l / h > (1 - l / h) m; values : by name."""
    if not (values["softening"] > 0.0 and math.isfinite(values["threshold"])):
        return math.inf
    first = max(values["threshold"] * values["softening"], 1.0)
    steepest = math.exp(first - 2.0) if first < 2.0 else first - 1.0  # m = -min d(x exp(-softening (x - k_p)))/dx
    return (1.0 + steepest) / steepest


LAW = register(LawSpec(
    name="elastic_damage",
    parameters=(
        *ELASTIC_PARAMETERS,
        LawParameter("threshold", "-", "equivalent strain at which damage starts", default=0.005, null=math.inf,
                     activation_factor=0.6),
        LawParameter("softening", "-", "loss of stiffness per equivalent strain beyond the threshold", default=20.0,
                     null=0.0),
        LawParameter("compression", "-", "share of compression in the energy that drives damage; 1: equal to tension",
                     default=1.0, null=1.0, positive=False, bounds=(0.0, 1.0)),
        LawParameter("length", "mm", "element size for which softening holds (crack band); 0: no scaling with the "
                                     "element size",
                     default=1.0, null=0.0),
    ),
    crack_band=CrackBand("length", largest_element),
    updates={"small": update_small, "finite": update_finite},
    linearise={"small": linearise_small, "finite": linearise_finite},
    tangents={"small": tangent_small, "finite": tangent_finite},
    state_names=("largest_strain",),
    reference="stress = (1 - d) C : e with d of the largest sqrt(e : C : e / E); Simo & Ju, Int. J. Solids Struct. 23 "
              "(1987) 821, doi:10.1016/0020-7683(87)90083-7; exponential softening: Lemaitre & Chaboche, Mechanics of "
              "Solid Materials (1990), ch. 7",
    alternatives=ELASTIC_ALTERNATIVES,
))
