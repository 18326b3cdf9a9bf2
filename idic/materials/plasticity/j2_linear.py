"""J2 plasticity with linear isotropic hardening: sigma = yield_stress + hardening_modulus p."""

from __future__ import annotations

import numpy as np

from idic.materials.core.law import LawParameter, LawSpec, register
from idic.materials.plasticity import elastoplastic
from idic.materials.plasticity.hardening import LINEAR


def update(F, state, params, dt, P, state_new):
    """See ``elastoplastic.py``."""
    return elastoplastic.update(LINEAR, F, state, params, P, state_new)


def linearise(F, state, params, dt, dF, dstate, dparams, P, state_new, dP, dstate_new):
    """`update` and its derivative."""
    return elastoplastic.linearise(LINEAR, F, state, params, dF, dstate, dparams, P, state_new,
                                   dP, dstate_new)


LAW = register(LawSpec(
    name="j2_linear",
    parameters=(
        *elastoplastic.PARAMETERS,
        LawParameter("hardening_modulus", "MPa", "slope of the flow stress over plastic strain", default=1000.0,
                     null=0.0, positive=False, bounds=(-np.inf, np.inf)),
    ),
    updates={"finite": update},
    linearise={"finite": linearise},
    state_names=elastoplastic.STATE_NAMES,
    reference="sigma = yield_stress + hardening_modulus p; return: Simo (1992), doi:10.1016/0045-7825(92)90123-2",
    alternatives=elastoplastic.ALTERNATIVES,
))
