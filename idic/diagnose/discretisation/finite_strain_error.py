"""The error of small strains: what the same law with finite strains and rotations moves otherwise.

It changes the force nearly as another stiffness does, so that no residual need show it.
"""

from __future__ import annotations

from dataclasses import replace

from idic.diagnose.discretisation.mesh_error import lacking
from idic.identify.in_memory import Identification
from idic.materials import get_law
from idic.model.experiment import Experiment
from idic.model.motion_error import MotionError


def with_finite_strains(experiment: Experiment) -> Experiment | None:
    """The experiment with the finite form of every law of small strains; None where there is none, or a law has no
    such form."""
    small = [material for material in experiment.materials if material.kinematics == "small"]
    if experiment.solver is not None or not small:
        return None
    if any("finite" not in get_law(material.law).kinematics for material in small):
        return None
    return replace(experiment, motion_error=None, materials=tuple(
        replace(material, kinematics="finite") for material in experiment.materials))


def finite_strain_error(found: Identification) -> MotionError | None:
    """What a simulation with small strains lacks of that with finite ones; None where the model has them, or where
    none can be made or simulated."""
    finite = with_finite_strains(found.experiment)
    if finite is None:
        return None
    return lacking(found, replace(found.experiment, motion_error=None), finite, found.local, lambda u, other: other - u)
