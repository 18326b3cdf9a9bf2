"""The error of small strains: what the same law with finite strains and rotations moves otherwise.

It changes the force nearly as another stiffness does, so that no residual need show it.
"""

from __future__ import annotations

from dataclasses import replace

from idic.diagnose.discretisation.mesh_error import lacking
from idic.identification import Identification, with_finite_strains
from idic.model import MotionError


def finite_strain_error(found: Identification) -> MotionError | None:
    """What a simulation with small strains lacks of that with finite ones; None where the model has them, or where
    none can be made or simulated."""
    finite = with_finite_strains(found.experiment)
    if finite is None:
        return None
    return lacking(found, replace(found.experiment, motion_error=None), finite, found.local, lambda u, other: other - u)
