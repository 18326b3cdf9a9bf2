"""Cracks of a model as seams of the finite-element body: cuts whose tips follow the identified lengths."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from idic.fe import Body, Seam
from idic.model.records.model import Model
from idic.parameters import ParameterSet


def seams_at(body: Body, model: Model, parameters: ParameterSet) -> tuple[Seam, ...]:
    """The seams of a body with the lengths of these parameters."""
    if not body.seams:
        return ()
    return tuple(replace(seam, tips=column) for seam, column in zip(body.seams, model.tips_at(parameters).T,
                                                                    strict=True))


def tip_change(model: Model, name: str) -> np.ndarray | None:
    """Derivative of `Model.tips_at` by a degree of freedom; None of one that is no length of a crack."""
    for k, crack in enumerate(model.cracks):
        if name in crack.names:
            change = np.zeros((model.n_frames, len(model.cracks)))
            change[:, k] = crack.hats[crack.names.index(name)]
            return change[model.reference:]
    return None
