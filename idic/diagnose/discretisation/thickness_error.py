"""The error of plane stress: what bricks of the specimen's thickness move otherwise.

A thick sheet is not in plane stress: a bent beam of bricks, 3 mm wide and 2.8 mm thick, moves by 0.026 px otherwise.
The test is simulated on bricks of the stated thickness (`idic.identify.systematic.real_thickness`), whatever the
residual says: the parameters can take up most of their difference (E off by 1.3 % beside `none`). Where the recording
fits bricks, with or without finite strains (`combinations`), and no unknown is added, the difference is added to every
simulation, and a caution says so.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from idic.diagnose.channel_left import channels_left, excess
from idic.diagnose.discretisation.combinations import BRICKS, FINITE_STRAINS, combinations, drop_by
from idic.diagnose.discretisation.finite_strain_error import finite_strain_error
from idic.diagnose.discretisation.following import at_values, moved, remaining
from idic.diagnose.discretisation.mesh_error import lacking
from idic.diagnose.refit_job import ExperimentSource
from idic.diagnose.residual.heldout import Fit, fit
from idic.diagnose.residual.residual_evidence import ResidualEvidence, residual_evidence
from idic.diagnose.discretisation.weight import MIN_ERROR_CHI2, error_column
from idic.diagnose.residual.subspace import Grid
from idic.diagnose.screen.score import null_model, score
from idic.errors import NotConverged
from idic.fe.superposition import is_linear
from idic.identify.in_memory import Identification
from idic.identify.systematic.real_thickness import can_be_thick, thick
from idic.model.forward import build_forward
from idic.model.motion_error import MotionError

MAX_BRICK_NODES = 12_000  # of half the thickness: 40 CPU s under a load that yields, 36 frames of 9000
MAX_LINEAR_BRICK_NODES = 40_000  # of a body whose motions are superposed: 9000 take a second
MIN_DROP = 25.0  # of chi-square by bricks: five standard deviations
MIN_DROP_SHARE = 0.5  # of what free motions and channels explain
MIN_STEP_STD = 0.1  # of a parameter aside, for the derivative of the error: bounds may leave no more
MAX_TURNS, TURNED_STD = 12, 0.1  # of error and parameters; standard deviations of the last step
PARTS_OF_STEP = (1.0, 0.5, 0.25, 0.125)


def thickness_error(found: Identification) -> MotionError | None:
    """What a simulation in plane stress lacks of the surface of bricks; None where none can be made or simulated."""
    experiment = replace(found.experiment, motion_error=None)
    if not can_be_thick(experiment):
        return None
    bricks = thick(experiment)
    size = bricks.mesh.n_nodes
    if size > MAX_LINEAR_BRICK_NODES or (size > MAX_BRICK_NODES and not is_linear(build_forward(bricks).model)):
        return None
    n = experiment.mesh.n_nodes
    return lacking(found, experiment, bricks, found.local, lambda u, other: other[:n, :2] - u)


def neglected_errors(found: Identification) -> dict[str, MotionError]:
    """The effects that a model neglects and that can be computed, by name; an experiment's bricks that are counted
    already are none."""
    known = found.experiment.motion_error
    bricks = None if known is not None and known.thickness is not None else thickness_error(found)
    errors = {BRICKS: bricks, FINITE_STRAINS: finite_strain_error(found)}
    return {effect: error for effect, error in errors.items() if error is not None}


def with_thickness(source: ExperimentSource, found: Identification, residual: ResidualEvidence, left: Fit,
                   grid: Grid, errors: Mapping[str, MotionError],
                   significant: bool) -> tuple[ExperimentSource, Identification]:
    """The source and the identification with the error of plane stress added, where the recording asks for it; as they
    are elsewhere.

    The error grows with Poisson's ratio, which has taken a part of it (0.18 in the place of 0.35 in a bent beam): error
    and parameters are found in turns. No unknown is added, so that the drop of chi-square decides: to first order, with
    or without finite strains; where the mismatch is significant, also after the turns.

    residual, left : of the identification, and its fit; errors : that it neglects (`neglected_errors`);
    significant : whether its mismatch is
    """
    if BRICKS not in errors:
        return source, found
    least = least_drop(residual, left)
    asked = _drop_by_bricks(residual, errors) >= least
    if not (asked or significant):
        return source, found
    settled = in_turns(found, found.experiment.motion_error, grid, np.inf if asked else left.chi2, errors[BRICKS])
    if settled is None:
        return source, found
    error, there = settled
    if not asked and left.chi2 - fit(residual_evidence(there, light=False), grid).chi2 < least:
        return source, found
    return source.with_motion_error(error), there


def with_bricks(found: Identification, residual: ResidualEvidence, grid: Grid,
                settled: bool = True) -> MotionError | None:
    """The known error with that of plane stress, where a model with a cause leaves what bricks explain: as
    `with_thickness`, to first order; None elsewhere.

    Before the cause was known it hid the difference: finite strains and bricks both stiffen a bent beam.

    settled : with the parameters in turns; otherwise at the present ones, for a further round
    """
    errors = neglected_errors(found)
    if BRICKS not in errors or _drop_by_bricks(residual, errors) < least_drop(residual, fit(residual, grid)):
        return None
    mesh, bricks = residual.context.experiment.motion_error, errors[BRICKS]
    if not settled:
        return (mesh or MotionError(np.zeros_like(bricks.u), np.zeros_like(bricks.channels))).with_thickness(bricks)
    end = in_turns(found, mesh, grid, first=bricks)
    return None if end is None else end[0]


def _drop_by_bricks(residual: ResidualEvidence, errors: Mapping[str, MotionError]) -> float:
    """Of the chi-square of the recording, by bricks, with or without finite strains, to first order."""
    return drop_by(combinations(residual, null_model(residual.evidence, residual.null), errors), BRICKS)


def in_turns(found: Identification, mesh: MotionError | None, grid: Grid, bar: float = np.inf,
             first: MotionError | None = None) -> tuple[MotionError, Identification] | None:
    """The error of plane stress on top of that of the mesh, and the parameters that belong to it; None where bricks
    cannot be simulated, or where chi-square does not fall below the bar.

    Every turn takes the whole step of the parameters, or the first of its halves that does not raise chi-square and at
    which bricks find an equilibrium: before the first turn a plate that yields may be seven standard deviations off.
    Where no half does, the turns end with the error that has been found.

    first : the error of plane stress of `found`, where it has been computed
    """
    there, thickness = found, first or thickness_error(found)
    for turn in range(MAX_TURNS):
        if thickness is None:
            return None
        nothing = MotionError(np.zeros_like(thickness.u), np.zeros_like(thickness.channels))
        error = (mesh or nothing).with_thickness(thickness)
        there = at_values(found, replace(found.experiment, motion_error=error), there.parameters.as_values())
        here = residual_evidence(there, light=False)
        step, std, gain = remaining(here)
        if turn and fit(here, grid).chi2 - gain >= bar:
            return None
        if np.abs(step / std).max(initial=0.0) < TURNED_STD or turn == MAX_TURNS - 1:
            return error, moved(there, step)
        at_end, (there, thickness) = there, turned(there, here, grid, step)
        if thickness is None:
            return error, at_end
    return None


def turned(there: Identification, here: ResidualEvidence, grid: Grid,
            step: np.ndarray) -> tuple[Identification, MotionError | None]:
    """An identification after a step of its free parameters, or the first of its halves that does not raise chi-square
    by more than an error that counts, with the error of plane stress there; None where none does or bricks cannot be
    simulated.

    here : residual of the identification; step : (n,), in the order of `remaining`
    """
    chi2 = fit(here, grid).chi2
    for part in PARTS_OF_STEP:
        tried = moved(there, part * step)
        try:
            lower = fit(residual_evidence(tried, light=False), grid).chi2 < chi2 + MIN_ERROR_CHI2
        except NotConverged:
            continue
        thickness = thickness_error(tried) if lower else None
        if thickness is not None:
            return tried, thickness
    return there, None


def std_factors(found: Identification, residual: ResidualEvidence) -> dict[str, float]:
    """By how much the standard deviation of a parameter changes as the error of plane stress follows the law; {} where
    that is not counted.

    The error e is held while a model is fitted. With D = -M^-1 J^T W de/dp the parameters that belong to each other
    have the covariance (1 - D)^-1 M^-1 (1 - D)^-T: in a bent beam, whose e grows with the square of an uncertain
    Poisson's ratio, E has twice the standard deviation.

    residual : of the identification
    """
    known = residual.context.experiment.motion_error
    here = None if known is None or known.thickness is None else thickness_error(found)
    if here is None:
        return {}
    null = null_model(residual.evidence, residual.null)
    std = np.sqrt(np.maximum(np.diagonal(null.covariance), 1e-300))
    sets, D = {material.element_set for material in found.experiment.materials}, np.zeros((len(std), len(std)))
    for j, name in enumerate(null.names):
        aside = _aside(found, name, std, j) if name.partition(".")[0] in sets else None
        there = None if aside is None else thickness_error(aside)
        if aside is not None and there is not None:
            step = aside.parameters[name].value - found.parameters[name].value
            change = MotionError(there.u - here.u, there.channels - here.channels)
            moves = score(residual.evidence, null, error_column(residual, change)).moves[:, 0]
            D[:, j] = moves * (std[j] / step) / std
    answer = np.linalg.pinv(np.eye(len(std)) - D)
    spread = answer @ (null.covariance / np.outer(std, std)) @ answer.T
    return dict(zip(null.names, np.sqrt(np.diagonal(spread)).tolist(), strict=True))


def _aside(found: Identification, name: str, std: np.ndarray, j: int) -> Identification | None:
    """One standard deviation of a parameter aside, to the side where its bound leaves more room; None without room."""
    sides = [moved(found, np.where(np.arange(len(std)) == j, sign * std, 0.0)) for sign in (1.0, -1.0)]
    steps = [abs(one.parameters[name].value - found.parameters[name].value) for one in sides]
    best = 0 if steps[0] >= 0.99 * std[j] else int(np.argmax(steps))
    return sides[best] if steps[best] >= MIN_STEP_STD * std[j] else None


def least_drop(residual: ResidualEvidence, left: Fit) -> float:
    """Drop of chi-square from which on bricks are counted: significant, and most of what there is."""
    readings = sum(max(excess(one.before), 0.0) for one in channels_left(residual, None))
    return max(MIN_DROP, MIN_DROP_SHARE * (left.room + readings))
