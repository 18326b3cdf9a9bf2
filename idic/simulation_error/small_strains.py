"""The error of small strains: what the same law with finite strains and rotations moves otherwise.

It changes the force nearly as another stiffness does, so that no residual need show it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from idic.laws import get_law
from idic.model import Experiment, MotionError
from idic.simulation_error.comparison import (
    ErrorInFrames, ModelPoint, BetterModel, error_in_every_frame, error_in_frames,
)
from idic.simulation_error.limits import LIMITS


def with_finite_strains(experiment: Experiment) -> Experiment | None:
    """The experiment with the finite form of every law of small strains; None where there is none, or a law has no
    such form."""
    model = experiment.model
    small = [material for material in model.materials if material.kinematics == "small"]
    if model.solver is not None or not small:
        return None
    if any("finite" not in get_law(material.law).kinematics for material in small):
        return None
    return replace(experiment, model=replace(model, motion_error=None, materials=tuple(
        replace(material, kinematics="finite") for material in model.materials)))


def strain_error(point: ModelPoint) -> MotionError | None:
    """What a simulation with small strains lacks of that with finite ones; None where the model has them, or where
    none can be made or simulated."""
    finite = with_finite_strains(point.experiment)
    if finite is None:
        return None
    return error_in_every_frame(point, BetterModel(finite, point.local, lambda state, better: better.u - state.u, True))


def strain_error_in(point: ModelPoint, frames: np.ndarray, motions: Sequence[np.ndarray]) -> ErrorInFrames | None:
    """The same in some frames, of the seen surface; None also where the model is large.

    frames : the reference and later ones; motions : (n_nodes, dim) mm of each of them: first guesses
    """
    finite = with_finite_strains(point.experiment)
    if finite is None or point.experiment.model.mesh.n_nodes > LIMITS.solid:
        return None
    finite_model = BetterModel(finite, point.local, lambda state, better: better.seen_u - state.seen_u)
    return error_in_frames(point, finite_model, frames, motions, motions)
