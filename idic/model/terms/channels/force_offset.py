"""Force offset: a load cell that was not zeroed, the weight of a grip."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from idic.model.records.experiment import Experiment
from idic.model.records.parts import Channel, Column, Load, Prescribed
from idic.model.terms.channels.channel_term import ChannelTerm, Probe, Reading, Step, logged_size
from idic.parameters import Parameter, PlausibleSize

PROBE_FORCE_SHARE = 0.02  # of the largest force


def parameters(channel: Channel, times: np.ndarray | None, prescribed: Sequence[Prescribed]) -> list[Parameter]:
    return [Parameter(channel.dof("offset"), 0.0, channel.unit, scale=0.1 * logged_size(channel))]


def step(reading: float, at: Reading) -> Step:
    """r -> r + offset"""
    return Step(reading + at.value("offset"), {"offset": 1.0})


def probes(experiment: Experiment, channel: Channel) -> list[Probe]:
    return [Probe(f"offset of {channel.column}", "offset", PROBE_FORCE_SHARE * float(np.abs(channel.values).max()))]


def load_probe(load: Load) -> tuple[float, float] | None:
    size = float(np.abs(load.drive.values).max()) if isinstance(load.drive, Column) else 0.0
    return (0.0, PROBE_FORCE_SHARE * size) if size > 0.0 else None


FORCE_OFFSET = ChannelTerm(
    "force_offset", "force offset", "a force reading that is off by a constant", "an offset of zero",
    ("offset",), parameters, step, probes,
    rivals={"force_drift": "both are present at zero load: one is constant, one grows",
            "plasticity": "a force that is missing after unloading"},
    size=PlausibleSize(0.5, "1 % of the largest force",
                       "an estimate: the weight of a grip that was not zeroed"),
    separating_tests=("record the force at zero load, before and after", "unload to zero once"),
    load_probe=load_probe)
