"""Score tests: the gain of a missing effect, without a refit.

For a column s (white, per-frame unknowns projected out), identified parameters J and residual r,

    U = s^T (r - J G^-1 J^T r),    I = s^T s - s^T J G^-1 J^T s,    G = J^T J + priors
    expected change = U / I,  standard deviation 1/sqrt(I),  gain in chi-square U^2 / I,  visibility I / s^T s
    parameters would move by  -G^-1 J^T s (U / I)

U is projected explicitly: the identification need not have minimised this norm (Sörbom 1989, doi 10.1007/BF02294556).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from idic.diagnose.residual.evidence import CommonWeights, Columns, Evidence, add_turned, flat, inverse_at_nodes, joined
from idic.diagnose.residual.grey_value_effects import PixelPart

MIN_INFORMATION_SHARE = 1e-6  # of its own information: the rest of the column is rounding


@dataclass(frozen=True, eq=False)
class NullModel:
    """The identified model: its white columns, their Gram matrix with priors, and its own remaining step.

    columns, white, weighed : derivatives by the parameters, as they are, white, and times the weights; remaining : (n,)
    G^-1 b, what the parameters would still move in this norm; gram, covariance : (n, n) G, G^-1;
    precision, pull : the part of G and b that the priors make.
    """

    columns: Columns
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
    return NullModel(columns, white, weighed, gram, symmetric_inverse(gram), evidence.scores(white) + pull, precision,
                     pull)


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

    def ways(self, groups: Sequence[Sequence[int]]) -> np.ndarray:
        """Every column and the best sum of every group as sums of columns  # (K, K + n_groups)"""
        ways = np.eye(len(self.U), len(self.U) + len(groups))
        for k, members in enumerate(groups, start=len(self.U)):
            ways[list(members), k] = self.together(members)
        return ways

    def with_sums(self, names: Sequence[str], groups: Sequence[Sequence[int]]) -> Scores:
        """These scores and those of the best sum of every group, a column each behind the others."""
        ways = self.ways(groups)
        return Scores((*self.names, *names), self.parameters, self.U @ ways, ways.T @ self.gross @ ways,
                      ways.T @ self.information @ ways, self.moves @ ways)

    def bias_uncovered(self, i: int) -> dict[str, float]:
        """How far the identified parameters would move with column i in the model (units of the columns)."""
        return dict(zip(self.parameters, self.moves[:, i] * self.expected_change[i], strict=True))


def score(evidence: Evidence, null: NullModel, *columns: Columns) -> Scores:
    """Test columns (not yet white) against the identified model, of one set or of several behind each other."""
    gram, scored = white_products(evidence, joined(null.columns, *columns))
    n = null.columns.n
    cross, gross = gram[:n, n:], gram[n:, n:]
    moves = -null.covariance @ cross
    U = scored[n:] + moves.T @ null.b
    information = gross + cross.T @ moves
    names = sum((group.names for group in columns), ())
    return Scores(names, null.names, U, gross, 0.5 * (information + information.T), moves)


def white_products(evidence: Evidence, columns: Columns) -> tuple[np.ndarray, np.ndarray]:
    """Gram matrix of columns, white and weighed with the frame-local unknowns projected out, and their products with
    the weighted residual: those of `Evidence.whiten`, `weighed`, `products` and `scores`  # (K, K), (K,)

    columns : not yet white
    """
    frames = _WhiteFrames(evidence, columns)
    for t in range(len(evidence.parts)):
        frames.add(t)
    return frames.products()


class _WhiteFrames:
    """Sums of products over white frames.

    In frame t a motion s with the course a is (a_t s_t - c B_t^-1 S) / sqrt(kappa_t), S = sum_t a_t B_t s_t / kappa_t:
    its own part, and one that all frames have in common. Own parts meet each other by motions, which are fewer than
    the columns; S meets the sum over the frames of what it has to meet, once for all of them.
    """

    def __init__(self, evidence: Evidence, columns: Columns):
        self.evidence, self.columns, self.nodes = evidence, columns, evidence.seen_nodes
        courses, K = columns.timed, columns.n
        self.moving = np.flatnonzero(courses.motion >= 0)
        self.motion, root = courses.motion[self.moving], np.sqrt(evidence.kappa)[:, None]
        self.amplitude = courses.amplitude[:, self.moving] / root
        self.pixels = evidence.white_pixels(columns.amplitudes(len(evidence.pixel_names)))
        self.grey = np.flatnonzero(self.pixels.any(axis=(0, 1)))
        self.common_share = evidence.share / root[:, 0]
        shape = (len(self.nodes.numbers), evidence.n_components)
        self.common = np.zeros((*shape, len(self.moving)))
        for t, back in enumerate(evidence.back[:, self.nodes.numbers]):
            add_turned(back, self.nodes.spread(columns.fields[t]), self.motion, self.amplitude[t] / root[t, 0],
                       self.common)
        # what the common parts meet: the own parts, grey values, the residual and, over all frames, each other
        self.met_by_motions, self.met_by_grey = np.zeros(self.common.shape), np.zeros((*shape, len(self.grey)))
        self.met_by_residual, self.weights = np.zeros((*shape, 1)), CommonWeights(self.nodes)
        self.of_motions = np.zeros((len(self.moving), len(self.moving)))
        self.of_both = np.zeros((len(self.moving), len(self.grey)))
        self.rest, self.scored = np.zeros((K, K)), np.zeros(K)

    def add(self, t: int) -> None:
        """The products of one frame."""
        evidence, part = self.evidence, self.evidence.parts[t]
        n, fields, rows, A = len(part.q), self.columns.fields[t], self.columns.channels[t], part.A
        inverse, share = inverse_at_nodes(evidence.back[t, self.nodes.numbers]), self.common_share[t]
        transposed, a = np.ascontiguousarray(inverse.transpose(0, 2, 1)), self.amplitude[t]

        def meet(met: np.ndarray, heavy: np.ndarray, motion: np.ndarray, amplitude: np.ndarray) -> None:
            add_turned(transposed, self.nodes.spread(heavy), motion, share * amplitude, met)

        heavy, (q, channel_q) = A @ fields, evidence.residual(part)
        self.of_motions += (fields.T @ heavy)[np.ix_(self.motion, self.motion)] * np.outer(a, a)
        meet(self.met_by_motions, heavy, self.motion, a)
        meet(self.met_by_residual, q[:, None], np.zeros(1, dtype=int), np.ones(1))
        self.weights.add(A, inverse, share**2)
        self.scored[self.moving] += a * (q @ fields)[self.motion]
        self.scored += channel_q @ rows
        bordered = part.border[n:].T @ rows
        turned = flat(np.matmul(transposed, self.nodes.spread(part.border[:n])))
        bordered[:, self.moving] += a * (part.border[:n].T @ fields)[:, self.motion]
        bordered[:, self.moving] -= share * (turned.T @ flat(self.common))
        self.rest += rows.T @ (evidence.channel_weight[:, None] * rows) - bordered.T @ part.inner @ bordered
        if part.pixel is not None and len(self.grey):
            self._add_grey(t, part.pixel, bordered, meet)

    def _add_grey(self, t: int, pixel: PixelPart, bordered: np.ndarray, meet: Callable[..., None]) -> None:
        """The products with grey values in one frame; bordered : (m, K) of motions and channels with its unknowns."""
        part, grey, amplitudes = self.evidence.parts[t], self.grey, self.pixels[t][:, self.grey]
        coupled = pixel.coupling @ amplitudes
        self.of_both += self.amplitude[t][:, None] * (self.columns.fields[t].T @ coupled)[self.motion]
        meet(self.met_by_grey, coupled, np.arange(len(grey)), np.ones(len(grey)))
        by_unknowns = bordered.T @ part.inner @ (pixel.border.T @ amplitudes)  # (K, n_grey)
        self.rest[:, grey] -= by_unknowns
        self.rest[grey] -= by_unknowns.T
        alike = pixel.among.T @ amplitudes
        self.rest[np.ix_(grey, grey)] += amplitudes.T @ pixel.gram @ amplitudes - alike.T @ part.inner @ alike
        self.scored[grey] += self.evidence.pixel_residual(part) @ amplitudes

    def products(self) -> tuple[np.ndarray, np.ndarray]:
        """Of all frames."""
        common, moving = flat(self.common), self.moving
        half = common.T @ (0.5 * self.weights.times(common) - flat(self.met_by_motions))
        gram, scored = self.rest, self.scored
        gram[np.ix_(moving, moving)] += self.of_motions + half + half.T
        of_both = self.of_both - common.T @ flat(self.met_by_grey)
        gram[np.ix_(moving, self.grey)] += of_both
        gram[np.ix_(self.grey, moving)] += of_both.T
        scored[moving] -= (common.T @ flat(self.met_by_residual))[:, 0]
        return gram, scored
