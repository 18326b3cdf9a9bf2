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
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

MIN_FRAMES = 8  # that a channel is compared in; fewer do not tell a correlation
MIN_LEFT = 4.0  # readings that the parameters leave free; fewer do not tell the size of independent noise
FIRST_ORDER = (0.15, 0.3, 0.45, 0.6, 0.7, 0.8, 0.9, 0.95)  # correlation of consecutive frames
SECOND_ORDER = (0.3, 0.6, 0.8, 0.9), (-0.6, -0.3, 0.3, 0.6)  # the same, and partial correlation at two frames
MIN_FRAMES_OF_SECOND_ORDER = 30
PRIOR = {0: 0.5, 1: 0.35, 2: 0.15}  # of the orders; of those that are tried
MAX_PROBABILITY_OF_INDEPENDENCE = 0.5
STD_RATIOS = np.geomspace(0.5, 8.0, 25)  # of the standard deviation that differences show, where none is stated
INDEPENDENT_RATIOS = np.geomspace(0.25, 32.0, 169)  # the same, of independent noise
MIN_LOCAL_VARIANCE_SHARE = 1e-6  # of the variance of a reading: of a channel that no frame is fitted to
BLOCK = 256  # frames whose correlation the likelihood counts; longer tests: block by block


@dataclass(frozen=True, eq=False)
class ChannelNoise:
    """The noise of one channel over its compared frames.

    std : of a reading; covariance : (T, T) of all readings; order : of the likeliest autoregression
    correlation : of two consecutive frames; independent : probability that the readings are independent
    """

    std: float
    covariance: np.ndarray
    order: int
    correlation: float
    independent: float

    @property
    def is_correlated(self) -> bool:
        return self.independent < MAX_PROBABILITY_OF_INDEPENDENCE


def channel_correlation(residual: np.ndarray, rows: np.ndarray, frames: Sequence[int], M_other: np.ndarray,
                        rhs: np.ndarray, std: float, is_stated: bool,
                        local_variance: np.ndarray | None = None) -> ChannelNoise | None:
    """Covariance of the noise of a channel; None where too few frames tell it.

    Parameters
    ----------
    residual : (T,) measured less simulated at the accepted point
    rows : (T, n) derivatives of the simulated values by the unknowns
    frames : numbers of the T frames; those that are left out count as time that passes
    M_other, rhs : (n, n), (n,) normal equations of everything but this channel
    std : of a reading; is_stated : whether it is given, else it is that of differences, and is estimated anew
    local_variance : (T,) of the simulated values by what each frame alone is fitted with (measured edges); None: none
    """
    local_variance = np.maximum(np.zeros(len(residual)) if local_variance is None else local_variance,
                                MIN_LOCAL_VARIANCE_SHARE * std**2)
    equations = _Equations(residual, rows, M_other, rhs, local_variance)
    noise = _over_autoregressions(equations, frames, std * (np.ones(1) if is_stated else STD_RATIOS))
    if is_stated or (noise is not None and noise.is_correlated):
        return noise
    return _independent(equations, std, 1.0 if noise is None else noise.independent)


@dataclass(frozen=True, eq=False)
class _Equations:
    """Of a channel, and of everything else, as in `channel_correlation`."""

    residual: np.ndarray
    rows: np.ndarray
    M_other: np.ndarray
    rhs: np.ndarray
    local_variance: np.ndarray

    def log_likelihoods(self, correlation: np.ndarray, stds: np.ndarray) -> np.ndarray:
        """Restricted log-likelihood of every standard deviation, up to a constant  # (len(stds),)

        Of B^(1/2) V (s^2 Lambda + 1) V^T B^(1/2), the covariance s^2 C + B of a block, the eigenvectors V serve all s.
        """
        n, columns, spread, log_det = len(self.rhs), [], [], 0.0
        for first in range(0, len(self.residual), BLOCK):
            block = slice(first, first + BLOCK)
            scale = 1.0 / np.sqrt(self.local_variance[block])
            values, vectors = np.linalg.eigh(correlation[block, block] * np.outer(scale, scale))
            columns.append(vectors.T @ (np.column_stack([self.rows[block], self.residual[block]]) * scale[:, None]))
            spread.append(values)
            log_det -= 2.0 * float(np.log(scale).sum())
        white, values = np.vstack(columns), np.concatenate(spread)
        logs = []
        for std in stds:
            variance = np.maximum(std**2 * values, 0.0) + 1.0
            weighed = white.T / variance
            M, b = self.M_other + weighed[:n] @ white[:, :n], self.rhs + weighed[:n] @ white[:, n]
            eigenvalues, vectors = np.linalg.eigh(0.5 * (M + M.T))
            # a direction that nothing determines is the same for all
            keep = eigenvalues > 1e-12 * eigenvalues.max(initial=1e-300)
            along = vectors[:, keep].T @ b
            logs.append(-0.5 * (log_det + np.log(variance).sum() + np.log(eigenvalues[keep]).sum()
                                + float(weighed[n] @ white[:, n]) - float(along**2 @ (1.0 / eigenvalues[keep]))))
        return np.array(logs)


def _over_autoregressions(equations: _Equations, frames: Sequence[int], stds: np.ndarray) -> ChannelNoise | None:
    """The mean over all autoregressions of the grid; None with too few frames."""
    n_frames = len(equations.residual)
    if n_frames < MIN_FRAMES:
        return None
    lags = np.abs(np.subtract.outer(np.asarray(frames), np.asarray(frames)))
    entries, logs = [], []
    for order, course, prior in _autoregressions(n_frames, int(lags.max())):
        entries.append((order, course))
        logs.append(np.log(prior) + equations.log_likelihoods(course[lags], stds))
    weights = _probabilities(np.array(logs))
    covariance = sum(float(row @ stds**2) * course[lags] for row, (_, course) in zip(weights, entries, strict=True))
    orders = np.array([order for order, _ in entries])
    per_order = [float(weights[orders == order].sum()) for order in sorted(set(orders.tolist()))]
    variance = float(covariance[0, 0])
    next_to = sum(float(row @ stds**2) * course[1] for row, (_, course) in zip(weights, entries, strict=True))
    return ChannelNoise(float(np.sqrt(variance)), covariance, int(np.argmax(per_order)), float(next_to / variance),
                        per_order[0])


def _independent(equations: _Equations, std: float, probability: float) -> ChannelNoise | None:
    """Independent readings of a size that is not known; None where the parameters leave too few of them free."""
    rows, n = equations.rows, len(equations.residual)
    information = (rows.T / (std**2 + equations.local_variance)) @ rows
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
