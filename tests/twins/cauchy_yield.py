"""J2 plasticity whose yield condition holds the Cauchy stress, as CalculiX has it."""

import numpy as np

from idic.materials import LawSpec, get_law, register
from idic.materials.composed import isotropic_return
from idic.materials.composed.flow_stress import LINEAR, NONE

SURFACE, HARDENING, RATE = (isotropic_return.MISES, 0), (LINEAR, 3, NONE, 0), (NONE, 0)


def update(F, state, params, dt, P, state_new):
    """The law `j2_linear` with J sigma(p) in the place of sigma(p): Kirchhoff stress is J times Cauchy stress."""
    J = (F[0, 0] * (F[1, 1] * F[2, 2] - F[1, 2] * F[2, 1]) - F[0, 1] * (F[1, 0] * F[2, 2] - F[1, 2] * F[2, 0])
         + F[0, 2] * (F[1, 0] * F[2, 1] - F[1, 1] * F[2, 0]))
    own = np.empty(4, dtype=F.dtype)
    own[0], own[1], own[2], own[3] = params[0], params[1], params[2] * J, params[3] * J
    return isotropic_return.update(SURFACE, HARDENING, RATE, F, state, own, 1.0, P, state_new)


LIKE = get_law("j2_linear")
register(LawSpec(name="j2_cauchy", parameters=LIKE.parameters, updates={"finite": update},
                 state_names=LIKE.state_names, alternatives=LIKE.alternatives,
                 reference="CalculiX CrunchiX user's manual, *PLASTIC"))
