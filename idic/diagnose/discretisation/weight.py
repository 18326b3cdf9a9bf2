"""What an error of the simulation weighs against the recording: chi-square, and shifts of the parameters."""

from __future__ import annotations

import numpy as np

from idic.diagnose.locate.freedoms import in_images
from idic.diagnose.residual.evidence import Columns
from idic.diagnose.residual.residual_evidence import ResidualEvidence
from idic.diagnose.residual.score import null_model, score
from idic.model import MotionError

MIN_ERROR_CHI2 = 1.0  # on the whole recording, beside the parameters: one standard deviation of any cause
MAX_RISE = 25.0  # of the chi-square of the recording by an error: five standard deviations
MIN_SHIFT_STD = 0.5  # of a parameter by the change of a known error: what the parameters take up is no chi-square


def counts(residual: ResidualEvidence, error: MotionError) -> bool:
    """Whether an error changes chi-square by more than one beside the identified parameters, which is the most that it
    can feign of any cause, or moves one of these by half a standard deviation; and does not raise the chi-square of the
    recording. A mesh that is too stiff makes E too low, and nothing is left of that.

    A virtual test on the mesh of its own model has no such error, and its chi-square rises by five standard deviations
    or more. Where a cause is still unknown, the sign is one of chance; it is asked again for every model that a cause
    has joined.
    """
    chi2, rise, shift = weighed(residual, error)
    return (chi2 >= MIN_ERROR_CHI2 or shift >= MIN_SHIFT_STD) and rise <= MAX_RISE


def change_matters(residual: ResidualEvidence, old: MotionError | None, new: MotionError) -> bool:
    """Whether the present error of a model differs from the added one by more than noise, and the recording does not
    contradict the difference; residual : of the model.

    A renewed error also matters by what it does to the parameters: that of plane stress grows with Poisson's ratio,
    which a cause has moved, and its change is nearly a factor of the stiffness.
    """
    if old is None:
        return counts(residual, new)
    chi2, rise, shift = weighed(residual, MotionError(new.u - old.u, new.channels - old.channels))
    return (chi2 >= MIN_ERROR_CHI2 or shift >= MIN_SHIFT_STD) and rise <= MAX_RISE


def error_column(residual: ResidualEvidence, error: MotionError) -> Columns:
    """An error as images and channels record it."""
    frames = residual.evidence.frames
    fields = np.array([in_images(residual, t, error.u[frame][..., None]) for t, frame in enumerate(frames)])
    return Columns(("mesh",), fields, error.channels[frames][..., None])


def followed(residual: ResidualEvidence, old: MotionError | None, new: MotionError) -> dict[str, float]:
    """By how much the identified parameters move as an error takes the place of another, to first order.

    residual : of the model with the old one
    """
    change = new if old is None else MotionError(new.u - old.u, new.channels - old.channels)
    null = null_model(residual.evidence, residual.null)
    moves = score(residual.evidence, null, error_column(residual, change)).moves[:, 0]
    return dict(zip(null.names, moves.tolist(), strict=True))


def weighed(residual: ResidualEvidence, error: MotionError) -> tuple[float, float, float]:
    """Chi-square of an error beside the parameters, by how much it raises that of the recording, and its largest shift
    of a parameter in standard deviations."""
    null = null_model(residual.evidence, residual.null)
    found = score(residual.evidence, null, error_column(residual, error))
    shift = np.abs(found.moves[:, 0]) / np.sqrt(np.maximum(np.diagonal(null.covariance), 1e-300))
    return float(found.own[0]), float(found.own[0] - 2.0 * found.U[0]), float(shift.max(initial=0.0))
