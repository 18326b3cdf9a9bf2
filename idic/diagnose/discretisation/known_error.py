"""The known error of a model: of the identified one, and anew of every model that a cause has joined."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from idic.correlation import FrameResponse
from idic.diagnose.discretisation.following import at_values, following, moved
from idic.diagnose.discretisation.sheet import SheetAndBricks
from idic.diagnose.discretisation.turns import in_turns
from idic.diagnose.discretisation.weight import weighed
from idic.diagnose.refits.refit_job import ExperimentSource
from idic.diagnose.residual.residual_evidence import ResidualEvidence, residual_evidence, with_error_added
from idic.diagnose.residual.subspace import Grid
from idic.identification import Identification
from idic.model import MotionError
from idic.simulation_error import brick_mesh_error, mesh_error, thickness_error

# of the change by elements of half the size: with the order p of convergence 1/(2^p - 1) is left, here for p = 0.75
MAX_FURTHER_SHARE = 1.5
MIN_FURTHER_DROP = 9.0  # of chi-square: three standard deviations


def _silent() -> None:
    """Announces nothing."""


def with_error(source: ExperimentSource, identification: Identification,
               announce: Callable[[], None] = _silent) -> tuple[ExperimentSource, Identification, ResidualEvidence]:
    """The source and the identification with the error of the mesh added, where it matters, as they are elsewhere; and
    the residual of that identification; announce : called before a finer mesh is simulated"""
    residual = residual_evidence(identification, light=False)
    announce()
    error = mesh_error(identification.model_point)
    if error is None or not weighed(residual, error).matters:
        return source, identification, residual
    source, identification = knowing(source, identification, error, with_error_added(residual.responses, error))
    return source, identification, residual_evidence(identification, light=False)


def known_error(identification: Identification, former_error: MotionError | None) -> MotionError | None:
    """The error of the mesh of a changed model, with that of plane stress where the former one counts it."""
    if former_error is None or former_error.thickness is None:
        return mesh_error(identification.model_point)
    return error_beside(identification, thickness_error(identification.model_point) or former_error.thickness)


def error_beside(identification: Identification, bricks: MotionError,
                 of_sheet: MotionError | None = None) -> MotionError:
    """The error of plane stress with that of the mesh on top, which is that of the bricks, or of the sheet where it
    cannot be found.

    Where strains are singular, at the corners of a grip, elements of half the size halve an error, and the finer bricks
    have as much of it again. How much is estimated from the recording, within what such a convergence allows
    (`MAX_FURTHER_SHARE`), and only where it explains `MIN_FURTHER_DROP` of chi-square beside the free parameters.
    Reactions have their own limit in the error already, and stay.

    of_sheet : where it is known
    """
    mesh = brick_mesh_error(identification.model_point)
    if mesh is None:
        return bricks.on_top_of(of_sheet or mesh_error(identification.model_point))
    error, motions = bricks.on_top_of(mesh), mesh.without_reactions(identification.experiment.model.channels)
    corrected = at_values(identification, replace(identification.experiment,
                                                  model=replace(identification.experiment.model, motion_error=error)),
                          identification.parameters.as_values())
    share = further_share(residual_evidence(corrected, light=False), motions)
    return bricks.on_top_of(mesh.plus(motions.scaled(share)))


def further_share(residual: ResidualEvidence, mesh: MotionError) -> float:
    """How much more of an error of the mesh the recording shows, beside the free parameters; 0 where it does not.

    residual : of a model that counts the error once
    """
    weight = weighed(residual, mesh)
    share = min(max(weight.along / weight.chi2, 0.0), MAX_FURTHER_SHARE) if weight.chi2 > 0.0 else 0.0
    return share if 2.0 * share * weight.along - share**2 * weight.chi2 > MIN_FURTHER_DROP else 0.0


def renewed_error(identification: Identification, residual: ResidualEvidence, grid: Grid,
                  begun: SheetAndBricks | None = None) -> tuple[MotionError, Identification] | None:
    """The error of a model at its present values, where it differs from the known one by what matters, and the
    model at the values that it is of: in turns with an error of plane stress, which the parameters follow.

    begun : where the turns begin, if that is known
    """
    former_error = residual.context.experiment.model.motion_error
    if former_error is None:
        return None
    point, bricks = identification, former_error.thickness
    if bricks is not None:
        settled = in_turns(identification, former_error.of_mesh, grid, begun=begun)
        if settled is None:
            return None
        bricks, point = settled[0].thickness, settled[1]
    error = mesh_error(point.model_point) if bricks is None else error_beside(point, bricks)
    return (error, point) if error is not None and weighed(residual, error.less(former_error)).matters else None


def knowing(source: ExperimentSource, identification: Identification, error: MotionError,
            responses: Sequence[FrameResponse] | None = None) -> tuple[ExperimentSource, Identification]:
    """With an error; the parameters follow by one step, as they have taken a part of it.

    responses : of the identification with the error, where it has been simulated
    """
    corrected = at_values(identification, replace(identification.experiment,
                                                  model=replace(identification.experiment.model, motion_error=error)),
                          identification.parameters.as_values())
    residual = residual_evidence(corrected, light=False, responses=responses)
    return source.with_motion_error(error), moved(corrected, following(residual)[0])
