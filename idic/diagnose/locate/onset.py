"""When it begins: growing windows of frames, and a hinge whose corner has an interval.

Free motions on a coarse grid make a short record of every frame, e_t = J_t theta + noise, with unit noise, common part
of the reference image included: cov(e_t, e_s) = kappa_t [t = s] + 1/N for images, [t = s] for channels. On it the
identified parameters are refitted to the frames 1 ... t alone, again and again: chi-square rises by an expected rank
with each frame as long as the model holds, and what comes later cannot disturb what was before.

The corner: in the frames up to just after the first alarm, e_t = J_t theta + phi alpha max(t - t0, 0)^k, profiled
over t0 and k with theta refitted; the interval is where log-likelihood is less than 1.92 below its best. What is there
from the start may also follow what the test itself did: load, its square, time, load summed over time. Where one of
these does as well as any corner, the record asks for no corner.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from idic.diagnose.locate.nested_tests import half_inverse
from idic.diagnose.locate.noise_draws import FreeMotion, recorded_frames
from idic.diagnose.residual.evidence import Evidence, noise_share
from idic.diagnose.residual.excess import p_beyond_margin, power
from idic.diagnose.residual.margin import PRACTICAL_MARGIN_PX
from idic.diagnose.residual.score import NullModel, symmetric_inverse

MAX_DEPARTURE_P = 1e-3  # family-wise over frames, of the first departure
MIN_CORNER_FRAMES = 4  # frames in which a corner is tried
CORNER_STEP_FRAMES = 0.25  # frames between trial corners
GROWTH_EXPONENTS = (1.0, 1.5, 2.0, 3.0)  # of the growth after the corner
MAX_LIKELIHOOD_DROP = 1.92  # of log-likelihood: 95 %


@dataclass(frozen=True, eq=False)
class MotionRecord:
    """The short record of all frames.

    e : (T, p) with unit noise; J : (T, p, n) of the identified parameters; shared : (p,) bool, noise common to all
    frames (images) or not (channels); kappa : (T,); power : (T,) chi-square of a motion of 1 px; n_images : averaged to
    the reference; precision, pull : (n, n), (n,) what the priors of the parameters add, nothing by default
    """

    e: np.ndarray
    J: np.ndarray
    shared: np.ndarray
    kappa: np.ndarray
    power: np.ndarray
    n_images: int = 1
    precision: np.ndarray | None = None
    pull: np.ndarray | None = None

    @property
    def n_stated(self) -> int:
        """Directions that priors determine."""
        return 0 if self.precision is None else round(np.trace(symmetric_inverse(self.precision) @ self.precision))

    def data_alone(self) -> MotionRecord:
        """Without priors."""
        return replace(self, precision=None, pull=None)

    def white(self, columns: np.ndarray, frames: np.ndarray) -> np.ndarray:
        """V^-1/2 for some frames on their own  # (n, p, m) of these frames -> the same"""
        kappa = self.kappa[frames]
        scaled = columns / np.where(self.shared, np.sqrt(kappa)[:, None], 1.0)[:, :, None]
        common = noise_share(kappa, self.n_images) * np.einsum("tpm,t->pm", columns, 1.0 / kappa)
        return scaled - np.where(self.shared, 1.0 / np.sqrt(kappa)[:, None], 0.0)[:, :, None] * common

    def fit(self, frames: np.ndarray, extra: np.ndarray | None = None) -> tuple[np.ndarray, float, int]:
        """Least squares on some frames and the priors: coefficients (n + m,), chi-square left, rank

        extra : (len(frames), p, m) further columns
        """
        columns = self.J[frames] if extra is None else np.concatenate([self.J[frames], extra], axis=2)
        J, e = self.white(columns, frames), self.white(self.e[frames][:, :, None], frames)
        J, e = J.reshape(-1, J.shape[2]), e.ravel()
        gram, b, chi2 = J.T @ J, J.T @ e, float(e @ e)
        if self.precision is not None and self.pull is not None:
            n = len(self.pull)
            gram[:n, :n] += self.precision
            b[:n] += self.pull
            chi2 += float(self.pull @ symmetric_inverse(self.precision) @ self.pull)
        inverse = symmetric_inverse(gram)
        x = inverse @ b
        return x, chi2 - float(b @ x), round(np.trace(inverse @ gram))


@dataclass(frozen=True, eq=False)
class Onset:
    """When the mismatch begins.

    frame : first frame that shows it, as a (fractional) place in the evidence counted from 0 = reference; 0: present
    from the start; nan: never; interval : (low, high); p_value : of the departure over all growing windows;
    innovation, rank : (T,) rise of chi-square with each frame; amplitude, std : (T,) of the departure's
    pattern, px (rms over the specimen); alarm : place of the first alarm, nan without one; from_start : whether the
    record does without a corner
    """

    frame: float
    interval: tuple[float, float]
    p_value: float
    innovation: np.ndarray
    rank: np.ndarray
    amplitude: np.ndarray
    std: np.ndarray
    pattern: np.ndarray
    alarm: float = np.nan
    from_start: bool = False


def course(evidence: Evidence, null: NullModel, motion: FreeMotion) -> MotionRecord:
    """The short record: free motions weighed by their mean information, and the channels."""
    total = sum((equations.matrix for equations in motion.white), start=np.zeros_like(motion.white[0].matrix))
    mean = total / len(motion.white)
    root = half_inverse(mean)  # (p, r), root root^T = mean^-1
    forth = mean @ root  # unit noise: root^T mean a
    e, J = [], []
    for equations in motion.white:
        inverse = half_inverse(equations.matrix)
        estimate = inverse @ (inverse.T @ np.column_stack([equations.rhs, equations.cross]))
        motions = forth.T @ estimate
        e.append(motions[:, 0])
        J.append(motions[:, 1:])
    e, J = np.array(e), np.array(J)
    columns = np.concatenate([e[:, :, None], J], axis=2)  # (T, r, 1 + n)
    columns = np.moveaxis(recorded_frames(evidence, np.moveaxis(columns, 2, 0)), 0, 2)
    weight = np.sqrt(evidence.channel_weight)
    channels = np.array([part.channel_q for part in evidence.parts]) / np.where(weight > 0.0, weight, np.inf)
    slopes = null.white.channels * weight[None, :, None]
    return MotionRecord(np.hstack([columns[:, :, 0], channels]), np.concatenate([columns[:, :, 1:], slopes], axis=1),
                        np.arange(columns.shape[1] + len(weight)) < columns.shape[1], evidence.kappa,
                        power(evidence), evidence.n_images, null.precision, null.pull)


def onset(record: MotionRecord, margin_px: float = PRACTICAL_MARGIN_PX, followed: Sequence[np.ndarray] = ()) -> Onset:
    """Find the first departure beyond noise and a motion of `margin_px`, its pattern, and the corner of its growth.

    followed : courses (T,) that something present from the start may follow (`load_histories`)
    """
    margin = margin_px**2 * record.power
    n_frames = len(record.e)
    fits = [record.fit(np.arange(t + 1)) for t in range(n_frames)]
    chi2, rank = np.array([f[1] for f in fits]), np.array([f[2] for f in fits])
    dof = record.e.shape[1] * np.arange(1, n_frames + 1) + record.n_stated - rank
    innovation, innovation_rank = np.diff(chi2, prepend=0.0), np.maximum(np.diff(dof, prepend=0), 1)
    single = p_beyond_margin(innovation, innovation_rank, margin)
    windowed = p_beyond_margin(chi2, np.maximum(dof, 1), np.cumsum(margin))
    p_value = min(1.0, 2 * n_frames * min(single.min(), windowed.min()))
    if p_value > MAX_DEPARTURE_P:
        nothing = np.zeros(n_frames)
        return Onset(np.nan, (np.nan, np.nan), p_value, innovation, innovation_rank, nothing, nothing + 1.0,
                     np.zeros(record.e.shape[1]))
    alarms = np.minimum(single, windowed) * 2 * n_frames < MAX_DEPARTURE_P
    first = int(np.flatnonzero(alarms)[0])
    stop = min(max(first + 1, MIN_CORNER_FRAMES - 1), n_frames - 1)
    pattern = _pattern(record, first, stop)
    frame, interval, from_start = _corner(record, stop, pattern, followed)
    amplitude, std = _amplitude(record, pattern, max(int(frame) - 1, 0))
    return Onset(frame, interval, p_value, innovation, innovation_rank, amplitude, std, pattern, first + 1.0,
                 from_start)


def load_histories(times: np.ndarray, load: np.ndarray | None) -> tuple[np.ndarray, ...]:
    """What something that is there from the start may grow with; times : (T,) s from the reference, load : (T,)"""
    if load is None:
        return (times,)
    summed = np.cumsum(load * np.diff(times, prepend=0.0))
    return times, load, load**2, summed, load * times


def _pattern(record: MotionRecord, first: int, stop: int) -> np.ndarray:
    """Direction of the departure of the frames first … stop from the prediction by earlier frames  # (p,)"""
    earlier = np.arange(first if first >= 2 else stop + 1)
    x = record.fit(earlier)[0]
    departure = record.e[first:stop + 1] - record.J[first:stop + 1] @ x
    return np.linalg.svd(departure, full_matrices=False)[2][0]


def _corner(record: MotionRecord, stop: int, pattern: np.ndarray,
            followed: Sequence[np.ndarray]) -> tuple[float, tuple[float, float], bool]:
    """Profile over the corner and the power of the growth; a misfit of every power widens the interval.

    Returns
    -------
    corner, its interval, whether the record does without a corner
    """
    frames = np.arange(stop + 1)
    numbers = frames + 1.0  # the reference is 0
    trials = np.arange(0.0, stop + 1.0, CORNER_STEP_FRAMES)
    losses = np.empty((len(trials), len(GROWTH_EXPONENTS)))
    for i, start in enumerate(trials):
        x = np.maximum(numbers - start, 0.0) / (numbers[-1] - start)
        for k, exponent in enumerate(GROWTH_EXPONENTS):
            _, losses[i, k], rank = record.fit(frames, pattern[None, :, None] * (x**exponent)[:, None, None])
    losses = losses.min(axis=1)
    straight = losses[0]
    for history in followed:
        x = history[frames] / max(np.abs(history[frames]).max(), 1e-300)
        straight = min(straight, record.fit(frames, pattern[None, :, None] * x[:, None, None])[1])
    least = 2.0 * MAX_LIKELIHOOD_DROP * max(1.0, losses.min() / max(record.e[frames].size + record.n_stated - rank, 1))
    inside = trials[losses - losses.min() < least]
    return float(trials[np.argmin(losses)]), (float(inside.min()), float(inside.max())), bool(
        straight - losses.min() < least)


def _amplitude(record: MotionRecord, pattern: np.ndarray, n_earlier: int) -> tuple[np.ndarray, np.ndarray]:
    """Amplitude of a pattern in every frame; parameters are fitted to the frames before it shows (all, if none)."""
    n_frames = len(record.e)
    frames = np.arange(n_earlier) if n_earlier >= 2 else np.arange(n_frames)
    x = record.fit(frames)[0]
    value = (record.e - record.J @ x) @ pattern
    px = 1.0 / np.sqrt(np.maximum(record.power, 1e-300))
    return value * px, np.sqrt(record.kappa + (pattern[record.shared] ** 2).sum() / record.n_images) * px


def growing_windows(record: MotionRecord) -> tuple[np.ndarray, np.ndarray]:
    """Step of the identified parameters asked for by the frames 1 ... t alone, and its standard deviation  # (T, n)

    NaN where these frames do not fix a parameter. Their course is flat under a model that holds.
    """
    n_frames, n = len(record.e), record.J.shape[2]
    steps, stds = np.full((n_frames, n), np.nan), np.full((n_frames, n), np.nan)
    prior = 0.0 if record.precision is None else record.precision
    for t in range(n_frames):
        frames = np.arange(t + 1)
        J = record.white(record.J[frames], frames).reshape(-1, n)
        gram = J.T @ J + prior
        size = np.sqrt(np.maximum(np.diagonal(gram), 1e-300))
        if np.linalg.matrix_rank(gram / np.outer(size, size), tol=1e-12, hermitian=True) == n:
            steps[t] = record.fit(frames)[0]
            stds[t] = np.sqrt(np.diagonal(symmetric_inverse(gram)))
    return steps, stds


def parameter_cusum(record: MotionRecord) -> tuple[np.ndarray, np.ndarray]:
    """Whether the identified parameters are constant: their scores summed up frame by frame.

    Under the model each sum, over its final standard deviation and at its share of information, is a Brownian bridge
    (Hansen 1992; Zeileis & Hornik 2007).

    Returns
    -------
    paths (T, n) in standard deviations, p_values (n,) of their largest excursion; no library of causes is needed
    """
    frames, record = np.arange(len(record.e)), record.data_alone()
    x = record.fit(frames)[0]
    J = record.white(record.J, frames)
    residual = record.white((record.e - record.J @ x)[:, :, None], frames)[:, :, 0]
    scores = np.einsum("tpn,tp->tn", J, residual)
    size = np.sqrt(np.einsum("tpn,tpn->n", J, J))
    paths = np.cumsum(np.divide(scores, size, out=np.zeros_like(scores), where=size > 0.0), axis=0)
    return paths, stats.kstwobign.sf(np.abs(paths).max(axis=0, initial=0.0))
