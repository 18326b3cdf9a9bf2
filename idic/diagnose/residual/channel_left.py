"""What a model leaves in the channels: they are judged like motions.

The residual of a reading, over the noise that frame-local unknowns leave in it
(`idic.diagnose.residual.heldout.readings`), is unit normal for a complete model; the sum of its squares over the frames
is chi-square distributed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import stats

from idic.diagnose.residual.heldout import readings
from idic.diagnose.residual.residual_evidence import ResidualEvidence

MIN_CHANNEL_Z = 5.0  # standard deviations of a channel's excess that count as something
MAX_CHANNEL_EXCESS_LEFT = 0.1  # of the excess before: a formal fit, not the cause
MIN_EXPLAINED_SHARE = 0.7  # of the excess of a channel: a cause that explains less is not the one of its readings
MIN_READING_SHARE = 1e-3  # of the largest reading, rms: below, simulations of one law on two meshes differ as much


@dataclass(frozen=True, eq=False)
class ChannelLeft:
    """Residual of one channel before and after an addition to the model.

    column : name in the log; before, after : (T,) in standard deviations; noise_share : standard deviation of a reading
    over the largest reading; is_load : whether it reads a force or a pressure, no motion
    """

    column: str
    before: np.ndarray
    after: np.ndarray
    noise_share: float
    is_load: bool = True

    @property
    def z(self) -> float:
        """Excess that is left, in standard deviations of its noise."""
        return excess(self.after) / float(np.sqrt(2.0 * max(len(self.after), 1)))

    @property
    def is_significant(self) -> bool:
        """Whether noise alone leaves as much less often than 5 standard deviations of a normal variable."""
        return _beyond_noise(self.after)

    @property
    def was_off(self) -> bool:
        """The same before the addition, and by more than discretisation."""
        return _beyond_noise(self.before) and self.was_beyond_discretisation

    @property
    def was_beyond_discretisation(self) -> bool:
        """Whether before the addition the residual, beyond noise, is larger than two meshes of one law differ by."""
        rms = self.noise_share * float(np.sqrt(max(excess(self.before), 0.0) / max(len(self.before), 1)))
        return rms > MIN_READING_SHARE

    @property
    def share(self) -> float:
        """Residual excess over the excess before, above 1 where the model has become worse in this channel."""
        return max(excess(self.after), 0.0) / max(excess(self.before), 1e-300)

    @property
    def reading_share(self) -> float:
        """Rms of the residual beyond noise, over the largest reading."""
        return self.noise_share * float(np.sqrt(max(excess(self.after), 0.0) / max(len(self.after), 1)))

    @property
    def is_left(self) -> bool:
        """Whether a part is left that is significant and larger than discretisation."""
        return self.is_significant and self.reading_share > MIN_READING_SHARE

    @property
    def matters(self) -> bool:
        """Whether that part is a good share of the excess before, too."""
        return self.is_left and self.share > MAX_CHANNEL_EXCESS_LEFT


def _beyond_noise(z: np.ndarray) -> bool:
    return bool(stats.chi2.logsf((z**2).sum(), len(z)) < stats.norm.logsf(MIN_CHANNEL_Z))


def explains_a_channel(first: np.ndarray, base: np.ndarray, enriched: np.ndarray) -> bool:
    """Whether a channel is explained for the most part of which more than noise and a good share was left.

    first, base, enriched : (T, n_channels) in standard deviations, without any cause, and without and with the one in
    question
    """
    return any(_beyond_noise(earlier) and excess(earlier) > MAX_CHANNEL_EXCESS_LEFT * excess(start)
               and excess(later) < (1.0 - MIN_EXPLAINED_SHARE) * excess(earlier)
               for start, earlier, later in zip(first.T, base.T, enriched.T, strict=True))


def smallest_reading(residual: ResidualEvidence) -> float:
    """Effect on the readings, in standard deviations, that simulations of one law on two meshes may differ by; infinite
    without a channel.

    Of the channel in which that is the smallest.
    """
    sizes = [float(np.abs(channel.values).max()) for channel in residual.context.experiment.model.channels]
    noise = np.asarray(residual.context.weights.channel_noise, dtype=float)
    return float(np.min(MIN_READING_SHARE * np.array(sizes) / noise)) if sizes else np.inf


def excess(z: np.ndarray) -> float:
    """Sum of squares beyond its expectation under noise."""
    return float((z**2).sum() - len(z))


def channels_left(base: ResidualEvidence, enriched: ResidualEvidence | None) -> tuple[ChannelLeft, ...]:
    """Every channel of the recording.

    enriched : of the enriched model; None: nothing was added
    """
    experiment = base.context.experiment
    residuals = [readings(residual.evidence) for residual in (base, base if enriched is None else enriched)]
    noise = base.context.weights.channel_noise
    return tuple(ChannelLeft(channel.column, residuals[0][:, k], residuals[1][:, k],
                             float(noise[k]) / max(float(np.abs(channel.values).max()), 1e-300), channel.is_load)
                 for k, channel in enumerate(experiment.model.channels))
