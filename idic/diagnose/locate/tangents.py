"""The identified model walked once more along its own displacements.

Everything that asks "what would a small change here do to the images" is one back-substitution per frame with its
tangents.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from idic.diagnose.residual.residual_evidence import ResidualEvidence
from idic.fe import Tangent, tangents_along
from idic.identification import Identification
from idic.model import Readings


@dataclass(frozen=True, eq=False)
class ModelTangent(Tangent):
    """The model at one frame; readings : rows of the channels that are no reactions, None: all are"""

    readings: Readings | None = None


def tangents(identification: Identification, residual: ResidualEvidence,
             only: int | None = None) -> Iterator[ModelTangent]:
    """The tangent of every frame of the evidence, by its place there; history-dependent laws keep their history.

    only : place of the one frame that is wanted; laws without history are evaluated there alone

    Raises
    ------
    NotConverged
        If a law finds no answer along the path.
    """
    forward, parameters, model = identification.forward, identification.parameters, identification.experiment.model
    frames = [int(k) - model.reference for k in residual.evidence.frames]
    for at in tangents_along(forward.body_at(parameters, identification.local), forward.law_values(parameters),
                             model.times[model.reference:], frames, residual.solved_u, only):
        yield ModelTangent(at.index, at.system, at.evaluation, at.factor, forward.readings)
