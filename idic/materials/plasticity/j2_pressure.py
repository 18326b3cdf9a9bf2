"""Pressure-dependent (Drucker-Prager) plasticity with linear hardening and flow without change of volume.

    q = yield_stress + friction pressure + hardening_modulus p,   pressure = -tr(tau) / 3

q the Mises stress of tau. ``yield_stress`` is the Mises stress at yield in pure shear; tension yields at
yield_stress / (1 + friction / 3), compression at yield_stress / (1 - friction / 3). Flow is along the deviator
(measured dilation of metals and polymers is far below that of the associated rule: Spitzig & Richmond 1984), so the
pressure is known before the return and the equation of ``elastoplastic.py`` (symbols there) is linear in x:

    x = (|s| - sqrt(2/3) (yield_stress + friction pressure + hardening_modulus p)) / (2 G I + 2/3 hardening_modulus)

The dissipation is q dp/dt >= 0. Where tension leaves no strength the deviator vanishes: a fluid under tension, which a
simulation will not pass through but the search for F33 may. friction = 0 is ``j2_linear``.
"""

from __future__ import annotations

from idic.materials.core import tensors
from idic.materials.core.law import LawParameter, LawSpec, register
from idic.materials.plasticity import elastoplastic
from idic.materials.plasticity.elastoplastic import ROOT
from idic.materials.plasticity.j2_isotropic import HARDENING_MODULUS

YIELD, HARDENING, FRICTION = 2, 3, 4


def update(F, state, params, dt, P, state_new):
    """One point, real or complex."""
    G, kappa = elastoplastic.shear_and_bulk(params[0], params[1])
    J, fi, b, mean, dev, norm, shrink = elastoplastic.trial_state(F, state)
    if not J.real > 0.0:
        return 1
    spherical = kappa * (J - 1.0) * J  # -pressure
    keep = 1.0 + 0.0 * J
    for m in range(7):
        state_new[m] = state[m]
    beyond = G * norm - ROOT * (params[YIELD] - params[FRICTION] * spherical + params[HARDENING] * state[6])
    if beyond.real > 0.0:
        x = beyond / (2.0 * G * mean + 2.0 / 3.0 * params[HARDENING])
        keep = 1.0 - 2.0 * mean * x / norm
        if x.real < 0.0:  # softens faster than it unloads
            return 1
        if keep.real <= 0.0:
            x, keep = norm / (2.0 * mean), 0.0 * keep
        elastoplastic.cp_after(fi, keep, mean, dev, 1.0 / shrink, state_new)
        state_new[6] = state[6] + ROOT * x
    tau = tensors.scaled(keep * G, dev, spherical)
    tensors.store(tensors.times_transposed(tau, fi), P)
    return 0


def linearise(F, state, params, dt, dF, dstate, dparams, P, state_new, dP, dstate_new):
    """`update` and its derivative (as ``j2_isotropic.py``; the pressure moves the flow stress)."""
    G, kappa = elastoplastic.shear_and_bulk(params[0], params[1])
    trial = elastoplastic.trial_state(F, state)
    J, fi, b, mean, dev, norm, shrink = trial
    if not J > 0.0:
        return 1
    for m in range(7):
        state_new[m] = state[m]
    spherical = kappa * (J - 1.0) * J
    beyond = G * norm - ROOT * (params[YIELD] - params[FRICTION] * spherical + params[HARDENING] * state[6])
    plastic, x, keep, inverse_slope, scale = beyond > 0.0, 0.0, 1.0, 0.0, 1.0 / shrink
    if plastic:
        inverse_slope = 1.0 / (2.0 * G * mean + 2.0 / 3.0 * params[HARDENING])
        x = beyond * inverse_slope
        keep = 1.0 - 2.0 * mean * x / norm
        if x < 0.0:
            return 1
        if keep <= 0.0:
            x, keep, inverse_slope = norm / (2.0 * mean), 0.0, 0.5 / (G * mean)
        elastoplastic.cp_after(fi, keep, mean, dev, scale, state_new)
        state_new[6] = state[6] + ROOT * x
    tau = tensors.scaled(keep * G, dev, spherical)
    tensors.store(tensors.times_transposed(tau, fi), P)
    strong = keep > 0.0
    solution = (plastic, x, keep, inverse_slope, params[HARDENING] if strong else 0.0, scale, tau)
    for k in range(dF.shape[0]):
        ell = tensors.product(tensors.load(dF[k]), fi)
        dspherical = kappa * (2.0 * J - 1.0) * J * (ell[0] + ell[4] + ell[8])
        dG, dkappa, dflow, dp = 0.0, 0.0, 0.0, 0.0
        if dparams.shape[0] > 0:
            dG, dkappa = elastoplastic.elastic_change(params, dparams[k])
            dspherical += dkappa * (J - 1.0) * J
            dflow = dparams[k, YIELD] + state_new[6] * dparams[k, HARDENING] - spherical * dparams[k, FRICTION]
        if dstate.shape[0] > 0:
            dp = dstate[k, 6]
        dflow = dflow - params[FRICTION] * dspherical if strong else 0.0
        elastoplastic.one_direction(F, trial, solution, (G, kappa, dG, dkappa, dflow, dp), k, dF, dstate,
                                    dP, dstate_new)
    return 0


LAW = register(LawSpec(
    name="j2_pressure",
    parameters=(
        *elastoplastic.PARAMETERS, HARDENING_MODULUS,
        LawParameter("friction", "-", "growth of the flow stress with the pressure", default=0.3, null=0.0,
                     positive=False, bounds=(-2.9, 2.9)),
    ),
    updates={"finite": update},
    linearise={"finite": linearise},
    state_names=elastoplastic.STATE_NAMES,
    reference="q = yield_stress + friction pressure + hardening_modulus p; Drucker & Prager, Q. Appl. Math. 10 (1952) "
              "157, doi:10.1090/qam/48291; flow: Spitzig & Richmond, Acta Metall. 32 (1984) 457, "
              "doi:10.1016/0001-6160(84)90119-6; return: Simo (1992), doi:10.1016/0045-7825(92)90123-2",
    alternatives=elastoplastic.ALTERNATIVES,
))
