"""The identified model as a diagnosis begins with it: its residual, its known error, and where its mismatch is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial

from idic.diagnose.discretisation.known_error import with_error
from idic.diagnose.discretisation.thickness_error import neglected_errors, with_thickness
from idic.diagnose.locate.mismatch import Mismatch, locate
from idic.diagnose.refits.refit_job import ExperimentSource
from idic.diagnose.residual.channel_left import MIN_READING_SHARE, channels_left
from idic.diagnose.residual.heldout import Misfit, grid_of, misfit_of
from idic.diagnose.residual.margin import ASSUMED, Margin
from idic.diagnose.residual.residual_evidence import ResidualEvidence, residual_evidence
from idic.diagnose.residual.subspace import Grid
from idic.diagnose.selection.stages import EVIDENCE, MESH_ERROR, NEGLECTED, PLACE, TURNS
from idic.diagnose.selection.state import Clock, Stage
from idic.errors import NotConverged
from idic.identification import Identification
from idic.model import MotionError


@dataclass(frozen=True, eq=False)
class Identified:
    """The identified model on the recording.

    source, identification : with its known error; residual : of it; grid : of the free motions that measure it;
    misfit : what they explain of it; mismatch : side, onset and place, None where a law finds no equilibrium along
    the path
    neglected : errors by effects that the model neglects, None where they are not those of `identification`
    """

    source: ExperimentSource
    identification: Identification
    residual: ResidualEvidence
    grid: Grid
    misfit: Misfit
    mismatch: Mismatch | None
    neglected: Mapping[str, MotionError] | None

    @property
    def is_mismatched(self) -> bool:
        """Whether a mismatch was located."""
        return self.mismatch is not None and self.mismatch.is_significant


def as_identified(source: ExperimentSource, identification: Identification, margin: Margin, quick: bool, stage: Stage,
                  clock: Clock) -> Identified:
    """The identified model with the error of its mesh, and of plane stress where the recording shows it."""
    stage(EVIDENCE)
    with clock.step("gather_s"):
        source, identification, residual = with_error(source, identification, partial(stage, MESH_ERROR))
        grid = grid_of(residual)
        misfit = misfit_of(residual, grid)
    stage(PLACE)
    with clock.step("locate_s"):
        mismatch = located(identification, residual, margin)
        is_mismatched = mismatch is not None and mismatch.is_significant
        if is_neglect_computed := is_mismatched or not quick:
            stage(NEGLECTED)
        neglected = neglected_errors(identification) if is_neglect_computed else {}
        first = Identified(source, identification, residual, grid, misfit, mismatch, neglected)
        source, bricks = with_thickness(source, identification, residual, misfit, grid, neglected, is_mismatched,
                                        partial(stage, TURNS))
        if bricks is identification:
            return first
        residual = residual_evidence(bricks, light=False)
        return Identified(source, bricks, residual, grid, misfit_of(residual, grid),
                          located(bricks, residual, margin), None)


def located(identification: Identification, residual: ResidualEvidence, margin: Margin = ASSUMED) -> Mismatch | None:
    """Side, onset and place; None where a law finds no equilibrium along the path. Readings that differ by less than
    two meshes of one law do are no mismatch."""
    try:
        mismatch = locate(identification, residual, margin=margin)
    except NotConverged:
        return None
    if mismatch.side != "force" or any(
            channel.was_beyond_discretisation for channel in channels_left(residual, None)):
        return mismatch
    reason = f"readings differ by less than {100.0 * MIN_READING_SHARE:g} % of the largest one, as two meshes may"
    return replace(mismatch, side="", nested_tests=replace(mismatch.nested_tests, side="", reason=reason))
