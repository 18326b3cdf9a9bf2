"""Decoys: patterns that no physics makes, as smooth in space and time as those of the candidates.

A decoy is a random field times a random course. The field is a random mixture of all that the candidates show in any
frame, which has their spectrum in space; the course a random mixture of their courses, which has theirs in time. On a
sound recording their scores are unit normal; where a decoy does as well as the best candidate, that one means little.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import stats

from idic.diagnose.residual.evidence import Columns, Evidence
from idic.diagnose.residual.score import NullModel, score


@dataclass(frozen=True)
class DecoyScores:
    """z : (n,) of the decoys, in standard deviations of noise."""

    z: np.ndarray

    @property
    def largest(self) -> float:
        return float(np.abs(self.z).max(initial=0.0))

    @property
    def p_normal(self) -> float:
        """Probability that unit normal scores look no more like it (Kolmogorov-Smirnov)."""
        return float(stats.kstest(self.z, "norm").pvalue) if len(self.z) else 1.0


def decoys(columns: Columns, rng: np.random.Generator, n: int) -> Columns:
    """Random columns with the spectra of `columns` in space and in time; grey values take no part."""
    columns = columns.expanded()
    size = np.sqrt((columns.fields**2).sum(axis=(0, 1)))  # (K,)
    shapes = columns.fields[:, :, size > 0.0] / size[size > 0.0]  # (T, n_seen, K)
    T, n_seen, K = shapes.shape
    places, courses = shapes.transpose(1, 0, 2).reshape(n_seen, -1), shapes.reshape(T, -1)
    rows = columns.channels.reshape(T, -1)
    fields, channels = np.empty((T, n_seen, n)), np.zeros((T, columns.channels.shape[1], n))
    channel_size = np.sqrt((columns.channels**2).sum(axis=0)).T[size > 0.0] / size[size > 0.0][:, None]  # (K, channels)
    for k in range(n):
        place, course = (m @ rng.standard_normal(m.shape[1]) for m in (places, courses))
        fields[:, :, k] = np.outer(course / np.linalg.norm(course), place / np.linalg.norm(place))
        if rows.size:
            force = rows @ rng.standard_normal(rows.shape[1])
            like = channel_size[rng.integers(K)] * rng.choice([-1.0, 1.0])
            channels[:, :, k] = np.outer(force / max(float(np.linalg.norm(force)), 1e-300), like)
    return Columns(tuple(f"decoy {k + 1}" for k in range(n)), fields, channels)


def decoy_scores(evidence: Evidence, null: NullModel, columns: Columns, seed: int = 0, n: int = 100) -> DecoyScores:
    """Scores of `n` decoys, the identified parameters projected out."""
    if not columns.n or not np.any(columns.fields):
        return DecoyScores(np.zeros(0))
    scores = score(evidence, null, decoys(columns, np.random.default_rng(seed), n))
    return DecoyScores(scores.z[scores.own > 0.0])
