"""Force drift: a warming load cell, a slow amplifier; from the start, or from a later moment on."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from idic.model.records.experiment import Experiment
from idic.model.records.model import Model
from idic.model.records.parts import Channel, Prescribed
from idic.model.terms.channels.channel_term import ChannelTerm, Course, Probe, Reading, Step, logged_size
from idic.parameters import Parameter, PlausibleSize

PROBE_FORCE_SHARE = 0.05  # of the largest force, over the test
ONSETS = (0.2, 0.35, 0.5, 0.65, 0.8)  # of the test, of a drift that begins late


def parameters(channel: Channel, times: np.ndarray | None, prescribed: Sequence[Prescribed]) -> list[Parameter]:
    size, steady = 0.1 * logged_size(channel), []
    if times is not None and len(times) > 1:
        duration = float(times[-1] - channel.starts.get("drift", times[0]))
        steady.append(Parameter(channel.dof("drift"), 0.0, f"{channel.unit}/s", scale=size / duration))
    return steady + [Parameter(channel.dof(name), 0.0, channel.unit, True, scale=size)
                   for name in channel.hats_of("drift")]


def step(reading: float, at: Reading) -> Step:
    """r -> r + drift (t - t_0), or a course that the data give; t_0 : the reference frame, or `drift_from_s`"""
    seconds = drifting(at.experiment.model, at.channel, at.frame)
    knots = {name: float(hat[at.frame]) for name, hat in at.channel.hats_of("drift").items()}
    drifted = at.value("drift") * seconds
    return Step(reading + drifted + sum(at.value(name) * by for name, by in knots.items()), {"drift": seconds} | knots)


def drifting(model: Model, channel: Channel, frame: int) -> float:
    """Seconds for which the reading of a channel has drifted."""
    seconds = float(model.times[frame] - channel.starts.get("drift", model.times[model.reference]))
    return max(seconds, 0.0) if "drift" in channel.starts else seconds


def probes(experiment: Experiment, channel: Channel) -> list[Probe]:
    model = experiment.model
    if not model.has_times:
        return []
    size, first = PROBE_FORCE_SHARE * float(np.abs(channel.values).max()), model.times[model.reference]
    duration = float(model.times[-1] - first)
    drifts = [Probe(f"drift of {channel.column}", "drift", size / duration)]
    for onset in ONSETS:
        start = float(np.round(first + onset * duration, 9))
        drifts.append(Probe(f"drift of {channel.column} from {start:.4g} s on", "drift",
                          size / ((1.0 - onset) * duration), keys={"drift_from_s": start}))
    return drifts


def amplitude(experiment: Experiment, channel: Channel, name: str) -> np.ndarray | None:
    if name == "drift":
        return np.array([drifting(experiment.model, channel, frame) for frame in range(experiment.model.n_frames)])
    return channel.hats_of("drift").get(name)


FORCE_DRIFT = ChannelTerm(
    "force_drift", "force drift", "a force reading that drifts with time, from the start or later", "a drift of zero",
    ("drift",), parameters, step, probes,
    rivals={"force_offset": "both are present at zero load: one is constant, one grows",
            "viscoelasticity": "both let the force go down while the motion is held",
            "creep": "both let the force go down while the motion is held",
            "thermal_expansion": "a temperature that rises with time strains a held specimen"},
    size=PlausibleSize(0.1, "0.5 % of the largest force over the test",
                       "an estimate: warming of a load cell and its amplifier"),
    separating_tests=("record the force at zero load, before and after", "repeat the test at another speed"),
    course=Course(amplitude, "drift", "drift_knots", start="drift_from_s"))
