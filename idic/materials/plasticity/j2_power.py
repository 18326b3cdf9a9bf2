"""J2 plasticity with power-law hardening: sigma = yield_stress + K p^n."""

from __future__ import annotations

from idic.materials.core.law import LawParameter, LawSpec, register
from idic.materials.plasticity import elastoplastic
from idic.materials.plasticity.hardening import POWER


def update(F, state, params, dt, P, state_new):
    """See ``elastoplastic.py``."""
    return elastoplastic.update(POWER, F, state, params, P, state_new)


def linearise(F, state, params, dt, dF, dstate, dparams, P, state_new, dP, dstate_new):
    """`update` and its derivative."""
    return elastoplastic.linearise(POWER, F, state, params, dF, dstate, dparams, P, state_new,
                                   dP, dstate_new)


LAW = register(LawSpec(
    name="j2_power",
    parameters=(
        *elastoplastic.PARAMETERS,
        LawParameter("K", "MPa", "factor of the power law", default=300.0, null=0.0),
        LawParameter("n", "-", "exponent of the power law", default=0.3, bounds=(0.0, 5.0)),
    ),
    updates={"finite": update},
    linearise={"finite": linearise},
    state_names=elastoplastic.STATE_NAMES,
    reference="sigma = yield_stress + K p^n (Ludwik 1909); return: Simo (1992), doi:10.1016/0045-7825(92)90123-2",
    alternatives=elastoplastic.ALTERNATIVES,
))
