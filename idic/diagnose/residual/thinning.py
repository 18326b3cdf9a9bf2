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
from numba import njit

from idic.identification import logged_noise
from idic.images import StackView, VolumeStack, coloured
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


@dataclass(frozen=True, eq=False)
class ThinnedVolumes:
    """Volumes with noise added on reading; the same numbers in every process.

    A number of every voxel decides its noise, so that a block is the same wherever it is cut. It is independent from
    voxel to voxel and as large as scatters sums against the gradient like that of the scans, which may be correlated
    (`idic.images.quality.volume_noise`): fits are made of those sums.

    std_gv : of the added noise; sign : +1 or -1; seed : what the noise is drawn from, together with scan and voxel
    """

    volumes: VolumeStack
    std_gv: float
    sign: int
    seed: int

    @property
    def n_frames(self) -> int:
        return self.volumes.n_frames

    @property
    def shape(self) -> tuple[int, int, int]:
        return self.volumes.shape

    def block(self, k: int, z: slice, y: slice, x: slice) -> np.ndarray:
        """A block of scan `k` with its share of noise  # (slices, rows, columns) float32"""
        block = np.array(self.volumes.block(k, z, y, x), dtype=np.float32)
        first = [part.indices(n)[0] for part, n in zip((z, y, x), self.shape, strict=True)]
        _, ny, nx = self.shape
        key = np.random.SeedSequence([self.seed, k]).generate_state(1, np.uint64)[0]
        _add_noise(block, np.array(first, dtype=np.int64), ny, nx, key, np.float32(self.sign * self.std_gv))
        return block


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
    if recording.quantity == "volume":
        stack = ThinnedVolumes(recording.volumes, recording.noise.in_sums_gv, sign, seed)
    else:
        stack = ThinnedStack(recording.stack, recording.noise, sign, seed, points=recording.points)
    return replace(experiment, recording=replace(recording, stack=stack, noise=_noisier(recording.noise)),
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


@njit(cache=True, nogil=True)
def _add_noise(block, first, ny, nx, key, std):
    """Normal noise by Box and Muller from the mixed number of a voxel  # block (nz, ny, nx) float32, in place"""
    for i in range(block.shape[0]):
        for j in range(block.shape[1]):
            start = ((first[0] + i) * ny + first[1] + j) * nx + first[2]
            for m in range(block.shape[2]):
                bits = _mixed(key + np.uint64(start + m) * np.uint64(0x9E3779B97F4A7C15))
                radius = np.sqrt(-2.0 * np.log((float(bits >> np.uint64(32)) + 1.0) * 2.0**-32))
                angle = 2.0 * np.pi * float(bits & np.uint64(0xFFFFFFFF)) * 2.0**-32
                block[i, j, m] += std * np.float32(radius * np.cos(angle))


@njit(cache=True, nogil=True)
def _mixed(number):
    """All bits of a number depend on all of it (SplitMix64; Steele, Lea & Flood 2014, doi:10.1145/2714064.2660195)."""
    number = (number ^ (number >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    number = (number ^ (number >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return number ^ (number >> np.uint64(31))
