"""J2 plasticity with power-law hardening through a known strain: sigma = yield_stress + K0 (p / ep0)^n.

The same curves as ``j2_power``, K = K0 ep0^-n. K is the stress that hardening would add at a plastic strain of 1; where
a test ends at less than 1 %, K and n cannot be told apart (correlation 0.999) and K0, the stress added at a strain ep0
of the test, can be. ep0 is chosen, not identified: K0 and n follow it without any change of the curve.
"""

from __future__ import annotations

from idic.materials.core.law import DerivedQuantity, LawParameter, LawSpec, register
from idic.materials.plasticity import elastoplastic
from idic.materials.plasticity.hardening import POWER_REFERENCE


def update(F, state, params, dt, P, state_new):
    """See ``elastoplastic.py``."""
    return elastoplastic.update(POWER_REFERENCE, F, state, params, P, state_new)


def linearise(F, state, params, dt, dF, dstate, dparams, P, state_new, dP, dstate_new):
    """`update` and its derivative."""
    return elastoplastic.linearise(POWER_REFERENCE, F, state, params, dF, dstate, dparams, P, state_new,
                                   dP, dstate_new)


def factor_at_one(K0, n, ep0):
    """K of ``j2_power``."""
    return K0 * ep0**-n


LAW = register(LawSpec(
    name="j2_power_reference",
    parameters=(
        *elastoplastic.PARAMETERS,
        LawParameter("K0", "MPa", "hardening stress at the plastic strain ep0", default=50.0, null=0.0),
        LawParameter("n", "-", "exponent of the power law", default=0.3, bounds=(0.0, 5.0)),
        LawParameter("ep0", "-", "plastic strain at which K0 is added; about half the largest of the test, locked",
                     default=2e-3),
    ),
    updates={"finite": update},
    linearise={"finite": linearise},
    state_names=elastoplastic.STATE_NAMES,
    reference="sigma = yield_stress + K0 (p / ep0)^n (Ludwik 1909); return: Simo (1992), "
              "doi:10.1016/0045-7825(92)90123-2",
    alternatives=elastoplastic.ALTERNATIVES,
    derived={"K": DerivedQuantity("MPa", factor_at_one)},
))
