"""Friction in the load train: the load cell shows more on the way up and less on the way back."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from idic.model.records.experiment import Experiment
from idic.model.records.parts import Channel, Prescribed
from idic.model.load_train import way_of
from idic.model.terms.channels.channel_term import ChannelTerm, Course, Probe, Reading, Step, logged_size
from idic.parameters import Parameter, PlausibleSize

CONSTANT, SHARE = "friction", "friction_share"  # of any force, and in proportion to it
PROBE_SHARE = 0.02  # of the largest force, or of the force


def parameters(channel: Channel, times: np.ndarray | None, prescribed: Sequence[Prescribed]) -> list[Parameter]:
    if way_of(prescribed) is None or channel.kind != "reaction":
        return []
    size = 0.1 * logged_size(channel)
    return [Parameter(channel.dof(CONSTANT), 0.0, channel.unit, scale=size),
            *(Parameter(channel.dof(name), 0.0, channel.unit, True, scale=size) for name in channel.hats_of(CONSTANT)),
            Parameter(channel.dof(SHARE), 0.0, "", scale=0.1)]


def step(reading: float, at: Reading) -> Step:
    """r -> r + (friction + friction_share |F|) way, or a course that the data give in the place of friction"""
    hats = at.channel.hats_of(CONSTANT)
    if not (hats or at.has(CONSTANT) or at.has(SHARE)):
        return Step(reading, {})
    way, share, force = at.way, at.value(SHARE), at.simulated
    knots = {name: way * float(hat[at.frame]) for name, hat in hats.items()}
    opposed = (at.value(CONSTANT) + share * abs(force)) * way + sum(at.value(name) * by for name, by in knots.items())
    return Step(reading + opposed, {CONSTANT: way, SHARE: way * abs(force)} | knots,
                by_simulated=share * float(np.sign(force)) * way)


def probes(experiment: Experiment, channel: Channel) -> list[Probe]:
    way = way_of(experiment.model.prescribed)
    if channel.kind != "reaction" or way is None or len(set(way) - {0.0}) < 2:
        return []  # without a way back friction is a part of the force
    return [Probe(f"constant friction in {channel.column}", CONSTANT, PROBE_SHARE * channel.largest, sign=1),
            Probe(f"friction in proportion to the force in {channel.column}", SHARE, PROBE_SHARE, sign=1)]


def amplitude(experiment: Experiment, channel: Channel, name: str) -> np.ndarray | None:
    if name == CONSTANT:
        return (np.arange(experiment.model.n_frames) > experiment.model.reference).astype(float)
    return np.abs(channel.values) if name == SHARE else channel.hats_of(CONSTANT).get(name)


FRICTION = ChannelTerm(
    "friction", "friction in the load train", "hysteresis of the force that changes sign with the direction of motion",
    "no friction", (CONSTANT, SHARE), parameters, step, probes,
    rivals={"viscoelasticity": "hysteresis of force over motion: friction does not depend on the speed and does not "
                               "relax",
            "plasticity": "hysteresis of force over motion: friction leaves no strain",
            "frame_time_offset": "a force that lags behind the motion",
            "force_offset": "both are present at zero load; friction changes sign with the direction of motion"},
    size=PlausibleSize(0.375, "0.75 % of the force",
                       "half of the reversibility error of class 1, ISO 7500-1"),
    separating_tests=("stop and reverse slightly: friction reverses the force at once", "repeat at another speed",
                      "mount the load cell next to the specimen, before guides and seals"),
    course=Course(amplitude, CONSTANT, "friction_knots", is_directed=True))
