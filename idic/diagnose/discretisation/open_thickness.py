"""Parameters of a model with bricks, where the recording does not tell plane stress from bricks of real thickness."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from idic.diagnose.discretisation.thickness_error import thickness_error
from idic.diagnose.discretisation.weight import error_column
from idic.diagnose.residual.residual_evidence import ResidualEvidence
from idic.diagnose.screen.score import null_model, score
from idic.identify.in_memory import Identification

LIKELY_SHARE, SHARE_STD = 0.5, 0.5  # of the difference of bricks, where the recording does not tell: none or all of it
MIN_OPEN_STD = 1.0  # of a parameter by the difference of bricks that may be missing: more is said


@dataclass(frozen=True)
class OpenThickness:
    """What plane stress may have done to the parameters, where the recording does not tell it from bricks.

    share, share_std : of the difference of bricks that the body has, by the recording, between none and all of it
    moves : by how much each free parameter would move with all of it, internal units
    """

    share: float
    share_std: float
    moves: Mapping[str, float]


def open_thickness(found: Identification, residual: ResidualEvidence) -> OpenThickness | None:
    """What bricks would change in the parameters of a model in plane stress; None where they cannot be made, are
    counted already, or would move no parameter by a standard deviation.

    residual : of the model. The share of the difference is an unknown of its own, none or all of it without the
    recording.
    """
    known = residual.context.experiment.motion_error
    error = None if known is not None and known.thickness is not None else thickness_error(found)
    if error is None:
        return None
    null = null_model(residual.evidence, residual.null)
    seen = score(residual.evidence, null, error_column(residual, error))
    precision = float(seen.own[0]) + 1.0 / SHARE_STD**2
    share = float(np.clip((seen.U[0] + LIKELY_SHARE / SHARE_STD**2) / precision, 0.0, 1.0))
    std, moves = precision**-0.5, seen.moves[:, 0]
    noise = np.sqrt(np.maximum(np.diagonal(null.covariance), 1e-300))
    if float((np.abs(moves) * np.hypot(share, std) / noise).max(initial=0.0)) < MIN_OPEN_STD:
        return None
    return OpenThickness(share, std, dict(zip(null.names, moves.tolist(), strict=True)))
