"""What an error of the simulation weighs against the recording: chi-square, and shifts of the parameters."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np

from idic.diagnose.locate.freedoms import in_images
from idic.diagnose.residual.evidence import Columns, joined
from idic.diagnose.residual.residual_evidence import ResidualEvidence
from idic.diagnose.residual.score import null_model, score
from idic.model import MotionError
from idic.simulation_error import ErrorChanges

MIN_ERROR_CHI2 = 1.0  # on the whole recording, beside the parameters: one standard deviation of any cause
MAX_RISE = 25.0  # of the chi-square of the recording by an error: five standard deviations
MIN_SHIFT_STD = 0.5  # of a parameter by the change of a known error: what the parameters take up is no chi-square


@dataclass(frozen=True, eq=False)
class ErrorWeight:
    """An error s beside the identified parameters, against the residual r.

    chi2 : s^T s; along : s^T r; moves : of the parameters that follow it, to first order, internal units; shift_std :
    the largest of them in standard deviations
    """

    chi2: float
    along: float
    moves: Mapping[str, float]
    shift_std: float

    @property
    def rise(self) -> float:
        """Of the chi-square of the recording by the error."""
        return self.chi2 - 2.0 * self.along

    @property
    def matters(self) -> bool:
        """Whether the error changes chi-square by more than one, which is the most that it can feign of any cause, or
        moves a parameter by half a standard deviation; and does not raise the chi-square of the recording. A mesh that
        is too stiff makes E too low, and nothing is left of that. The change of an error weighs as an error does: that
        of plane stress grows with Poisson's ratio, which a cause has moved, nearly as a factor of the stiffness.

        A virtual test on the mesh of its own model has no such error, and its chi-square rises by five standard
        deviations or more. Where a cause is still unknown, the sign is one of chance; it is asked again for every model
        that a cause has joined.
        """
        return (self.chi2 >= MIN_ERROR_CHI2 or self.shift_std >= MIN_SHIFT_STD) and self.rise <= MAX_RISE


def weighed(residual: ResidualEvidence, error: MotionError) -> ErrorWeight:
    """The weight of an error; residual : of the model that lacks it."""
    null = null_model(residual.evidence, residual.null)
    scores = score(residual.evidence, null, error_column(residual, error))
    moves = scores.moves[:, 0]
    shift = np.abs(moves) / np.sqrt(np.maximum(np.diagonal(null.covariance), 1e-300))
    return ErrorWeight(float(scores.own[0]), float(scores.U[0]), dict(zip(null.names, moves.tolist(), strict=True)),
                       float(shift.max(initial=0.0)))


def error_column(residual: ResidualEvidence, error: MotionError) -> Columns:
    """An error as images and channels record it."""
    return as_recorded(residual, ErrorChanges(("mesh",), error.u[..., None], error.channels[..., None]))


def error_columns(residual: ResidualEvidence, errors: Collection[MotionError]) -> Columns | None:
    """Several errors as images and channels record them; None without any."""
    return joined(*(error_column(residual, error) for error in errors)) if errors else None


def as_recorded(residual: ResidualEvidence, changes: ErrorChanges) -> Columns:
    """Derivatives of an error as images and channels record them."""
    frames = residual.evidence.frames
    fields = np.array([in_images(residual, t, changes.u[frame]) for t, frame in enumerate(frames)])
    return Columns(changes.names, fields, changes.channels[frames])
