"""A sheet simulated in plane stress once, what its parameters would still move beside an error, and its bricks."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from idic.correlation import FrameResponse
from idic.diagnose.discretisation.following import at_values, following, moved
from idic.diagnose.residual.residual_evidence import ResidualEvidence, residual_evidence
from idic.diagnose.residual.score import null_model
from idic.errors import NotConverged
from idic.identification import Identification
from idic.model import MotionError
from idic.simulation_error import Bricks, simulated_sheet


@dataclass(frozen=True, eq=False)
class Left:
    """What the parameters would still move beside a held error.

    identification : with the error; residual : of it; step, std : (n,) of the free parameters, those that a bound
    holds back at rest; gain : of chi-square by the step; gram : (n, n) its second derivative, halved
    """

    identification: Identification
    error: MotionError
    residual: ResidualEvidence
    step: np.ndarray
    std: np.ndarray
    gain: float
    gram: np.ndarray

    def at(self, step: np.ndarray) -> Identification:
        """After a step of the free parameters  # (n,)"""
        return moved(self.identification, dict(zip(self.identification.parameters.free, step.tolist(), strict=True)))

    def reached(self, step: np.ndarray) -> np.ndarray:
        """The part of a step that the bounds of the parameters leave, in standard deviations  # (n,)"""
        parameters = self.at(step).parameters
        return np.array([parameters[name].value - self.identification.parameters[name].value
                         for name in parameters.free]) / self.std


@dataclass(frozen=True, eq=False)
class Sheet:
    """A model simulated in plane stress, with derivatives by `names`, once for all errors; identification : without
    an error"""

    identification: Identification
    frames: tuple[FrameResponse, ...]
    names: tuple[str, ...]

    def guesses(self, identification: Identification, names: Sequence[str]) -> Iterator[np.ndarray]:
        """First guesses at other parameters, which the frames are differentiated by: to first order  # (n_nodes, 2)"""
        change = np.array([identification.parameters[name].value - self.identification.parameters[name].value
                           for name in names])
        return (response.u + response.du @ change for response in self.frames)

    def left(self, error: MotionError) -> Left:
        """Beside an error."""
        experiment = self.identification.experiment
        corrected = at_values(self.identification,
                              replace(experiment, model=replace(experiment.model, motion_error=error)),
                              self.identification.parameters.as_values())
        frames = set(experiment.correlated_frames(range(experiment.model.n_frames)))
        responses = [replace(response, u=response.u + error.u[response.frame],
                             channels=response.channels + error.channels[response.frame])
                     for response in self.frames if response.frame in frames]
        residual = residual_evidence(corrected, light=False, responses=responses)
        null, (steps, gain) = null_model(residual.evidence, residual.null), following(residual)
        return Left(corrected, error, residual, np.array([steps.get(name, 0.0) for name in null.names]),
                    np.sqrt(np.maximum(np.diagonal(null.covariance), 1e-300)), gain,
                    null.gram)


def sheet_at(identification: Identification, neighbour: Sheet | None = None) -> Sheet:
    """The sheet at the parameters of an identification; neighbour : at similar ones.

    Raises
    ------
    NotConverged
        If equilibrium is not found.
    """
    plain = at_values(identification, replace(identification.experiment,
                                              model=replace(identification.experiment.model, motion_error=None)),
                      identification.parameters.as_values())
    names = tuple(name for name in plain.parameters.free if plain.forward.moves(name))
    guesses = None if neighbour is None else neighbour.guesses(plain, names)
    return Sheet(plain, tuple(FrameResponse.of(state, plain.experiment.model.reference)
                              for state in simulated_sheet(plain.model_point, names, guesses)), names)


@dataclass(frozen=True, eq=False)
class SheetAndBricks:
    """A model in plane stress and its bricks, with the derivatives of the error by the parameters of the laws."""

    sheet: Sheet
    bricks: Bricks


def sheet_and_bricks_at(identification: Identification) -> SheetAndBricks | None:
    """At the parameters of an identification; None where one of the two cannot be simulated."""
    try:
        sheet = sheet_at(identification)
    except NotConverged:
        return None
    bricks = Bricks.of(sheet.identification.model_point, sheet.frames, of_sheet=sheet.names)
    return None if bricks is None else SheetAndBricks(sheet, bricks)
