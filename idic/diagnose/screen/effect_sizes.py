"""Columns that count together as one, and the size of effects: motion in px, readings in standard deviations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from idic.diagnose.residual.evidence import Columns, Evidence, joined
from idic.diagnose.residual.excess import power
from idic.diagnose.screen.free_courses import with_knots
from idic.diagnose.screen.score import Scores
from idic.diagnose.screen.score_columns import ScoreColumn


def columns_together(trials: Sequence[ScoreColumn]) -> list[list[int]]:
    """The columns of every variant whose columns count together."""
    found: dict[int, list[int]] = {}
    for i, trial in enumerate(trials):
        if trial.variant.counts_together:
            found.setdefault(id(trial.variant), []).append(i)
    return [members for members in found.values() if len(members) > 1]


def sum_of(members: Sequence[ScoreColumn]) -> ScoreColumn:
    """The best sum of some columns of one variant as a column; of a free course with the knots of these alone."""
    variant = members[0].variant
    if variant.free_course and variant.new:
        variant = with_knots(variant, [one.name for one in members])
    return replace(members[0], variant=variant, name=variant.label)


def with_sums(columns: Columns, scores: Scores, groups: Sequence[Sequence[int]]) -> Columns:
    """The columns and the best sum of every group  # (…, K + len(groups))"""
    if not groups:
        return columns
    ways = np.zeros((columns.n, len(groups)))
    for k, members in enumerate(groups):
        ways[list(members), k] = scores.together(members)
    return joined(columns, Columns(scores.names[columns.n:], columns.fields @ ways, columns.channels @ ways,
                                   None if columns.pixels is None else columns.pixels @ ways))


def effects(evidence: Evidence, parameters: Columns, columns: Columns, scores: Scores) -> tuple[np.ndarray, np.ndarray]:
    """Size per unit amplitude of each column, the identified parameters projected out, rms over pixels and frames.

    Motion is weighed by the contrast of the texture: rms^2 = 2 sum (grad f . s)^2 / sum |grad f|^2 in a plane. Columns
    of grey values and heights count as the motion that would change as much.

    Returns
    -------
    px, channel : (K,), (K,) px (images), standard deviations of one reading (channels)
    """
    weight = evidence.channel_weight[:, None]
    images, channels = np.zeros(columns.n), np.zeros(columns.n)
    for t, part in enumerate(evidence.parts):
        fields = columns.fields[t] + parameters.fields[t] @ scores.moves
        images += np.einsum("ik,ik->k", fields, part.A @ fields)
        if columns.pixels is not None:
            images += np.einsum("ik,ik->k", columns.pixels[t], part.pixel.gram @ columns.pixels[t])
        rows = columns.channels[t] + parameters.channels[t] @ scores.moves
        channels += (weight * rows**2).sum(axis=0)
    n_rows = max(len(evidence.parts) * len(evidence.channel_weight), 1)
    return np.sqrt(images / max(power(evidence).sum(), 1e-300)), np.sqrt(channels / n_rows)
