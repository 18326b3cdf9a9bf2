"""Score tests: the gain of a missing effect, without a refit.

For a column s (white, per-frame unknowns projected out), identified parameters J and residual r,

    U = s^T (r - J G^-1 J^T r),    I = s^T s - s^T J G^-1 J^T s,    G = J^T J + priors
    expected change = U / I,  standard deviation 1/sqrt(I),  gain in chi-square U^2 / I,  visibility I / s^T s
    parameters would move by  -G^-1 J^T s (U / I)

U is projected explicitly: the identification need not have minimised this norm (Sörbom 1989, doi 10.1007/BF02294556).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, pairwise
from typing import Any

import numpy as np
from scipy import special, stats

from idic.diagnose.residual.evidence import Columns, Evidence

MIN_INFORMATION_SHARE = 1e-6  # of its own information: the rest of the column is rounding
FAR_CHI2 = 600.0  # beyond, the tail of chi-square by its leading term


@dataclass(frozen=True, eq=False)
class NullModel:
    """The identified model: its white columns, their Gram matrix with priors, and its own remaining step.

    remaining : (n,) G^-1 b, what the parameters would still move in this norm; gram, covariance : (n, n) G, G^-1;
    precision, pull : the part of G and b that the priors make.
    """

    white: Columns
    weighed: Columns
    gram: np.ndarray
    covariance: np.ndarray
    b: np.ndarray
    precision: np.ndarray
    pull: np.ndarray

    @property
    def names(self) -> tuple[str, ...]:
        return self.white.names

    @property
    def remaining(self) -> np.ndarray:
        return self.covariance @ self.b


def null_model(evidence: Evidence, columns: Columns) -> NullModel:
    """The identified parameters ready for tests; what their priors state counts like data.

    columns : derivatives by the identified parameters (not yet white)
    """
    white = evidence.whiten(columns)
    weighed = evidence.weighed(white)
    precision, pull = np.zeros((columns.n, columns.n)), np.zeros(columns.n)
    if evidence.parameters is not None:
        precision, pull = evidence.parameters.prior_equations(columns.names)
    gram = evidence.products(white, weighed) + precision
    return NullModel(white, weighed, gram, symmetric_inverse(gram), evidence.scores(white) + pull, precision, pull)


def symmetric_inverse(matrix: np.ndarray) -> np.ndarray:
    """Inverse of a positive semi-definite matrix over the directions that are not rounding, whatever their scales."""
    if not len(matrix):
        return matrix.copy()
    scale = np.sqrt(np.maximum(np.diagonal(matrix), 0.0))
    scale = np.where(scale > 0.0, scale, np.inf)
    values, vectors = np.linalg.eigh(matrix / np.outer(scale, scale))
    good = values > 1e-11 * max(values.max(), 1e-300)
    return (vectors[:, good] / values[good]) @ vectors[:, good].T / np.outer(scale, scale)


@dataclass(frozen=True, eq=False)
class Scores:
    """Score tests of K columns, all at once.

    U : (K,) score; gross : (K, K) s^T s; information : (K, K) the same after projection; moves : (n, K) change of the
    identified parameters per unit of the column's amplitude.
    """

    names: tuple[str, ...]
    parameters: tuple[str, ...]
    U: np.ndarray
    gross: np.ndarray
    information: np.ndarray
    moves: np.ndarray

    @property
    def own(self) -> np.ndarray:
        """Information of each column alone, 0 where it is invisible  # (K,)"""
        information = np.diagonal(self.information)
        return np.where(information > MIN_INFORMATION_SHARE * np.diagonal(self.gross), information, 0.0)

    @property
    def z(self) -> np.ndarray:
        """Score in standard deviations; 0 where the column is invisible  # (K,)"""
        return np.divide(self.U, np.sqrt(self.own), out=np.zeros_like(self.U), where=self.own > 0)

    @property
    def expected_change(self) -> np.ndarray:
        """Amplitude that the residual asks for  # (K,)"""
        return np.divide(self.U, self.own, out=np.zeros_like(self.U), where=self.own > 0)

    @property
    def std(self) -> np.ndarray:
        """Standard deviation of the amplitude, infinite where invisible  # (K,)"""
        return np.divide(1.0, np.sqrt(self.own), out=np.full_like(self.U, np.inf), where=self.own > 0)

    @property
    def visibility(self) -> np.ndarray:
        """Share of a column that the identified parameters cannot imitate, 0 … 1  # (K,)"""
        gross = np.diagonal(self.gross)
        return np.divide(self.own, gross, out=np.zeros_like(self.U), where=gross > 0)

    @property
    def correlation(self) -> np.ndarray:
        """Correlation of the projected columns: 1 = no test can tell them apart  # (K, K)"""
        size = np.sqrt(np.where(self.own > 0, self.own, np.inf))
        return self.information / np.outer(size, size)

    def gain(self, members: Sequence[int]) -> float:
        """Drop of chi-square for a group of columns together."""
        members = [i for i in members if self.own[i] > 0]
        block = self.information[np.ix_(members, members)]
        return float(self.U[members] @ symmetric_inverse(block) @ self.U[members])

    def split(self) -> tuple[Scores, np.ndarray]:
        """The scores of all columns but the last, and what each shares with that one: its information  # (K - 1,)"""
        return self.first(-1), self.information[:-1, -1]

    def first(self, n: int) -> Scores:
        """Those of the first n columns, or of all but the last -n."""
        return Scores(self.names[:n], self.parameters, self.U[:n], self.gross[:n, :n], self.information[:n, :n],
                      self.moves[:, :n])

    def beyond_errors(self, shared: np.ndarray) -> Scores:
        """The scores less what errors of the simulation with amplitudes between 0 and 1 may leave along every column.

        shared : (K, n) information that the columns share with the errors
        """
        low, high = np.minimum(shared, 0.0).sum(axis=1), np.maximum(shared, 0.0).sum(axis=1)
        return replace(self, U=self.U - np.clip(self.U, low, high))

    def beside(self, n: int, std: float, members: np.ndarray) -> Scores:
        """The scores of all columns but the last n, which are in every model with amplitudes of 1 +- std.

        members : (K - n,) bool, the columns that are of one kind with those; what they share with others is not counted
        """
        first = len(self.U) - n
        shared = self.information[first:, :first]  # (n, K - n)
        inverse = np.linalg.inv(self.information[first:, first:] + std**-2.0 * np.eye(n))
        amplitudes, response = inverse @ (self.U[first:] + std**-2.0), -inverse @ (shared * members)
        change = shared.T @ response
        change = np.where(members, change, change.T)
        return Scores(self.names[:first], self.parameters, self.U[:first] - members * (amplitudes @ shared),
                      self.gross[:first, :first], self.information[:first, :first] + change,
                      self.moves[:, :first] + self.moves[:, first:] @ response)

    def together(self, members: Sequence[int]) -> np.ndarray:
        """Expected change of the visible columns of a group together, 0 of the others  # (len(members),)"""
        members, changes = np.asarray(members), np.zeros(len(members))
        is_visible = self.own[members] > 0
        block = self.information[np.ix_(members[is_visible], members[is_visible])]
        changes[is_visible] = symmetric_inverse(block) @ self.U[members[is_visible]]
        return changes

    def with_sums(self, names: Sequence[str], groups: Sequence[Sequence[int]]) -> Scores:
        """These scores and those of the best sum of every group, a column each behind the others."""
        ways = np.eye(len(self.U), len(self.U) + len(groups))
        for k, members in enumerate(groups, start=len(self.U)):
            ways[list(members), k] = self.together(members)
        return Scores((*self.names, *names), self.parameters, self.U @ ways, ways.T @ self.gross @ ways,
                      ways.T @ self.information @ ways, self.moves @ ways)

    def bias_uncovered(self, i: int) -> dict[str, float]:
        """How far the identified parameters would move with column i in the model (units of the columns)."""
        return dict(zip(self.parameters, self.moves[:, i] * self.expected_change[i], strict=True))


def score(evidence: Evidence, null: NullModel, *columns: Columns) -> Scores:
    """Test columns (not yet white) against the identified model, of one set or of several behind each other.

    Columns of grey values alone, which move nothing, take no part in the products of motions (`Columns.apart`). Frames
    are made white and weighed one at a time: all of them together take three times the memory of the columns.
    """
    parts = [part for group in columns for part in group.apart()]
    ends = np.cumsum([0, *(part.n for part in parts)])
    at = [slice(begin, end) for begin, end in pairwise(ends.tolist())]
    cross, gross, scored = np.zeros((null.white.n, ends[-1])), np.zeros((ends[-1], ends[-1])), np.zeros(ends[-1])
    for t, white in enumerate(zip(*map(evidence.white_frames, parts), strict=True)):
        frame = evidence.frame(t)
        weighed, null_white, null_weighed = [frame.weighed(part) for part in white], null.white.frame(
            t), null.weighed.frame(t)
        for i, (left_part, left_heavy) in enumerate(zip(white, weighed, strict=True)):
            # the weights are symmetric: what moves nothing stands on the left, without its fields
            cross[:, at[i]] += (frame.products(null_white, left_heavy) if left_heavy.moves
                                else frame.products(left_part, null_weighed).T)
            scored[at[i]] += frame.scores(left_part)
            for k in range(i, len(parts)):
                gross[at[i], at[k]] += (frame.products(left_part, weighed[k])
                                        if weighed[k].moves or not left_part.moves
                                        else frame.products(white[k], left_heavy).T)
    for i, k in combinations(range(len(parts)), 2):
        gross[at[k], at[i]] = gross[at[i], at[k]].T
    moves = -null.covariance @ cross
    U = scored + moves.T @ null.b
    information = gross + cross.T @ moves
    names = sum((group.names for group in columns), ())
    return Scores(names, null.names, U, gross, 0.5 * (information + information.T), moves)


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
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    noise, observed = np.zeros((draws, len(scores.U))), scores.z.copy()
    noise[:, single] = rng.standard_normal((draws, len(values))) @ root.T
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
