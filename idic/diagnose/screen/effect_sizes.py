"""Columns that count together as one, and the size of effects: motion in px, readings in standard deviations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from idic.diagnose.residual.evidence import Columns, Evidence
from idic.diagnose.residual.excess import power
from idic.diagnose.residual.score import Scores
from idic.diagnose.screen.free_courses import with_knots
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


def effects(evidence: Evidence, parameters: Columns, columns: Columns, scores: Scores,
            groups: Sequence[Sequence[int]] = ()) -> tuple[np.ndarray, np.ndarray]:
    """Size per unit amplitude of each column and of the best sum of every group, the identified parameters projected
    out, rms over pixels and frames.

    Motion is weighed by the contrast of the texture: rms^2 = 2 sum (grad f . s)^2 / sum |grad f|^2 in a plane. Columns
    of grey values and heights count as the motion that would change as much.

    Parameters
    ----------
    scores : of the columns and the sums (`Scores.with_sums`)

    Returns
    -------
    px, channel : (K + len(groups),) each, px (images), standard deviations of one reading (channels)
    """
    parts, n = columns.apart(), columns.n
    ways = np.zeros((n, len(groups)))
    for k, members in enumerate(groups):
        ways[list(members), k] = scores.together(members)
    weight, moves = evidence.channel_weight[:, None], scores.moves
    n_moving = parts[0].n if parts[0].moves else 0
    moving = np.concatenate([np.arange(n_moving), n + np.flatnonzero(ways[:n_moving].any(axis=0))]).astype(int)
    still = np.setdiff1d(np.arange(n + len(groups)), moving)
    images, channels = np.zeros(n + len(groups)), np.zeros(n + len(groups))
    for t, part in enumerate(evidence.parts):
        moving_fields = columns.fields[t][:, :n_moving]
        summed = moving[n_moving:]
        fields = np.hstack([moving_fields, moving_fields @ ways[:n_moving, summed - n]])
        fields = fields + parameters.fields[t] @ moves[:, moving]
        images[moving] += np.einsum("ik,ik->k", fields, part.A @ fields)
        # of columns that move nothing the parameters alone move
        gram = parameters.fields[t].T @ (part.A @ parameters.fields[t])
        images[still] += np.einsum("ik,ij,jk->k", moves[:, still], gram, moves[:, still])
        if columns.pixels is not None:
            grey = np.hstack([columns.pixels[t], columns.pixels[t] @ ways])
            images += np.einsum("ik,ik->k", grey, part.pixel.gram @ grey)
        rows = np.hstack([columns.channels[t], columns.channels[t] @ ways]) + parameters.channels[t] @ moves
        channels += (weight * rows**2).sum(axis=0)
    n_rows = max(len(evidence.parts) * len(evidence.channel_weight), 1)
    return np.sqrt(images / max(power(evidence).sum(), 1e-300)), np.sqrt(channels / n_rows)
