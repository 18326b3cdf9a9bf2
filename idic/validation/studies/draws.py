"""One draw of everything noisy in a test: images, light, force, logged motion; and what a run measures first."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from idic.dic import dic_stack
from idic.dic.boundary import boundary_start, with_boundary_start
from idic.identify.coarse import coarse_fit
from idic.identify.search import search
from idic.identify.step.schedule import wants_search
from idic.images.stack_views import LitStack, NoisyStack, RoundedStack
from idic.model.experiment import Column, Experiment, Measured, Noise
from idic.run.prepare import measured_start, starts_from_dic

OF_RECORDS, OF_LIGHT, OF_EXPOSURE = 1_000_001, 1_000_002, 1_000_003  # beside the numbers of frames, which seed the noise


@dataclass(frozen=True)
class Disturbance:
    """What varies from draw to draw beside the noise of the images.

    records : the logs of channels and driven boundaries get the noise that the experiment states of them;
    gain, offset_gv : standard deviation of the light's gain and offset in every frame but the reference;
    exposure_gv : all frames are brighter or darker by one amount up to this, so that they are rounded in another way.
    """

    records: bool = False
    gain: float = 0.0
    offset_gv: float = 0.0
    exposure_gv: float = 0.0


def drawn(experiment: Experiment, noise_gv: float, disturbance: Disturbance, seed: int) -> Experiment:
    """The experiment as it was recorded this time; the same `seed` gives the same records.

    noise_gv : standard deviation added to every image, the reference included
    """
    stack = experiment.stack
    if disturbance.gain or disturbance.offset_gv:
        rng = np.random.default_rng((seed, OF_LIGHT))
        n = experiment.n_frames
        gains, offsets = 1.0 + disturbance.gain * rng.standard_normal(n), disturbance.offset_gv * rng.standard_normal(n)
        gains[experiment.reference], offsets[experiment.reference] = 1.0, 0.0
        stack = LitStack(stack, gains, offsets)
    if disturbance.exposure_gv:
        rng = np.random.default_rng((seed, OF_EXPOSURE))
        brighter = np.full(experiment.n_frames, disturbance.exposure_gv * rng.uniform(-1.0, 1.0))
        stack = LitStack(stack, np.ones(experiment.n_frames), brighter)
    if noise_gv:
        stack = NoisyStack(stack, noise_gv, seed)
        total = float(np.hypot(noise_gv, experiment.noise.std_gv or 0.0))
        experiment = replace(experiment, noise=Noise(total, "given"))
    experiment = replace(experiment, stack=stack)
    return _with_noisy_records(experiment, seed) if disturbance.records else experiment


def rounded(experiment: Experiment, bits: int) -> Experiment:
    """The experiment with images of 256 grey values rounded to `bits`, and that noise added to what is stated."""
    stack = RoundedStack(experiment.stack, bits)
    total = float(np.hypot(stack.step / np.sqrt(12.0), experiment.noise.std_gv or 0.0))
    return replace(experiment, stack=stack, noise=Noise(total, "given"))


def _with_noisy_records(experiment: Experiment, seed: int) -> Experiment:
    rng = np.random.default_rng((seed, OF_RECORDS))
    channels = tuple(replace(channel, values=channel.values + (channel.noise_std or 0.0) * rng.standard_normal(
        len(channel.values))) for channel in experiment.channels)
    prescribed = []
    for entry in experiment.prescribed:
        if isinstance(entry.drive, Column) and entry.drive.noise_std:
            noise = entry.drive.noise_std * rng.standard_normal(len(entry.drive.values))
            noise[experiment.reference] = 0.0  # a motion is counted from the reference
            entry = replace(entry, drive=replace(entry.drive, values=entry.drive.values + noise))
        prescribed.append(entry)
    return replace(experiment, channels=channels, prescribed=tuple(prescribed))


def with_found_start(experiment: Experiment) -> tuple[Experiment, bool]:
    """The experiment with the start that a run would have looked for, and whether that is another one."""
    if not wants_search(experiment):
        return experiment, False
    u_px = dic_stack(experiment).u_px if experiment.quantity == "grey" else None
    bare = replace(experiment, stack=None)
    found = search(experiment, lambda trials: [coarse_fit(bare, u_px, t.values, t.evaluations, t.simplified)
                                             for t in trials])
    return replace(experiment, parameters=experiment.parameters.with_values(found.values)), found.moved


def with_measured_start(experiment: Experiment) -> tuple[Experiment, np.ndarray | None]:
    """Start values of measured and of virtual boundaries from a free FE-DIC, as a run prepares them.

    Returns
    -------
    experiment : with start values and modes of virtual boundaries
    local : (n_frames, m) mm, frame-local unknowns; None where nothing is to be measured
    """
    measured = any(isinstance(entry.drive, Measured) for entry in experiment.prescribed)
    if not measured and not starts_from_dic(experiment):
        return experiment, None
    u_px = dic_stack(experiment).u_px
    local = measured_start(experiment, u_px, experiment.excluded)
    return with_boundary_start(experiment, boundary_start(experiment, u_px, experiment.excluded)), local
