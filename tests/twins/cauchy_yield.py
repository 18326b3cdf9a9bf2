"""J2 plasticity whose yield condition holds the Cauchy stress, as CalculiX has it; idic's own laws hold the Kirchhoff
stress, J times as large. A law file of the user: ``idic --laws cauchy_yield.py``."""

import numpy as np

from idic.materials import LawParameter, LawSpec, register
from idic.materials.core import tensors
from idic.materials.plasticity.elastoplastic import (ALTERNATIVES, PARAMETERS, ROOT, STATE_NAMES, cp_after,
                                                     shear_and_bulk, trial_state)


def update(F, state, params, dt, P, state_new):
    """One point: |s| = sqrt(2/3) J (yield_stress + H p), which a linear hardening solves in one step."""
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
    tau = tensors.scaled(keep * G, dev, kappa * (J - 1.0) * J)
    tensors.store(tensors.times_transposed(tau, fi), P)
    return 0


register(LawSpec(
    name="j2_cauchy", updates={"finite": update}, state_names=STATE_NAMES, alternatives=ALTERNATIVES,
    parameters=(*PARAMETERS, LawParameter("hardening_modulus", "MPa", "slope of the flow stress over plastic strain",
                                          default=1000.0, null=0.0, positive=False, bounds=(-np.inf, np.inf))),
    reference="CalculiX CrunchiX user's manual, *PLASTIC"))
