"""Where the error of plane stress is counted.

Bricks of the stated thickness are simulated (`idic.simulation_error.bricks`) whatever the residual says: the parameters
can take up most of their difference (E off by 1.3 % beside `none`). Where the recording fits bricks, with or without
finite strains (`combinations`), and no unknown is added, the difference is added to every simulation, and a caution
says so.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from idic.diagnose.discretisation.combinations import (BRICKS, FINITE_STRAINS, Combination, best_with, combinations,
                                                        drop_by)
from idic.diagnose.discretisation.known_error import error_beside, knowing
from idic.diagnose.discretisation.turns import in_turns
from idic.diagnose.refits.refit_job import ExperimentSource
from idic.diagnose.residual.channel_left import channels_left, excess
from idic.diagnose.residual.heldout import Misfit, misfit_of
from idic.diagnose.residual.residual_evidence import ResidualEvidence, residual_evidence
from idic.diagnose.residual.score import null_model
from idic.diagnose.residual.subspace import Grid
from idic.identification import Identification
from idic.model import MotionError
from idic.simulation_error import strain_error, thickness_error

MIN_DROP = 25.0  # of chi-square by bricks: five standard deviations
MIN_DROP_SHARE = 0.5  # of what free motions and channels explain
# the same beside a cause, where the recording shows the difference of bricks with an amplitude near 1: an unknown
# further cause that resembles bricks would give it another amplitude
MIN_DROP_SHARE_AT_ONE, MAX_AMPLITUDE_ERROR = 0.25, 0.25


def neglected_errors(identification: Identification) -> dict[str, MotionError]:
    """The effects that a model neglects and that can be computed, by name; an experiment's bricks that are counted
    already are none."""
    known_error = identification.experiment.model.motion_error
    has_bricks = known_error is not None and known_error.thickness is not None
    bricks = None if has_bricks else thickness_error(identification.model_point)
    errors = {BRICKS: bricks, FINITE_STRAINS: strain_error(identification.model_point)}
    return {effect: error for effect, error in errors.items() if error is not None}


def with_thickness(source: ExperimentSource, identification: Identification, residual: ResidualEvidence, misfit: Misfit,
                   grid: Grid, errors: Mapping[str, MotionError], significant: bool,
                   announce: Callable[[], None]) -> tuple[ExperimentSource, Identification]:
    """The source and the identification with the error of plane stress added, where the recording asks for it; as they
    are elsewhere.

    The error grows with Poisson's ratio, which has taken a part of it (0.18 in the place of 0.35 in a bent beam): error
    and parameters are found in turns. No unknown is added, so that the drop of chi-square decides: to first order, with
    or without finite strains; where the mismatch is significant, also after the turns.

    residual, misfit : of the identification, and its fit; errors : that it neglects (`neglected_errors`);
    significant : whether its mismatch is; announce : called before the turns
    """
    if BRICKS not in errors:
        return source, identification
    least = least_drop(residual, misfit)
    is_asked = _drop_by_bricks(residual, errors) >= least
    if not (is_asked or significant):
        return source, identification
    announce()
    settled = in_turns(identification, identification.experiment.model.motion_error, grid,
                       np.inf if is_asked else misfit.chi2, errors[BRICKS])
    if settled is None:
        return source, identification
    error, point = settled
    if not is_asked and misfit.chi2 - misfit_of(residual_evidence(point, light=False), grid).chi2 < least:
        return source, identification
    return knowing(source, point, error_beside(point, error.thickness, error.of_mesh))


def with_bricks(identification: Identification, residual: ResidualEvidence, grid: Grid,
                errors: Mapping[str, MotionError], settled: bool = True) -> tuple[MotionError, Identification] | None:
    """The known error with that of plane stress, where a model with a cause leaves what bricks explain, and the model
    at the values that it is of: as `with_thickness`, to first order; None elsewhere.

    Before the cause was known it hid the difference: finite strains and bricks both stiffen a bent beam. A further
    cause may still be unknown and make a mismatch of its own. A quarter of the mismatch is then enough, if the
    recording shows the difference of bricks with an amplitude near 1; no parameter was fitted to that amplitude.

    errors : that the model neglects (`neglected_errors`)
    settled : with the parameters in turns; otherwise at the present ones, for a further round
    """
    former_error = residual.context.experiment.model.motion_error
    if BRICKS not in errors or not are_shown(_tried(residual, errors), _room(residual, misfit_of(residual, grid))):
        return None
    mesh, bricks = former_error, errors[BRICKS]
    if not settled:
        return error_beside(identification, bricks, mesh), identification
    turned = in_turns(identification, mesh, grid, first=bricks)
    if turned is None:
        return None
    error, point = turned
    return error_beside(point, error.thickness, error.of_mesh), point


def are_shown(tried: tuple[Combination, ...], mismatch: float) -> bool:
    """Whether bricks are counted beside a cause: they explain half of the mismatch, or a quarter of it with an
    amplitude near 1.

    tried : combinations of the effects that the model neglects; mismatch : chi-square that free motions and channels
    explain
    """
    drop, best = drop_by(tried, BRICKS), best_with(tried, BRICKS)
    at_one = abs(best.amplitude - 1.0) <= MAX_AMPLITUDE_ERROR
    return drop >= max(MIN_DROP, (MIN_DROP_SHARE_AT_ONE if at_one else MIN_DROP_SHARE) * mismatch)


def _drop_by_bricks(residual: ResidualEvidence, errors: Mapping[str, MotionError]) -> float:
    """Of the chi-square of the recording, by bricks, with or without finite strains, to first order."""
    return drop_by(_tried(residual, errors), BRICKS)


def _tried(residual: ResidualEvidence, errors: Mapping[str, MotionError]) -> tuple[Combination, ...]:
    return combinations(residual, null_model(residual.evidence, residual.null), errors)


def least_drop(residual: ResidualEvidence, misfit: Misfit) -> float:
    """Drop of chi-square from which on bricks are counted: significant, and most of what there is."""
    return max(MIN_DROP, MIN_DROP_SHARE * _room(residual, misfit))


def _room(residual: ResidualEvidence, misfit: Misfit) -> float:
    """Chi-square that free motions and channels explain of a residual."""
    return misfit.room + sum(max(excess(channel.before), 0.0) for channel in channels_left(residual, None))
