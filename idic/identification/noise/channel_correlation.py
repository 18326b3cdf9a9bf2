"""Noise of a channel that is correlated from frame to frame: its covariance, from what the accepted fit leaves.

A load cell drifts, a signal is filtered: the noise of a channel is then an autoregression (order 0, 1 or 2) over the
frames. A parameter that follows the channel gets a larger error than independent noise of that size would give it,
since its error does not average out. The residual of the channel at the accepted point,

    r = (1 - S A^-1 S^T Sigma^-1) n,   A = M_rest + S^T Sigma^-1 S   (docs/method.md, equation 11.7)

has lost what the parameters took. Its restricted likelihood, with S the derivatives of the channel by the parameters
and M_rest the information of everything else, gives every covariance Sigma of a grid its probability. Few frames do not
tell the correlation: the covariance is the mean over the grid, as no single one would count that uncertainty. Where the
grid leaves independent noise at more than even odds, the noise is taken as independent, with the stated standard
deviation. Where none is stated, the mean over a grid of standard deviations is taken: the differences of a short log
give between a quarter of the true value and twice as much (Patterson & Thompson 1971, doi:10.1093/biomet/58.3.545;
autoregressions: Box, Jenkins & Reinsel 2008, doi:10.1002/9781118619193).

A channel may also be off by a smooth course, as a load cell or the form of a law is. Where independent noise beside a
smooth error, of equal size or a share of the readings, is likelier than the autoregressions (`SMOOTH_PRIOR` counted),
the mean covariance of that error is kept apart from the noise: it belongs to the error of the model.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
import scipy

MIN_FRAMES = 8  # that a channel is compared in; fewer do not tell a correlation
MIN_LEFT = 4.0  # readings that the parameters leave free; fewer do not tell the size of independent noise
FIRST_ORDER = (0.15, 0.3, 0.45, 0.6, 0.7, 0.8, 0.9, 0.95)  # correlation of consecutive frames
SECOND_ORDER = (0.3, 0.6, 0.8, 0.9), (-0.6, -0.3, 0.3, 0.6)  # the same, and partial correlation at two frames
MIN_FRAMES_OF_SECOND_ORDER = 30
PRIOR = {0: 0.5, 1: 0.35, 2: 0.15}  # of the orders; of those that are tried
MAX_PROBABILITY_OF_INDEPENDENCE = 0.5
SMOOTH_PRIOR = 0.1  # of a smooth error; it is counted from even odds on
SMOOTH_LENGTHS = (0.15, 0.3, 0.6, 1.0)  # over the recording, of squared exponentials
ROUGH_LENGTHS = (0.3, 1.0)  # the same, of exponentials
SMOOTH_RATIOS = np.geomspace(0.5, 200.0, 20)  # of the smooth error over the standard deviation of a reading
WHITE_RATIOS = np.geomspace(0.25, 4.0, 10)  # of independent noise beside it, where none is stated
MAX_KNOTS, JITTER = 24, 1e-9
STD_RATIOS = np.geomspace(0.5, 8.0, 25)  # of the standard deviation that differences show, where none is stated
INDEPENDENT_RATIOS = np.geomspace(0.25, 32.0, 169)  # the same, of independent noise
MIN_LOCAL_VARIANCE_SHARE = 1e-6  # of the variance of a reading: of a channel that no frame is fitted to
BLOCK = 256  # frames whose correlation the likelihood counts; longer tests: block by block


@dataclass(frozen=True, eq=False)
class ChannelNoise:
    """The noise of one channel over its compared frames.

    std : of a reading; covariance : (T, T) of all readings; order : of the likeliest autoregression
    correlation : of two consecutive frames; independent : probability that the readings are independent
    smooth : (T, T) covariance of a smooth error of the simulated readings beside the noise, None where none shows;
    likelihood_ratio : twice its gain in log-likelihood over noise alone
    """

    std: float
    covariance: np.ndarray
    order: int
    correlation: float
    independent: float
    smooth: np.ndarray | None = None
    likelihood_ratio: float = 0.0

    @property
    def is_correlated(self) -> bool:
        return self.independent < MAX_PROBABILITY_OF_INDEPENDENCE


def channel_correlation(residual: np.ndarray, rows: np.ndarray, frames: Sequence[int], M_other: np.ndarray,
                        rhs: np.ndarray, std: float, is_stated: bool, local: np.ndarray | None = None,
                        simulated: np.ndarray | None = None) -> ChannelNoise | None:
    """Covariance of the noise of a channel; None where too few frames tell it.

    Parameters
    ----------
    residual : (T,) measured less simulated at the accepted point
    rows : (T, n) derivatives of the simulated values by the unknowns
    frames : numbers of the T frames; those that are left out count as time that passes
    M_other, rhs : (n, n), (n,) normal equations of everything but this channel
    std : of a reading; is_stated : whether it is given, else it is that of differences, and is estimated anew
    local : (T, T) covariance of the simulated values by what frames alone are fitted with (measured ends); None: none
    simulated : (T,) values that a smooth error may be a share of; None: it is no share
    """
    local = np.zeros((len(residual),) * 2) if local is None else local
    equations = _Equations(residual, rows, M_other, rhs, local + MIN_LOCAL_VARIANCE_SHARE * std**2 * np.eye(len(local)))
    noise = _over_grid(equations, np.asarray(frames), std, is_stated, simulated)
    if is_stated or (noise is not None and (noise.is_correlated or noise.smooth is not None)):
        return noise
    return _independent(equations, std, 1.0 if noise is None else noise.independent)


@dataclass(frozen=True, eq=False)
class _Equations:
    """Of a channel, and of everything else, as in `channel_correlation`."""

    residual: np.ndarray
    rows: np.ndarray
    M_other: np.ndarray
    rhs: np.ndarray
    local: np.ndarray

    def log_likelihoods(self, correlation: np.ndarray, stds: np.ndarray) -> np.ndarray:
        """Restricted log-likelihood of every standard deviation, up to a constant  # (len(stds),)

        With B = L L^T, of L (s^2 V Lambda V^T + 1) L^T, the covariance s^2 C + B of a block, V serves all s.
        """
        columns, spread, log_det = [], [], 0.0
        for first in range(0, len(self.residual), BLOCK):
            block = slice(first, first + BLOCK)
            root = np.linalg.cholesky(self.local[block, block])
            half = scipy.linalg.solve_triangular(root, correlation[block, block], lower=True)
            values, vectors = np.linalg.eigh(scipy.linalg.solve_triangular(root, half.T, lower=True))
            data = np.column_stack([self.rows[block], self.residual[block]])
            columns.append(vectors.T @ scipy.linalg.solve_triangular(root, data, lower=True))
            spread.append(values)
            log_det += 2.0 * float(np.log(np.diagonal(root)).sum())
        white, values = np.vstack(columns), np.concatenate(spread)
        variances = np.maximum(stds[:, None] ** 2 * values, 0.0) + 1.0  # (len(stds), T)
        weighed = white.T / variances[:, None, :]
        return self._restricted(weighed @ white, log_det + np.log(variances).sum(axis=1))

    def factor(self, white: float) -> np.ndarray:
        """Root of the covariance of the readings with independent noise of this standard deviation  # (T, T)"""
        return np.linalg.cholesky(self.local + white**2 * np.eye(len(self.local)))

    def log_likelihoods_of_smooth(self, root: np.ndarray, factor: np.ndarray, stds: np.ndarray) -> np.ndarray:
        """The same of readings with independent noise and a smooth error  # (len(stds),)

        root : (T, m) with root root^T the correlation of the error; factor : of the noise. By the identity of Woodbury
        only matrices of m rows depend on the standard deviation of the error.
        """
        half = scipy.linalg.solve_triangular(factor, np.column_stack([self.rows, self.residual, root]), lower=True)
        n = self.rows.shape[1] + 1
        data, half_root = half[:, :n], half[:, n:]
        values, vectors = np.linalg.eigh(half_root.T @ half_root)
        across, products = vectors.T @ (half_root.T @ data), data.T @ data
        variances = 1.0 + stds[:, None] ** 2 * np.maximum(values, 0.0)  # (len(stds), m)
        shares = across.T * (stds[:, None] ** 2 / variances)[:, None, :]
        log_det = 2.0 * float(np.log(np.diagonal(factor)).sum())
        return self._restricted(products - shares @ across, log_det + np.log(variances).sum(axis=1))

    def _restricted(self, products: np.ndarray, log_det: np.ndarray) -> np.ndarray:
        """Of S covariances. products : (S, n + 1, n + 1) of rows and residual, weighed by their inverse; log_det :
        (S,)"""
        n = len(self.rhs)
        M, b = self.M_other + products[:, :n, :n], self.rhs + products[:, :n, n]
        eigenvalues, vectors = np.linalg.eigh(0.5 * (M + M.swapaxes(1, 2)))
        # a direction that nothing determines is the same for all
        keep = eigenvalues > 1e-12 * eigenvalues.max(axis=1, keepdims=True, initial=1e-300)
        along = (vectors.swapaxes(1, 2) @ b[:, :, None])[..., 0]
        inverse, pivots = 1.0 / np.where(keep, eigenvalues, np.inf), np.where(keep, eigenvalues, 1.0)
        return -0.5 * (log_det + np.log(pivots).sum(axis=1) + products[:, n, n] - (along**2 * inverse).sum(axis=1))


@dataclass(frozen=True, eq=False)
class _Entry:
    """A row of the grid: covariances scale^2 C + white^2, and their log-likelihoods with the prior.

    correlation : makes C (T, T), which is not kept: there are over a hundred rows; order : of an autoregression;
    next_to : its correlation of consecutive frames
    """

    correlation: Callable[[], np.ndarray]
    scales: np.ndarray
    logs: np.ndarray
    white: float = 0.0
    order: int = 0
    next_to: float = 0.0


def _over_grid(equations: _Equations, frames: np.ndarray, std: float, is_stated: bool,
               simulated: np.ndarray | None) -> ChannelNoise | None:
    """The mean over the autoregressions, or over the smooth errors where these are likelier; None with too few
    frames."""
    if len(frames) < MIN_FRAMES:
        return None
    of_noise = [*_autoregressive_entries(equations, frames, std * (np.ones(1) if is_stated else STD_RATIOS))]
    smooth = _smooth_entries(equations, frames, std * (np.ones(1) if is_stated else WHITE_RATIOS), std, simulated)
    gain = _evidence(smooth) - _evidence(of_noise)
    entries = smooth if gain > np.log((1.0 - SMOOTH_PRIOR) / SMOOTH_PRIOR) else of_noise
    weights = _probabilities(np.concatenate([entry.logs for entry in entries]))
    rows = np.split(weights, np.cumsum([len(entry.logs) for entry in entries])[:-1])
    sums = [float(row @ entry.scales**2) for entry, row in zip(entries, rows, strict=True)]
    parts = np.zeros((len(frames),) * 2)
    for size, entry in zip(sums, entries, strict=True):
        parts += size * entry.correlation()
    white = sum(float(row.sum()) * entry.white**2 for entry, row in zip(entries, rows, strict=True))
    if entries is smooth:
        return ChannelNoise(float(np.sqrt(white)), white * np.eye(len(frames)), 0, 0.0, 1.0, parts, 2.0 * gain)
    per_order = {order: sum(float(row.sum()) for entry, row in zip(entries, rows, strict=True) if entry.order == order)
                 for order in {entry.order for entry in entries}}
    variance = float(parts[0, 0])
    next_to = sum(size * entry.next_to for size, entry in zip(sums, entries, strict=True))
    return ChannelNoise(float(np.sqrt(variance)), parts, max(per_order, key=lambda order: per_order[order]),
                        float(next_to / variance), per_order[0])


def _evidence(entries: Sequence[_Entry]) -> float:
    """Logarithm of the probability of the data, mean over the entries by their priors."""
    logs = np.concatenate([entry.logs for entry in entries])
    return float(logs.max() + np.log(np.exp(logs - logs.max()).sum()))


def _autoregressive_entries(equations: _Equations, frames: np.ndarray, stds: np.ndarray) -> Iterator[_Entry]:
    lags = np.abs(np.subtract.outer(frames, frames))
    for order, course, prior in _autoregressions(len(frames), int(lags.max())):
        logs = np.log(prior / len(stds)) + equations.log_likelihoods(course[lags], stds)
        yield _Entry(partial(course.take, lags), stds, logs, order=order, next_to=float(course[1]))


def _smooth_entries(equations: _Equations, frames: np.ndarray, whites: np.ndarray, std: float,
                    simulated: np.ndarray | None) -> list[_Entry]:
    """Independent noise beside a smooth error, which is as large in every reading, or a share of it."""
    s = (frames - frames[0]) / max(frames[-1] - frames[0], 1)
    shapes = [np.ones(len(s))]
    if simulated is not None and (rms := np.sqrt(np.mean(simulated**2))) > 0.0:
        shapes.append(np.abs(simulated) / rms)
    roots = [shape[:, None] * root for shape in shapes for root in _smooth_roots(s)]
    stds = std * SMOOTH_RATIOS
    prior = -np.log(len(roots) * len(whites) * len(stds))
    by_white = []
    for white in whites:
        factor = equations.factor(float(white))  # the same for all roots
        by_white.append([_Entry(partial(np.matmul, root, root.T), stds,
                                prior + equations.log_likelihoods_of_smooth(root, factor, stds), float(white))
                         for root in roots])
    return [entry for of_root in zip(*by_white, strict=True) for entry in of_root]


def _smooth_roots(s: np.ndarray) -> Iterator[np.ndarray]:
    """Roots (T, m) of correlations over the recording, s from 0 to 1: of knots, straight in between."""
    knots = np.linspace(0.0, 1.0, min(MAX_KNOTS, len(s)))
    width = knots[1] - knots[0]
    hats = np.maximum(0.0, 1.0 - np.abs(s[:, None] - knots) / width)
    distance = np.abs(knots[:, None] - knots)
    for length in SMOOTH_LENGTHS:
        yield hats @ np.linalg.cholesky(np.exp(-0.5 * (distance / length) ** 2) + JITTER * np.eye(len(knots)))
    for length in ROUGH_LENGTHS:
        yield hats @ np.linalg.cholesky(np.exp(-distance / length) + JITTER * np.eye(len(knots)))


def _independent(equations: _Equations, std: float, probability: float) -> ChannelNoise | None:
    """Independent readings of a size that is not known; None where the parameters leave too few of them free."""
    rows, n = equations.rows, len(equations.residual)
    information = rows.T @ np.linalg.solve(equations.local + std**2 * np.eye(n), rows)
    if n - float(np.trace(np.linalg.pinv(equations.M_other + information, hermitian=True) @ information)) < MIN_LEFT:
        return None
    stds = std * INDEPENDENT_RATIOS
    weights = _probabilities(equations.log_likelihoods(np.eye(n), stds))
    variance = float(weights @ stds**2)
    return ChannelNoise(float(np.sqrt(variance)), variance * np.eye(n), 0, 0.0, probability)


def _probabilities(logs: np.ndarray) -> np.ndarray:
    """Of the entries of a grid, by their log-likelihoods."""
    weights = np.exp(logs - logs.max())
    return weights / weights.sum()


def _autoregressions(n_frames: int, longest: int) -> Iterator[tuple[int, np.ndarray, float]]:
    """Order, correlation at every lag (longest + 1,) and prior probability of the candidates."""
    orders = (0, 1, 2) if n_frames >= MIN_FRAMES_OF_SECOND_ORDER else (0, 1)
    total = sum(PRIOR[order] for order in orders)
    yield 0, np.eye(1, longest + 1)[0], PRIOR[0] / total
    for first in FIRST_ORDER:
        yield 1, first ** np.arange(longest + 1.0), PRIOR[1] / total / len(FIRST_ORDER)
    if 2 in orders:
        pairs = [(first, partial) for first in SECOND_ORDER[0] for partial in SECOND_ORDER[1]]
        for first, partial in pairs:
            yield 2, _second_order(first, partial, longest), PRIOR[2] / total / len(pairs)


def _second_order(first: float, partial: float, longest: int) -> np.ndarray:
    """Correlation at every lag of the autoregression with these partial correlations  # (longest + 1,)"""
    course = np.ones(longest + 1)
    course[1] = first
    for lag in range(2, longest + 1):
        course[lag] = first * (1.0 - partial) * course[lag - 1] + partial * course[lag - 2]
    return course
