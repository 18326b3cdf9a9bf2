"""The known error of a model: of the identified one, and anew of every model that a cause has joined."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from idic.diagnose.discretisation.bricks import thickness_error
from idic.diagnose.discretisation.following import at_values, following, moved
from idic.diagnose.discretisation.mesh_error import brick_mesh_error, motion_error
from idic.diagnose.discretisation.turns import Begun, in_turns
from idic.diagnose.discretisation.weight import change_matters, counts
from idic.diagnose.refit_job import ExperimentSource
from idic.diagnose.residual.residual_evidence import ResidualEvidence, residual_evidence
from idic.diagnose.residual.subspace import Grid
from idic.identify.in_memory import Identification
from idic.model.motion_error import MotionError


def with_error(source: ExperimentSource,
               found: Identification) -> tuple[ExperimentSource, Identification, ResidualEvidence]:
    """The source and the identification with the error of the mesh added, where it matters, as they are elsewhere; and
    the residual of that identification."""
    error, residual = motion_error(found), residual_evidence(found, light=False)
    if error is None or not counts(residual, error):
        return source, found, residual
    source, found = knowing(source, found, error)
    return source, found, residual_evidence(found, light=False)


def known_error(found: Identification, old: MotionError | None) -> MotionError | None:
    """The error of the mesh of a changed model, with that of plane stress where `old` counts it."""
    if old is None or old.thickness is None:
        return motion_error(found)
    return error_beside(found, thickness_error(found) or old.thickness)


def error_beside(found: Identification, bricks: MotionError, of_sheet: MotionError | None = None) -> MotionError:
    """The error of plane stress with that of the mesh on top, which is that of the bricks, or of the sheet where it
    cannot be found.

    of_sheet : where it is known
    """
    nothing = MotionError(np.zeros_like(bricks.u), np.zeros_like(bricks.channels))
    return (brick_mesh_error(found) or of_sheet or motion_error(found) or nothing).with_thickness(bricks)


def renewed_error(found: Identification, residual: ResidualEvidence, grid: Grid,
                  begun: Begun | None = None) -> tuple[MotionError, Identification] | None:
    """The error of a model at its present values, where it differs from the known one (`change_matters`), and the
    model at the values that it is of: in turns with an error of plane stress, which the parameters follow.

    begun : where the turns begin, if that is known
    """
    old = residual.context.experiment.motion_error
    if old is None:
        return None
    there, bricks = found, old.thickness
    if bricks is not None:
        settled = in_turns(found, old.of_mesh, grid, begun=begun)
        if settled is None:
            return None
        bricks, there = settled[0].thickness, settled[1]
    new = motion_error(there) if bricks is None else error_beside(there, bricks)
    return (new, there) if new is not None and change_matters(residual, old, new) else None


def knowing(source: ExperimentSource, found: Identification,
            error: MotionError) -> tuple[ExperimentSource, Identification]:
    """With an error; the parameters follow by one step, as they have taken a part of it."""
    there = at_values(found, replace(found.experiment, motion_error=error), found.parameters.as_values())
    return source.with_motion_error(error), moved(there, following(residual_evidence(there, light=False))[0])
