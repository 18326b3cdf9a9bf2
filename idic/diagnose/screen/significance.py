"""Family-wise significance of candidates from the joint normal distribution of all scores."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import special, stats

from idic.diagnose.residual.score import Scores, symmetric_inverse

FAR_CHI2 = 600.0  # beyond, the tail of chi-square by its leading term


@dataclass(frozen=True)
class Significance:
    """How a candidate stands: its best column, its statistic and the probability that noise alone does as well.

    statistic : standard deviations of a unit normal with the same tail (one-sided where the sign is); p_familywise :
    over all candidates and all their columns together.
    """

    name: str
    best: int
    statistic: float
    p_familywise: float


def significances(scores: Scores, groups: Mapping[Any, Sequence[int]], signs: np.ndarray, rng: np.random.Generator,
                  sums: Mapping[int, Sequence[int]] | None = None, draws: int = 4000) -> dict[Any, Significance]:
    """Family-wise significance of candidates that are grids of columns, by the joint Gaussian of all scores.

    Parameters
    ----------
    groups : candidate -> its columns; the best of them counts
    signs : (K,) +1 or -1 where only that sign of the amplitude is possible, 0 where both are
    sums : column that is the best sum of others -> these: its square is chi-square distributed with their number
    draws : of N(0, correlation), from which the number of independent tests is calibrated
    """
    sums = sums or {}
    single = [i for i in range(len(scores.U)) if i not in sums]
    correlation = scores.correlation
    values, vectors = np.linalg.eigh(0.5 * (correlation + correlation.T)[np.ix_(single, single)])
    # the symmetric root: of equal eigenvalues any turned vectors are as good, and rounding would choose the draws
    root = (vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T
    noise, observed = np.zeros((draws, len(scores.U))), scores.z.copy()
    noise[:, single] = rng.standard_normal((draws, len(values))) @ root
    for column, members in sums.items():
        members = [i for i in members if scores.own[i] > 0]
        inner = symmetric_inverse(correlation[np.ix_(members, members)])
        noise[:, column] = _as_normal(np.einsum("di,ij,dj->d", noise[:, members], inner, noise[:, members]),
                                      len(members))
        observed[column] = _as_normal(np.square(observed[column]), len(members))
    usual = np.array(single, dtype=int)
    noise[:, usual], observed[usual] = _sided(noise[:, usual], signs[usual]), _sided(observed[usual], signs[usual])
    answers, every = {}, np.full(draws, -np.inf)
    for members in groups.values():
        every = np.maximum(every, noise[:, list(members)].max(axis=1))
    tests = _independent_tests(every)
    for name, members in groups.items():
        best = max(members, key=lambda i: observed[i])
        tail = float(stats.norm.sf(observed[best]))
        answers[name] = Significance(name, best, float(observed[best]), min(1.0, tests * tail))
    return answers


def _as_normal(chi2: np.ndarray, rank: int) -> np.ndarray:
    """Standard deviations of a unit normal with the upper tail of chi-square with `rank` degrees of freedom."""
    if rank == 0:
        return np.full_like(chi2, -np.inf)
    tail = stats.chi2.logsf(chi2, rank)
    asymptote = (0.5 * rank - 1.0) * np.log(np.maximum(0.5 * chi2, 1e-300)) - 0.5 * chi2 - special.gammaln(0.5 * rank)
    return -special.ndtri_exp(np.where(chi2 > FAR_CHI2, asymptote, tail))


def _sided(z: np.ndarray, signs: np.ndarray) -> np.ndarray:
    """A statistic with the tail of a one-sided unit normal: signed where the sign is known, else from both sides."""
    two_sided = stats.norm.isf(np.minimum(2.0 * stats.norm.sf(np.abs(z)), 1.0 - 1e-16))
    large = np.abs(z) > 30.0  # where the probability underflows: ln 2 / z less
    two_sided = np.where(large, np.abs(z) - np.log(2.0) / np.maximum(np.abs(z), 1.0), two_sided)
    return np.where(signs == 0, two_sided, z * signs)


def _independent_tests(maxima: np.ndarray, level: float = 0.01) -> float:
    """How many independent tests have this distribution of the maximum, matched at its upper per cent."""
    threshold = np.quantile(maxima, 1.0 - level)
    return float(max(level / max(stats.norm.sf(threshold), 1e-300), 1.0))
