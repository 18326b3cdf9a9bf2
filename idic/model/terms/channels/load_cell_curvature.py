"""Nonlinear load cell: its reading bends with the force."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from idic.model.records.experiment import Experiment
from idic.model.records.parts import Channel, Prescribed
from idic.model.terms.channels.channel_term import ChannelTerm, Probe, Reading, Step
from idic.parameters import Parameter, PlausibleSize

PROBE_CURVATURE = 0.02  # of the force, at its largest


def parameters(channel: Channel, times: np.ndarray | None, prescribed: Sequence[Prescribed]) -> list[Parameter]:
    return [Parameter(channel.dof("curvature"), 0.0, "", scale=0.1)]


def step(reading: float, at: Reading) -> Step:
    """r -> r (1 + curvature F / F_max)"""
    curvature, largest = at.value("curvature"), at.channel.largest
    factor = 1.0 + curvature * at.simulated / largest
    return Step(reading * factor, {"curvature": reading * at.simulated / largest}, factor,
                reading * curvature / largest)


def probes(experiment: Experiment, channel: Channel) -> list[Probe]:
    if channel.kind != "reaction":
        return []
    return [Probe(f"{channel.column} is bent", "curvature", PROBE_CURVATURE)]


LOAD_CELL_CURVATURE = ChannelTerm(
    "load_cell_curvature", "nonlinear load cell", "a calibration line that bends", "a straight calibration line",
    ("curvature",), parameters, step, probes,
    rivals={"nonlinear_elasticity": "a nonlinear force over motion: by the load cell, or by the material",
            "force_scale": "a factor: the same at one load",
            "geometric_nonlinearity": "a stiffness that changes with the load"},
    size=PlausibleSize(0.25, "0.5 % of the force",
                       "error of indication of class 0.5, ISO 7500-1"),
    separating_tests=("calibrate the load cell at several loads", "hang dead weights on the load cell"))
