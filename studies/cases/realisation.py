"""One realisation of the noise of a test: of its images, its light, its force and its logged motion."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from idic.correlation import build_experiment_reference
from idic.images import ArrayStack, FieldNoise, LitStack, RoundedStack
from idic.model import Column, CorrelatedNoise, Experiment, FieldPoints, Noise
from idic_studies.subset_dic import subset_displacements, subset_grid
from idic.virtual_tests import recorded_by

RECORDS_STREAM, LIGHT_STREAM, EXPOSURE_STREAM = 1_000_001, 1_000_002, 1_000_003  # above every frame number: those seed
# the noise of the images


@dataclass(frozen=True)
class Disturbance:
    """Random effects of a realisation, in addition to the noise of its images.

    records : the logs of channels and driven boundaries get the noise that the experiment states for them
    gain, offset_gv : standard deviations of the gain and the offset of the light, in every frame but the reference
    exposure_gv : largest change of brightness, the same in all frames of a realisation; it varies the rounding error
    sensor : noise of the camera, see `idic.virtual_tests.sensors`
    stated : noise that the experiment states over the noise that there is
    channel_correlation : of the noise of a channel from frame to frame (first-order autoregression)
    subsets : half width and distance of the subsets of another DIC, px, whose displacements take the place of the
    images; () : images
    """

    records: bool = False
    gain: float = 0.0
    offset_gv: float = 0.0
    exposure_gv: float = 0.0
    sensor: str = "white"
    stated: float = 1.0
    channel_correlation: float = 0.0
    subsets: tuple[int, ...] = ()


def realisation(experiment: Experiment, noise_gv: float, disturbance: Disturbance, seed: int) -> Experiment:
    """The experiment with one realisation of its noise; the same `seed` gives the same records.

    noise_gv : standard deviation added to every image, the reference included
    """
    stack = experiment.recording.stack
    if disturbance.gain or disturbance.offset_gv:
        rng = np.random.default_rng((seed, LIGHT_STREAM))
        n = experiment.model.n_frames
        gains, offsets = 1.0 + disturbance.gain * rng.standard_normal(n), disturbance.offset_gv * rng.standard_normal(n)
        gains[experiment.model.reference], offsets[experiment.model.reference] = 1.0, 0.0
        stack = LitStack(stack, gains, offsets)
    if disturbance.exposure_gv:
        rng = np.random.default_rng((seed, EXPOSURE_STREAM))
        brighter = np.full(experiment.model.n_frames, disturbance.exposure_gv * rng.uniform(-1.0, 1.0))
        stack = LitStack(stack, np.ones(experiment.model.n_frames), brighter)
    if noise_gv:
        stack = recorded_by(disturbance.sensor, stack, noise_gv, seed)
        total = disturbance.stated * float(np.hypot(noise_gv, experiment.recording.noise.std_gv or 0.0))
        experiment = replace(experiment, recording=replace(experiment.recording, noise=Noise(total, "given")))
    experiment = replace(experiment, recording=replace(experiment.recording, stack=stack))
    if disturbance.subsets:
        experiment = as_measured_fields(experiment, *disturbance.subsets)
    return _with_noisy_records(experiment, seed, disturbance.channel_correlation) if disturbance.records else experiment


def as_measured_fields(experiment: Experiment, half: int, step: int) -> Experiment:
    """The experiment with the displacements that a subset DIC finds in its images, in the place of these.

    Subsets are 2 half + 1 px wide and `step` px apart. Their noise is estimated from the displacements.
    """
    model = experiment.model
    stack, pm = experiment.recording.stack, build_experiment_reference(experiment, model.camera).pixel_map
    specimen = pm.to_image(np.ones(pm.n_pixels), 0.0) > 0.0
    centres = subset_grid(specimen, half, step)
    frames = range(model.reference, model.n_frames)
    moved = np.zeros((model.n_frames, len(centres), 2))
    moved[frames.start:] = subset_displacements([stack.frame(k) for k in frames], centres,
                                                half)
    size = model.camera.pixel_size
    points = FieldPoints(centres.astype(float), stack.shape, size, 2.0 * half + 1.0)
    fields = ArrayStack((points.um_per_px * moved).astype(np.float32))
    estimate = FieldNoise.of(fields, points.positions_px / step, frames, model.reference)
    assert estimate is not None
    rows = tuple(tuple(row) for row in estimate.correlation.tolist())
    noise = Noise(estimate.std, "stage_differences",
                  correlated=CorrelatedNoise(estimate.std, estimate.sum_std, rows, estimate.std))
    options = replace(experiment.options, brightness="none", lowpass_px=0.0, edge_margin_px=0, border_px=0,
                      estimator="auto")
    return replace(experiment, recording=replace(experiment.recording, stack=fields, points=points,
                                                 quantity="displacement", noise=noise), options=options)


def quantised(experiment: Experiment, bits: int) -> Experiment:
    """The experiment with images of 256 grey values quantised to `bits`; its stated noise includes the rounding."""
    stack = RoundedStack(experiment.recording.stack, bits)
    total = float(np.hypot(stack.step / np.sqrt(12.0), experiment.recording.noise.std_gv or 0.0))
    return replace(experiment, recording=replace(experiment.recording, stack=stack, noise=Noise(total, "given")))


def _with_noisy_records(experiment: Experiment, seed: int, correlation: float) -> Experiment:
    model = experiment.model
    rng = np.random.default_rng((seed, RECORDS_STREAM))
    channels = tuple(replace(channel, values=channel.values + (channel.noise_std or 0.0) * autoregression(
        rng.standard_normal(len(channel.values)), correlation)) for channel in model.channels)
    prescribed = []
    for entry in model.prescribed:
        if isinstance(entry.drive, Column) and entry.drive.noise_std:
            noise = entry.drive.noise_std * rng.standard_normal(len(entry.drive.values))
            noise[model.reference] = 0.0  # motions are relative to the reference
            entry = replace(entry, drive=replace(entry.drive, values=entry.drive.values + noise))
        prescribed.append(entry)
    return replace(experiment, model=replace(model, channels=channels, prescribed=tuple(prescribed)))


def autoregression(white: np.ndarray, correlation: float) -> np.ndarray:
    """First-order autoregression of unit variance from independent numbers  # (n,)"""
    if not correlation:
        return white
    series = white.copy()
    for k in range(1, len(series)):
        series[k] = correlation * series[k - 1] + np.sqrt(1.0 - correlation**2) * white[k]
    return series
