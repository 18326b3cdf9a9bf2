"""J2 plasticity with Swift's hardening: sigma = K (eps0 + p)^n, which yields first at K eps0^n.

Ludwik's form, yield_stress + K p^n, is ``j2_power``.
"""

from __future__ import annotations

import math

from idic.materials.core.law import LawParameter, LawSpec, register
from idic.materials.elastic import ELASTIC_PARAMETERS
from idic.materials.plasticity import elastoplastic
from idic.materials.plasticity.hardening import SWIFT


def update(F, state, params, dt, P, state_new):
    """See ``elastoplastic.py``."""
    return elastoplastic.update(SWIFT, F, state, params, P, state_new)


def linearise(F, state, params, dt, dF, dstate, dparams, P, state_new, dP, dstate_new):
    """`update` and its derivative."""
    return elastoplastic.linearise(SWIFT, F, state, params, dF, dstate, dparams, P, state_new,
                                   dP, dstate_new)


LAW = register(LawSpec(
    name="j2_swift",
    parameters=(
        *ELASTIC_PARAMETERS,
        LawParameter("K", "MPa", "flow stress where eps0 + plastic strain is 1", default=500.0, null=math.inf),
        LawParameter("eps0", "-", "pre-strain; the initial yield stress is K eps0^n", default=0.01,
                     bounds=(0.0, 1.0)),
        LawParameter("n", "-", "exponent (0: no hardening, sigma = K)", default=0.2, null=0.0, bounds=(0.0, 5.0)),
    ),
    updates={"finite": update},
    linearise={"finite": linearise},
    state_names=elastoplastic.STATE_NAMES,
    reference="sigma = K (eps0 + p)^n; Swift, J. Mech. Phys. Solids 1 (1952) 1, doi:10.1016/0022-5096(52)90002-1; "
              "return: Simo (1992), doi:10.1016/0045-7825(92)90123-2",
    alternatives=elastoplastic.ALTERNATIVES,
))
