"""J2 plasticity whose yield condition holds the Cauchy stress, as CalculiX has it."""

import numpy as np

from idic.materials import LawSpec, register
from idic.materials.plasticity.elastoplastic import ALTERNATIVES, PARAMETERS, STATE_NAMES
from idic.materials.plasticity.j2_isotropic import HARDENING_MODULUS, LINEAR, update_by_return


def update(F, state, params, dt, P, state_new):
    """The law `j2_linear` with J sigma(p) in the place of sigma(p): Kirchhoff stress is J times Cauchy stress."""
    J = (F[0, 0] * (F[1, 1] * F[2, 2] - F[1, 2] * F[2, 1]) - F[0, 1] * (F[1, 0] * F[2, 2] - F[1, 2] * F[2, 0])
         + F[0, 2] * (F[1, 0] * F[2, 1] - F[1, 1] * F[2, 0]))
    own = np.empty(4, dtype=F.dtype)
    own[0], own[1], own[2], own[3] = params[0], params[1], params[2] * J, params[3] * J
    return update_by_return(LINEAR, F, state, own, P, state_new)


register(LawSpec(name="j2_cauchy", parameters=(*PARAMETERS, HARDENING_MODULUS), updates={"finite": update},
                 state_names=STATE_NAMES, alternatives=ALTERNATIVES,
                 reference="CalculiX CrunchiX user's manual, *PLASTIC"))
