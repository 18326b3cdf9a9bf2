"""A model that was fitted: its experiment with the edits, the answer of its fit, its residual on the recording."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from idic.diagnose.physics.candidate import Situation
from idic.diagnose.refits.refit import Fit, identification_at, is_residual_of, residual_from_rest
from idic.diagnose.refits.refit_job import ExperimentSource
from idic.diagnose.residual.residual_evidence import ResidualEvidence, path_of
from idic.diagnose.residual.score import null_model
from idic.diagnose.screen.situation import situation
from idic.identification import MAX_SECOND_ORDER_STD, Identification, Path
from idic.model import MotionError


@dataclass(frozen=True, eq=False)
class FittedModel:
    """One model of a diagnosis.

    source : its experiment with every edit and the known error; fit : values, standard deviations, frame-local
    unknowns, increments, chi-square on both copies; residual : on the recording itself, None where it was not simulated
    or finds no equilibrium from rest; neglected : errors by effects that it neglects at the end of its fit, None where
    they have not been computed
    """

    source: ExperimentSource
    fit: Fit
    residual: ResidualEvidence | None = None
    neglected: Mapping[str, MotionError] | None = None

    @property
    def error(self) -> MotionError | None:
        """What its simulation is known to lack."""
        return self.source.motion_error

    @property
    def is_simulated_there(self) -> bool:
        """Whether the residual is that of the end of the fit, with the known error."""
        return self.residual is not None and is_residual_of(self.residual, self.fit, self.error)

    @property
    def path(self) -> Path | None:
        """The simulation of the end of the fit: that of the residual, or foreseen from it to first order where the fit
        has moved so little; None elsewhere."""
        residual, fit = self.residual, self.fit
        if residual is None or residual.context.experiment.model.motion_error is not self.error:
            return None
        path = path_of(residual, fit.steps)
        if path is None or path.is_at(fit.values, fit.local, fit.steps):
            return path
        if path.values.keys() != fit.values.keys() or path.local.shape != fit.local.shape or (
                fit.local.shape[1] and residual.context.experiment.model.path_dependent_laws):
            return None
        gram = null_model(residual.evidence, residual.null).gram
        is_near = path.second_order_std(fit.values, residual.null.names, gram) <= MAX_SECOND_ORDER_STD
        return path.foreseen_at(fit.values, fit.local) if is_near else None

    def identification(self) -> Identification:
        """The end of the fit on the recording, as if it had been identified there."""
        fit, path = self.fit, self.path
        neighbour = None if path is not None or self.residual is None else path_of(self.residual, fit.steps)
        is_alike = neighbour is not None and (
            neighbour.values.keys() == fit.values.keys() and neighbour.local.shape == fit.local.shape)
        guesses = partial(neighbour.predicted_at, fit.values, fit.local) if is_alike else None
        return replace(identification_at(self.source.load(), fit.values, fit.local, fit.steps), path=path,
                       stored=guesses)

    def situation(self) -> Situation:
        """What candidates look at: stresses and strains of the model."""
        return situation(self.identification(), self.residual, self.source.document())

    def simulated(self) -> FittedModel | None:
        """With the residual of the end of its fit; None where it finds no equilibrium from rest."""
        residual = residual_from_rest(self.source.load(), self.fit)
        return None if residual is None else replace(self, residual=residual)

    def with_edits(self, edits: Mapping[str, Any], fit: Fit) -> FittedModel:
        """A further fit, of this model with edits."""
        return FittedModel(self.source.with_edits(edits), fit)
