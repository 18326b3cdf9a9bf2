"""Standard deviations beside an error of plane stress that follows the law.

The error e is held while a model is fitted. With D = -M^-1 J^T W de/dp the parameters that belong to each other have
the covariance (1 - D)^-1 M^-1 (1 - D)^-T: in a bent beam, whose e grows with the square of an uncertain Poisson's
ratio, E has twice the standard deviation.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from idic.diagnose.discretisation.bricks import brick_model
from idic.diagnose.locate.freedoms import in_images
from idic.diagnose.residual.evidence import Columns
from idic.diagnose.residual.residual_evidence import ResidualEvidence
from idic.diagnose.screen.score import null_model, score
from idic.errors import NotConverged
from idic.identify.in_memory import Identification


def std_factors(found: Identification, residual: ResidualEvidence) -> dict[str, float]:
    """By how much the standard deviation of a parameter changes as the error of plane stress follows the law; {} where
    that is not counted.

    residual : of the identification
    """
    known = residual.context.experiment.motion_error
    if known is None or known.thickness is None:
        return {}
    null = null_model(residual.evidence, residual.null)
    std = np.sqrt(np.maximum(np.diagonal(null.covariance), 1e-300))
    sets = {material.element_set for material in found.experiment.materials}
    own = [j for j, name in enumerate(null.names)
           if name.partition(".")[0] in sets and found.forward.moves(name)]  # type: ignore[union-attr]
    changes = error_changes(found, residual, own)
    if changes is None:
        return {}
    D = np.zeros((len(std), len(std)))
    D[:, own] = score(residual.evidence, null, changes).moves * std[own] / std[:, None]
    answer = np.linalg.pinv(np.eye(len(std)) - D)
    spread = answer @ (null.covariance / np.outer(std, std)) @ answer.T
    return dict(zip(null.names, np.sqrt(np.diagonal(spread)).tolist(), strict=True))


def error_changes(found: Identification, residual: ResidualEvidence, which: Sequence[int]) -> Columns | None:
    """Derivatives of the error of plane stress by parameters of the laws, as images and channels record them: those of
    bricks less those of the sheet; None where bricks cannot be simulated.

    residual : of the identification, with the columns of the sheet; which : of these columns
    """
    sheet, model = residual.null.pick(which), brick_model(found)
    if model is None:
        return None
    n, first, frames = found.experiment.mesh.n_nodes, found.experiment.reference, residual.evidence.frames.tolist()
    fields, channels = np.empty_like(sheet.fields), np.empty_like(sheet.channels)
    try:
        for at in model.march(found.parameters, sheet.names, found.local, found.steps, may_cut=True):
            if at.frame + first in frames:
                t = frames.index(at.frame + first)
                fields[t] = in_images(residual, t, at.du[:n, :2]) - sheet.fields[t]
                channels[t] = at.dchannels - sheet.channels[t]
    except NotConverged:
        return None
    return Columns(sheet.names, fields, channels)
