"""Force scale error: the load cell's calibration, the thickness, half a specimen.

Where the simulation is driven by motions alone, a factor of the force is a factor of all moduli: the two are exactly
indistinguishable in this test, and the visibility of the column is zero.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from idic.model.records.experiment import Experiment
from idic.model.records.parts import Channel, Load, Prescribed
from idic.model.terms.channels.channel_term import ChannelTerm, Probe, Reading, Step
from idic.parameters import Parameter, PlausibleSize

PROBE_FORCE_FACTOR = 1.02


def parameters(channel: Channel, times: np.ndarray | None, prescribed: Sequence[Prescribed]) -> list[Parameter]:
    return [Parameter(channel.dof("scale"), 1.0, "", scale=0.1)]


def step(reading: float, at: Reading) -> Step:
    """r -> scale r"""
    scale = at.value("scale", 1.0)
    return Step(reading * scale, {"scale": reading}, scale)


def probes(experiment: Experiment, channel: Channel) -> list[Probe]:
    return [Probe(f"scale of {channel.column}", "scale", PROBE_FORCE_FACTOR, null=1.0)]


def load_probe(load: Load) -> tuple[float, float]:
    return 1.0, PROBE_FORCE_FACTOR


FORCE_SCALE = ChannelTerm(
    "force_scale", "force scale error", "a force reading that is off by a factor", "a factor of one",
    ("scale",), parameters, step, probes,
    rivals={"heterogeneity": "a modulus that is off everywhere: with prescribed motions exactly indistinguishable",
            "machine_compliance": "both change the slope of force against motion"},
    size=PlausibleSize(0.5, "1 % of the force",
                       "error of indication of class 1, ISO 7500-1"),
    separating_tests=("hang a dead weight on the load cell", "measure the thickness again",
                      "test a reference specimen of known modulus"),
    load_probe=load_probe)
