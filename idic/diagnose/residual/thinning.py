"""Two independent copies of the same recording: one to fit a model to, one to judge the fit on.

Which models are worth a fit the scores of the recording itself tell (`idic.diagnose.selection.moves.screening`); what
noise brings through both is in `idic.diagnose.selection.rival.Rival.min_heldout_drop`.

With noise of known variance in y and e ~ N(0, sigma^2) drawn anew,

    y1 = y + e,    y2 = y - e,    cov(noise of y1, noise of y2) = sigma^2 - sigma^2 = 0

so that both show the same signal under independent noise of standard deviation sqrt(2) sigma; every pixel, frame and
channel is in both. Exact for normal noise of known variance (Leiner et al. 2025, doi 10.1080/01621459.2023.2270748;
Neufeld et al. 2024, arXiv:2301.07276).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from idic.identification import logged_noise
from idic.images import StackView, coloured
from idic.model import Channel, Experiment, FieldPoints, FurtherCamera, Noise

CHOICE, JUDGEMENT = 1, -1  # signs of e
COPY_VARIANCE_FACTOR = 2.0  # variance of a copy's noise over the recording's


def drop_on_copy(drop: float, n_unknowns: int) -> float:
    """Expected drop of chi-square where a copy is fitted, of that on the whole recording: noise gives one per unknown
    everywhere, and the rest is the signal's."""
    return n_unknowns + (drop - n_unknowns) / COPY_VARIANCE_FACTOR


@dataclass(frozen=True, eq=False)
class ThinnedStack(StackView):
    """A stack with noise added on reading; the same numbers in every process.

    noise : of the recording, whose standard deviation and correlation the added noise has; sign : +1 or -1; seed,
    camera : what the noise of frame k is drawn from
    """

    noise: Noise
    sign: int
    seed: int
    camera: int = 0
    points: FieldPoints | None = None

    def frame(self, k: int) -> np.ndarray:
        """Frame `k` with its share of noise  # (ny, nx) float32, of a measured field (n_points, c)"""
        rng = np.random.default_rng([self.seed, self.camera, k])
        if self.points is None:
            noise = self._drawn(rng, self.shape)
        else:  # of its grid, where the points are
            column, row = np.rint(self.points.positions_px).astype(int).T
            drawn = [self._drawn(rng, self.points.shape)[row, column] for _ in range(self.points.n_components)]
            noise = np.column_stack(drawn)
            if self.points.depth is not None:
                noise[:, 2] /= self.points.depth.weight
        recorded = self.stack.frame(k)
        if self.points is not None:
            recorded = recorded[:, :self.points.n_components]  # a RUN may hold more than is compared
        return recorded.astype(np.float32) + np.float32(self.sign * self.noise.recorded_gv) * noise

    def _drawn(self, rng: np.random.Generator, shape: tuple[int, int]) -> np.ndarray:
        noise = rng.standard_normal(shape, dtype=np.float32)
        correlated = self.noise.correlated
        return noise if correlated is None else coloured(noise, np.array(correlated.correlation))


def thinned(experiment: Experiment, sign: int, seed: int) -> Experiment:
    """One of the two copies of a recording, its noise figures raised by sqrt(2).

    Parameters
    ----------
    sign : `CHOICE` or `JUDGEMENT`
    """
    recording = experiment.recording
    cameras = tuple(_thinned_camera(camera, sign, seed, number)
                    for number, camera in enumerate(experiment.cameras, start=1))
    channels = tuple(_thinned_channel(channel, logged_noise(experiment.model, channel), sign, seed, number)
                     for number, channel in enumerate(experiment.model.channels))
    return replace(experiment, recording=replace(recording, stack=ThinnedStack(recording.stack, recording.noise, sign,
                                                                               seed, points=recording.points),
                                                 noise=_noisier(recording.noise)),
                   model=replace(experiment.model, channels=channels), cameras=cameras)


def _noisier(noise: Noise) -> Noise:
    twice, correlated = float(np.sqrt(COPY_VARIANCE_FACTOR)), noise.correlated
    if correlated is not None:
        correlated = replace(correlated, recorded_gv=twice * correlated.recorded_gv,
                             sum_std_gv=twice * correlated.sum_std_gv)
    return replace(noise, std_gv=twice * noise.std_gv, correlated=correlated)


def _thinned_camera(camera: FurtherCamera, sign: int, seed: int, number: int) -> FurtherCamera:
    return replace(camera, stack=ThinnedStack(camera.stack, camera.noise, sign, seed, number),
                   noise=_noisier(camera.noise))


def _thinned_channel(channel: Channel, std: float, sign: int, seed: int, number: int) -> Channel:
    noise = np.random.default_rng([seed, 1_000_000 + number]).standard_normal(len(channel.values))
    return replace(channel, values=channel.values + sign * std * noise, noise_std=float(np.sqrt(2.0) * std))
