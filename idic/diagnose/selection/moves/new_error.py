"""The error of its own mesh, and of plane stress, of a model that a cause has joined.

Before the cause was known it hid what the recording says of them: without them a further cause would take them up.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from idic.diagnose.discretisation.following import shortened
from idic.diagnose.discretisation.known_error import known_error
from idic.diagnose.discretisation.thickness_error import neglected_errors, with_bricks
from idic.diagnose.discretisation.weight import ErrorWeight, weighed
from idic.diagnose.refits.fitted_model import FittedModel
from idic.diagnose.refits.refit_job import refit_of_one
from idic.diagnose.selection.move import Move
from idic.diagnose.selection.moves.rivals_again import near_rivals
from idic.diagnose.selection.rival import Round
from idic.diagnose.selection.state import Joined, JoinedCause, Selected, State, joined_cause, last_cause
from idic.model import MotionError


def is_looked_at_again(cause: Selected) -> bool:
    """Whether the model that a cause has joined is looked at again: before a further one, or beside others."""
    state = cause.state
    return state.number < state.setting.max_rounds or len(state.rounds) > 1


def as_joined(cause: Selected) -> State:
    """Keeps the model as the cause has joined it."""
    state, rivals = cause.state, tuple(near_rivals(cause.round))
    return replace(state, joined=Joined(state.model.fit, state.model.error, rivals))


def with_new_error(cause: JoinedCause) -> State | None:
    """The model fitted with the error of its own mesh, where that differs from the one before, and of plane stress,
    where the recording asks for it now that the cause does not hide it."""
    state = cause.state
    setting, model, renewed = state.setting, state.model, new_error(state)
    if renewed is None:
        return None
    error, change = renewed
    source = model.source.with_motion_error(error)
    setting.stage("fit with the error of the mesh")
    steps = shortened(model.identification().parameters, change.moves)
    (fit,) = setting.refits([refit_of_one(source, "null", model.fit, setting.grid, setting.seed, steps,
                                          estimator=model.fit.estimator)])
    if not fit.usable:
        return None
    fit = replace(fit, phi=model.fit.phi) if np.isnan(fit.phi) else fit  # of ordinary least squares, before
    return replace(state, model=FittedModel(source, fit))


def new_error(state: State) -> tuple[MotionError, ErrorWeight] | None:
    """The error of the present model, of bricks where the recording shows them, and the weight of its change; None
    where it is the known one."""
    residual, former_error, identified = state.model.residual, state.model.error, state.model.identification()
    if former_error is None or former_error.thickness is None:
        bricks = with_bricks(identified, residual, state.setting.grid, neglected_errors(identified), settled=False)
        if bricks is not None:
            return bricks[0], weighed(residual, bricks[0].less(former_error))
    error = known_error(identified, former_error)
    if error is None:
        return None
    change = weighed(residual, error.less(former_error))
    return (error, change) if change.matters else None


def known_to_rounds(cause: JoinedCause) -> State:
    """All rounds with the error of the last model, for their refits in a revised set."""
    state = cause.state
    return replace(state, rounds=tuple(_knowing(entry, state.model.error) for entry in state.rounds))


def _knowing(entry: Round, error: MotionError | None) -> Round:
    if error is None:
        return entry
    return replace(entry, source=entry.source.with_motion_error(error))


AS_JOINED = Move("model with the cause", "mesh_s", last_cause, as_joined, is_looked_at_again)
NEW_ERROR = Move("error of the simulation", "mesh_s", joined_cause, with_new_error, stage=lambda cause:
                 "error of the mesh, plane stress and finite strains, tested beside the cause")
KNOWN_ERROR = Move("error known to all rounds", "mesh_s", joined_cause, known_to_rounds)
