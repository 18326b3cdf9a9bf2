"""J2 plasticity as CalculiX has it. Law files of the user: ``idic --laws cauchy_yield.py``.

``j2_cauchy`` : the yield condition holds the Cauchy stress; that of idic's laws the Kirchhoff stress, J times as large.
``j2_calculix`` : its pressure, too, kappa (J^2 - 1) / 2 in place of kappa (J - 1) J (Kirchhoff).
"""

import numpy as np

from idic.laws import LawParameter, LawSpec, register
from idic.laws import tensors
from idic.laws.core.inner import inner
from idic.laws.plasticity.elastoplastic import (ALTERNATIVES, PARAMETERS, ROOT, STATE_NAMES, cp_after,
                                                     shear_and_bulk, trial_state)


@inner
def one_point(F, state, params, P, state_new, calculix):
    """|s| = sqrt(2/3) J (yield_stress + H p), which a linear hardening solves in one step."""
    G, kappa = shear_and_bulk(params[0], params[1])
    J, fi, b, mean, dev, norm, shrink = trial_state(F, state)
    if not J.real > 0.0:
        return 1
    p = state[6]
    keep = 1.0 + 0.0 * J
    for m in range(7):
        state_new[m] = state[m]
    excess = G * norm - ROOT * J * (params[2] + params[3] * p)
    if excess.real > 0.0:
        x = excess / (2.0 * G * mean + 2.0 / 3.0 * J * params[3])
        keep = 1.0 - 2.0 * mean * x / norm
        cp_after(fi, keep, mean, dev, 1.0 / shrink, state_new)
        state_new[6] = p + ROOT * x
    tau = tensors.scaled(keep * G, dev, 0.5 * kappa * (J * J - 1.0) if calculix else kappa * (J - 1.0) * J)
    tensors.store(tensors.times_transposed(tau, fi), P)
    return 0


def update(F, state, params, dt, P, state_new):
    return one_point(F, state, params, P, state_new, False)


def update_calculix(F, state, params, dt, P, state_new):
    return one_point(F, state, params, P, state_new, True)


HARDENING = LawParameter("hardening_modulus", "MPa", "slope of the flow stress over plastic strain",
                         default=1000.0, null=0.0, positive=False, bounds=(-np.inf, np.inf))
for name, function in (("j2_cauchy", update), ("j2_calculix", update_calculix)):
    register(LawSpec(
        name=name, updates={"finite": function}, state_names=STATE_NAMES, alternatives=ALTERNATIVES,
        parameters=(*PARAMETERS, HARDENING),
        reference="CalculiX CrunchiX user's manual, *PLASTIC"))
