"""A sheet simulated in plane stress once, what its parameters would still move beside an error, and its bricks."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from idic.correlation import FrameResponse, correlated_frames
from idic.diagnose.discretisation.following import at_values, following, moved
from idic.diagnose.residual.residual_evidence import ResidualEvidence, residual_evidence
from idic.diagnose.residual.score import null_model
from idic.errors import NotConverged
from idic.identification import Identification, response_of
from idic.model import MotionError
from idic.simulation_error import Bricks, bricks_of, simulated_sheet


@dataclass(frozen=True, eq=False)
class Left:
    """What the parameters would still move beside a held error.

    found : with the error; step, std : (n,) of the free parameters, those that a bound holds back at rest; gain : of
    chi-square by the step; gram : (n, n) its second derivative, halved
    """

    found: Identification
    residual: ResidualEvidence
    step: np.ndarray
    std: np.ndarray
    gain: float
    gram: np.ndarray

    def at(self, step: np.ndarray) -> Identification:
        """After a step of the free parameters  # (n,)"""
        return moved(self.found, dict(zip(self.found.parameters.free, step.tolist(), strict=True)))

    def reached(self, step: np.ndarray) -> np.ndarray:
        """The part of a step that the bounds of the parameters leave, in standard deviations  # (n,)"""
        there = self.at(step).parameters
        return np.array([there[name].value - self.found.parameters[name].value for name in there.free]) / self.std


@dataclass(frozen=True, eq=False)
class Sheet:
    """A model simulated in plane stress, with derivatives by `names`, once for all errors; found : without an error"""

    found: Identification
    frames: tuple[FrameResponse, ...]
    names: tuple[str, ...]

    def guesses(self, other: Identification, names: Sequence[str]) -> Iterator[np.ndarray]:
        """First guesses at other parameters, which the frames are differentiated by: to first order  # (n_nodes, 2)"""
        change = np.array([other.parameters[name].value - self.found.parameters[name].value for name in names])
        return (one.u + one.du @ change for one in self.frames)

    def left(self, error: MotionError) -> Left:
        """Beside an error."""
        experiment = self.found.experiment
        there = at_values(self.found, replace(experiment, motion_error=error), self.found.parameters.as_values())
        wanted = set(correlated_frames(experiment, range(experiment.n_frames)))
        responses = [replace(one, u=one.u + error.u[one.frame], channels=one.channels + error.channels[one.frame])
                     for one in self.frames if one.frame in wanted]
        residual = residual_evidence(there, light=False, responses=responses)
        null, (steps, gain) = null_model(residual.evidence, residual.null), following(residual)
        return Left(there, residual, np.array([steps.get(name, 0.0) for name in null.names]),
                    np.sqrt(np.maximum(np.diagonal(null.covariance), 1e-300)), gain,
                    null.gram)


def sheet_at(found: Identification, near: Sheet | None = None) -> Sheet:
    """The sheet at the parameters of an identification; near : at similar ones.

    Raises
    ------
    NotConverged
        If equilibrium is not found.
    """
    there = at_values(found, replace(found.experiment, motion_error=None), found.parameters.as_values())
    names = tuple(name for name in there.parameters.free if there.forward.moves(name))
    guesses = None if near is None else near.guesses(there, names)
    return Sheet(there, tuple(response_of(state, there.experiment.reference)
                              for state in simulated_sheet(there.model_point, names, guesses)), names)


@dataclass(frozen=True, eq=False)
class SheetAndBricks:
    """A model in plane stress and its bricks, with the derivatives of the error by the parameters of the laws."""

    sheet: Sheet
    bricks: Bricks


def sheet_and_bricks_at(found: Identification) -> SheetAndBricks | None:
    """At the parameters of an identification; None where one of the two cannot be simulated."""
    try:
        sheet = sheet_at(found)
    except NotConverged:
        return None
    bricks = bricks_of(sheet.found.model_point, sheet.frames, of_sheet=sheet.names)
    return None if bricks is None else SheetAndBricks(sheet, bricks)
