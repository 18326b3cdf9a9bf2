"""The error of plane stress: what bricks of the specimen's thickness move otherwise.

A thick sheet is not in plane stress: a bent beam of bricks, 3 mm wide and 2.8 mm thick, moves by 0.026 px otherwise.
Where a sound model would leave nothing, the test is simulated on bricks of the stated thickness
(`idic.identify.systematic.real_thickness`). Where their difference, which has no unknown, explains most of what there
is, it is added to every simulation, and a caution says so.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from idic.diagnose.channel_left import channels_left, excess
from idic.diagnose.discretisation.following import at_values, moved, remaining
from idic.diagnose.discretisation.mesh_error import lacking
from idic.diagnose.discretisation.weight import error_column
from idic.diagnose.refit_job import ExperimentSource
from idic.diagnose.residual.heldout import Fit, fit
from idic.diagnose.residual.residual_evidence import ResidualEvidence, residual_evidence
from idic.diagnose.residual.subspace import Grid
from idic.diagnose.screen.score import null_model, score
from idic.identify.in_memory import Identification
from idic.identify.systematic.real_thickness import can_be_thick, thick
from idic.model.motion_error import MotionError

MAX_BRICK_NODES = 6_000  # of half the thickness
MIN_DROP = 25.0  # of chi-square by bricks: five standard deviations
MIN_DROP_SHARE = 0.5  # of what free motions and channels explain
MAX_TURNS, TURNED_STD = 12, 0.1  # of error and parameters; standard deviations of the last step


def thickness_error(found: Identification) -> MotionError | None:
    """What a simulation in plane stress lacks of the surface of bricks; None where none can be made or simulated."""
    experiment = replace(found.experiment, motion_error=None)
    if not can_be_thick(experiment):
        return None
    bricks = thick(experiment)
    if bricks.mesh.n_nodes > MAX_BRICK_NODES:
        return None
    n = experiment.mesh.n_nodes
    return lacking(found, experiment, bricks, found.local, lambda u, other: other[:n, :2] - u)


def with_thickness(source: ExperimentSource, found: Identification, residual: ResidualEvidence, left: Fit,
                   grid: Grid) -> tuple[ExperimentSource, Identification]:
    """The source and the identification with the error of plane stress added, where the recording asks for it; as they
    are elsewhere.

    The error grows with Poisson's ratio, which has taken a part of it (0.18 in the place of 0.35 in a bent beam): error
    and parameters are found in turns. No unknown is added, so that the drop of chi-square decides.

    residual, left : of the identification, whose mismatch is significant, and its fit
    """
    settled = in_turns(found, found.experiment.motion_error, grid, left.chi2)
    if settled is None:
        return source, found
    error, there = settled
    after = fit(residual_evidence(there, light=False), grid)
    if left.chi2 - after.chi2 < least_drop(residual, left):
        return source, found
    return source.with_motion_error(error), there


def with_bricks(found: Identification, residual: ResidualEvidence, grid: Grid) -> MotionError | None:
    """The known error with that of plane stress, where a model with a cause leaves what bricks explain: as
    `with_thickness`, to first order; None elsewhere.

    Before the cause was known it hid the difference: finite strains and bricks both stiffen a bent beam.
    """
    known = residual.context.experiment.motion_error
    error = None if known is not None and known.thickness is not None else thickness_error(found)
    if error is None:
        return None
    seen = score(residual.evidence, null_model(residual.evidence, residual.null), error_column(residual, error))
    if 2.0 * seen.U[0] - seen.own[0] < least_drop(residual, fit(residual, grid)):
        return None
    settled = in_turns(found, known, grid)
    return None if settled is None else settled[0]


def in_turns(found: Identification, mesh: MotionError | None, grid: Grid,
              bar: float = np.inf) -> tuple[MotionError, Identification] | None:
    """The error of plane stress on top of that of the mesh, and the parameters that belong to it; None where bricks
    cannot be simulated, or where chi-square does not fall below the bar."""
    there = found
    for turn in range(MAX_TURNS):
        thickness = thickness_error(there)
        if thickness is None:
            return None
        nothing = MotionError(np.zeros_like(thickness.u), np.zeros_like(thickness.channels))
        error = (mesh or nothing).with_thickness(thickness)
        there = at_values(found, replace(found.experiment, motion_error=error), there.parameters.as_values())
        here = residual_evidence(there, light=False)
        step, std, gain = remaining(here)
        if turn and fit(here, grid).chi2 - gain >= bar:
            return None
        there = moved(there, step)
        if np.abs(step / std).max(initial=0.0) < TURNED_STD:
            break
    return error, there


def least_drop(residual: ResidualEvidence, left: Fit) -> float:
    """Drop of chi-square from which on bricks are counted: significant, and most of what there is."""
    readings = sum(max(excess(one.before), 0.0) for one in channels_left(residual, None))
    return max(MIN_DROP, MIN_DROP_SHARE * (left.room + readings))
