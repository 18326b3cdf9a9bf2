"""Columns that count together as one, and the size of effects: motion in px, readings in standard deviations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.sparse import csr_array

from idic.diagnose.residual.evidence import Columns, Evidence, FrameEvidence
from idic.diagnose.residual.excess import power, seen_planes
from idic.diagnose.screen.free_courses import with_knots
from idic.diagnose.screen.practical import EffectSize
from idic.diagnose.screen.score_columns import ScoreColumn


def columns_together(trials: Sequence[ScoreColumn]) -> list[list[int]]:
    """The columns of every variant whose columns count together."""
    groups: dict[int, list[int]] = {}
    for i, trial in enumerate(trials):
        if trial.variant.counts_together:
            groups.setdefault(id(trial.variant), []).append(i)
    return [members for members in groups.values() if len(members) > 1]


def sum_of(members: Sequence[ScoreColumn]) -> ScoreColumn:
    """The best sum of some columns of one variant as a column; of a free course with the knots of these alone."""
    variant = members[0].variant
    if variant.free_course and variant.new:
        variant = with_knots(variant, [member.name for member in members])
    return replace(members[0], variant=variant, name=variant.label)


def effect_sizes(evidence: Evidence, parameters: Columns, columns: Columns, ways: np.ndarray,
                 moves: np.ndarray) -> list[EffectSize]:
    """Sizes of effects, of what the identified parameters cannot imitate.

    Motion is weighed by the contrast of the texture: rms^2 = 2 sum (grad f . s)^2 / sum |grad f|^2 in a plane. Columns
    of grey values and heights count as the motion that would change as much.

    Parameters
    ----------
    ways : (K, n) amplitudes of the columns in each effect
    moves : (n_parameters, n) of the identified parameters with it
    """
    n, courses = ways.shape[1], columns.timed
    moving = courses.motion >= 0
    moves_by_itself = ways[moving].any(axis=0)
    members = csr_array((np.ones(int(moving.sum())), (courses.motion[moving], np.flatnonzero(moving))),
                        shape=(columns.fields.shape[2], columns.n))
    images, fourth, channels = np.zeros(n), np.zeros(n), np.zeros(n)
    nodal, weight = _NodalSquares(evidence), evidence.channel_weight[:, None]
    for t, part in enumerate(evidence.parts):
        of_motions = csr_array(members @ (courses.amplitude[t][:, None] * ways))  # (P, n)
        fields = parameters.fields[t] @ moves + columns.fields[t] @ of_motions
        images += np.einsum("ik,ik->k", fields, part.A @ fields)
        fourth += moves_by_itself * nodal.fourth_powers(part, fields)
        if columns.pixels is not None:
            grey = columns.pixels[t] @ ways
            images += np.einsum("ik,ik->k", grey, part.pixel.gram @ grey)
        channels += (weight * (columns.channels[t] @ ways + parameters.channels[t] @ moves)**2).sum(axis=0)
    n_rows = max(len(evidence.parts) * len(evidence.channel_weight), 1)
    px = np.sqrt(images / max(power(evidence).sum(), 1e-300))
    local_px = np.maximum(np.sqrt(np.divide(fourth, images, out=np.zeros(n), where=images > 0.0)), px)
    return [EffectSize(*sizes) for sizes in zip(px.tolist(), local_px.tolist(), np.sqrt(channels / n_rows).tolist(),
                                                strict=True)]


class _NodalSquares:
    """Squares of motions at the nodes that pixels see: the same nodes in all frames."""

    def __init__(self, evidence: Evidence):
        node, component = np.divmod(evidence.seen, evidence.n_components)
        planes = seen_planes(evidence)
        self.members = [component == k for k in planes]
        self.node = np.unique(node, return_inverse=True)[1]
        counted = np.isin(component, planes)
        self.sums = csr_array((np.ones(int(counted.sum())), (self.node[counted], np.flatnonzero(counted))),
                              shape=(int(self.node.max(initial=-1)) + 1, len(node)))

    def fourth_powers(self, part: FrameEvidence, fields: np.ndarray) -> np.ndarray:
        """Sum over the nodes of one frame of |u|^4, weighed by how well pixels see a motion there  # (K,)"""
        weights = np.zeros(self.sums.shape[0])
        for members in self.members:
            weights[self.node[members]] += (part.A @ members.astype(float))[members] / len(self.members)
        squares = self.sums @ np.square(fields, out=fields)
        return np.maximum(weights, 0.0) @ np.square(squares, out=squares)
