"""Columns that count together as one, and the size of effects: motion in px, readings in standard deviations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import csr_array

from idic.diagnose.residual.evidence import Columns, Evidence, FrameEvidence
from idic.diagnose.residual.excess import power, seen_planes
from idic.diagnose.residual.score import Scores
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


@dataclass(frozen=True, eq=False)
class EffectSizes:
    """Sizes of effects, one per column and per best sum of a group, of what the identified parameters cannot imitate.

    px : rms over pixels and frames; local_px : the same weighed by the effect itself, its size where and when it acts;
    channel : standard deviations of one reading, rms; each (K + n_groups,)
    """

    px: np.ndarray
    local_px: np.ndarray
    channel: np.ndarray

    def of(self, column: int, amplitude: float) -> EffectSize:
        """Of one column with this amplitude."""
        px, local_px, channel = (float(abs(amplitude) * sizes[column]) for sizes in (self.px, self.local_px,
                                                                                     self.channel))
        return EffectSize(px, local_px, channel)


def effects(evidence: Evidence, parameters: Columns, columns: Columns, scores: Scores,
            groups: Sequence[Sequence[int]] = ()) -> EffectSizes:
    """Size per unit amplitude of each column and of the best sum of every group, the identified parameters projected
    out.

    Motion is weighed by the contrast of the texture: rms^2 = 2 sum (grad f . s)^2 / sum |grad f|^2 in a plane. Columns
    of grey values and heights count as the motion that would change as much.

    Parameters
    ----------
    scores : of the columns and the sums (`Scores.with_sums`)
    """
    parts, n = columns.apart(), columns.n
    ways = np.zeros((n, len(groups)))
    for k, members in enumerate(groups):
        ways[list(members), k] = scores.together(members)
    weight, moves = evidence.channel_weight[:, None], scores.moves
    n_moving = parts[0].n if parts[0].moves else 0
    summed = np.flatnonzero(ways[:n_moving].any(axis=0))
    moving = np.concatenate([np.arange(n_moving), n + summed]).astype(int)
    still = np.setdiff1d(np.arange(n + len(groups)), moving)
    images, fourth, channels = (np.zeros(n + len(groups)) for _ in range(3))
    nodal = _NodalSquares(evidence)
    for t, part in enumerate(evidence.parts):
        fields = parameters.fields[t] @ moves[:, moving]
        fields[:, :n_moving] += columns.fields[t][:, :n_moving]
        if len(summed):
            fields[:, n_moving:] += columns.fields[t][:, :n_moving] @ ways[:n_moving, summed]
        images[moving] += np.einsum("ik,ik->k", fields, part.A @ fields)
        # of columns that move nothing the parameters alone move
        gram = parameters.fields[t].T @ (part.A @ parameters.fields[t])
        images[still] += np.einsum("ik,ij,jk->k", moves[:, still], gram, moves[:, still])
        fourth[moving] += nodal.fourth_powers(part, fields)
        if columns.pixels is not None:
            grey = np.hstack([columns.pixels[t], columns.pixels[t] @ ways])
            images += np.einsum("ik,ik->k", grey, part.pixel.gram @ grey)
        rows = np.hstack([columns.channels[t], columns.channels[t] @ ways]) + parameters.channels[t] @ moves
        channels += (weight * rows**2).sum(axis=0)
    n_rows = max(len(evidence.parts) * len(evidence.channel_weight), 1)
    px = np.sqrt(images / max(power(evidence).sum(), 1e-300))
    local_px = np.sqrt(np.divide(fourth, images, out=np.zeros_like(images), where=images > 0.0))
    return EffectSizes(px, np.maximum(local_px, px), np.sqrt(channels / n_rows))


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
