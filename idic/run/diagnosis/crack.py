"""The cracks of an enriched model: where each begins, its direction, and the length and the load of its tip per
frame."""

from __future__ import annotations

from typing import Any

import numpy as np

from idic.diagnose import Diagnosis, null_model
from idic.model import ForwardModel, build_forward
from idic.run.judgement.cracks import Tips, entries_of


def cracks_content(diagnosis: Diagnosis) -> dict[str, Any]:
    """The entry ``cracks`` of diagnosis.json: per crack that a candidate has added ``start_mm``, ``direction_deg``
    (from the x axis), ``inner`` (it begins inside the body), and what ``cracks`` of result.json holds.
    """
    model = diagnosis.enriched
    if model is None or model.residual is None:
        return {}
    residual = model.residual
    experiment = residual.context.experiment
    added = [crack for crack in experiment.model.cracks
             if set(crack.names) & set(experiment.model.parameters.free) - set(
                 diagnosis.identification.experiment.model.parameters.free)]
    forward = build_forward(experiment)
    if not added or not isinstance(forward, ForwardModel):
        return {}
    null = null_model(residual.evidence, residual.null)
    moving = list(residual.context.moving)
    names = [name for name in moving if name in null.names and model.fit.stds.get(name)]
    places = [null.names.index(name) for name in names]
    covariance = null.covariance[np.ix_(places, places)]
    scale = np.array([float(model.fit.stds[name] or 0.0) for name in names]) / np.sqrt(np.diagonal(covariance))
    columns = [moving.index(name) for name in names]
    responses = {response.frame: response for response in residual.responses}

    def motion(image: int) -> tuple[np.ndarray, np.ndarray] | None:
        response = responses.get(image)
        return None if response is None else (response.u[:, :2], response.du[:, :2, columns])

    open_names = tuple(name for name, std in model.fit.stds.items() if not std)
    entries = entries_of(Tips(forward, experiment.model.parameters.with_values(model.fit.values), names,
                              covariance * np.outer(scale, scale), open_names, motion))
    content = {}
    for crack in added:
        start, end = crack.cut.path[0], crack.cut.path[-1]
        turn = float(np.degrees(np.arctan2(end[1] - start[1], end[0] - start[0])))
        content[crack.name] = {"start_mm": start.tolist(), "direction_deg": turn,
                               "inner": bool(crack.cut.left_nodes[0] == crack.cut.right_nodes[0]),
                               **entries[crack.name]}
    return content
