"""Standard deviations beside an error of plane stress that follows the law.

The error e is held while a model is fitted. With D = -M^-1 J^T W de/dp the parameters that belong to each other have
the covariance (1 - D)^-1 M^-1 (1 - D)^-T: in a bent beam, whose e grows with the square of an uncertain Poisson's
ratio, E has twice the standard deviation.
"""

from __future__ import annotations

import numpy as np

from idic.diagnose.discretisation.sheet import sheet_and_bricks_at
from idic.diagnose.discretisation.weight import as_recorded
from idic.diagnose.residual.residual_evidence import ResidualEvidence
from idic.diagnose.residual.score import NullModel, null_model, score
from idic.identification import Identification
from idic.simulation_error import ErrorChanges


def std_factors(identification: Identification, residual: ResidualEvidence) -> dict[str, float]:
    """By how much the standard deviation of a parameter changes as the error of plane stress follows the law; {} where
    that is not counted.

    Derivatives at the start of the turns, 6 standard deviations of noise away, would not do: on a plate that yields
    the factors came out 5 and 8 % too small.

    residual : of the identification
    """
    error = residual.context.experiment.model.motion_error
    if error is None or error.thickness is None:
        return {}
    models = sheet_and_bricks_at(identification)
    if models is None:
        return {}
    null = null_model(residual.evidence, residual.null)
    D = taken_back(residual, null, models.bricks.changes)
    std = np.sqrt(np.maximum(np.diagonal(null.covariance), 1e-300))
    answer = np.linalg.pinv(np.eye(len(std)) - D)
    spread = answer @ (null.covariance / np.outer(std, std)) @ answer.T
    return dict(zip(null.names, np.sqrt(np.diagonal(spread)).tolist(), strict=True))


def taken_back(residual: ResidualEvidence, null: NullModel, changes: ErrorChanges) -> np.ndarray:
    """D: how the parameters follow the error that follows them, all in standard deviations  # (n, n)

    residual, null : of the model that has the error
    """
    std = np.sqrt(np.maximum(np.diagonal(null.covariance), 1e-300))
    indices = [null.names.index(name) for name in changes.names]
    D = np.zeros((len(std), len(std)))
    D[:, indices] = score(residual.evidence, null, as_recorded(residual, changes)).moves * std[indices] / std[:, None]
    return D
