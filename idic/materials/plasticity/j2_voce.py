"""J2 plasticity with Voce hardening: sigma = yield_stress + Q (1 - exp(-b p)) + hardening_modulus p."""

from __future__ import annotations

import numpy as np

from idic.materials.core.law import LawParameter, LawSpec, register
from idic.materials.plasticity import elastoplastic
from idic.materials.plasticity.hardening import VOCE


def update(F, state, params, dt, P, state_new):
    """See ``elastoplastic.py``."""
    return elastoplastic.update(VOCE, F, state, params, P, state_new)


def linearise(F, state, params, dt, dF, dstate, dparams, P, state_new, dP, dstate_new):
    """`update` and its derivative."""
    return elastoplastic.linearise(VOCE, F, state, params, dF, dstate, dparams, P, state_new,
                                   dP, dstate_new)


LAW = register(LawSpec(
    name="j2_voce",
    parameters=(
        *elastoplastic.PARAMETERS,
        LawParameter("Q", "MPa", "saturation of the hardening", default=100.0, null=0.0, positive=False,
                     bounds=(-np.inf, np.inf)),
        LawParameter("b", "-", "rate of the saturation over plastic strain", default=20.0, null=0.0),
        LawParameter("hardening_modulus", "MPa", "final slope of the flow stress over plastic strain", default=200.0,
                     null=0.0, positive=False, bounds=(-np.inf, np.inf)),
    ),
    updates={"finite": update},
    linearise={"finite": linearise},
    state_names=elastoplastic.STATE_NAMES,
    reference="sigma = yield_stress + Q (1 - exp(-b p)) + hardening_modulus p; "
              "Voce (1948); return: Simo (1992), doi:10.1016/0045-7825(92)90123-2",
    alternatives=elastoplastic.ALTERNATIVES,
))
