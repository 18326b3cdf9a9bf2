"""The terms of a channel, in the order in which a simulated value passes through them.

    shown = scale F (1 + curvature F / F_max) + (friction + friction_share |F|) way + offset + drift (t - t_0)
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from idic.model.records.experiment import Experiment
from idic.model.records.parts import Channel
from idic.model.terms.channels.channel_term import ChannelTerm, Reading
from idic.model.terms.channels.force_drift import FORCE_DRIFT
from idic.model.terms.channels.force_offset import FORCE_OFFSET
from idic.model.terms.channels.force_scale import FORCE_SCALE
from idic.model.terms.channels.friction import FRICTION
from idic.model.terms.channels.load_cell_curvature import LOAD_CELL_CURVATURE
from idic.parameters import ParameterSet

CHANNEL_TERMS: tuple[ChannelTerm, ...] = (FORCE_SCALE, LOAD_CELL_CURVATURE, FRICTION, FORCE_OFFSET, FORCE_DRIFT)


@dataclass(frozen=True)
class ShownValue:
    """What a channel shows: value, change with the simulated value, and with the degrees of freedom of its terms."""

    value: float
    slope: float
    by_name: Mapping[str, float]


def shown_value(experiment: Experiment, channel: Channel, parameters: ParameterSet, frame: int,
                simulated: float) -> ShownValue:
    """What a channel shows of a simulated value in a frame, with derivatives by the chain rule."""
    reading = Reading(experiment, channel, parameters, frame, simulated)
    value, slope, by_name = simulated, 1.0, {}
    for term in CHANNEL_TERMS:
        step = term.step(value, reading)
        by_name = {name: step.by_reading * change for name, change in by_name.items()}
        by_name |= {channel.dof(name): change for name, change in step.by_parameter.items()}
        value, slope = step.value, step.by_reading * slope + step.by_simulated
    return ShownValue(value, slope, by_name)


def channel_term(name: str) -> ChannelTerm | None:
    """The term of a degree of freedom, by its last word without a knot; None of another one."""
    return next((term for term in CHANNEL_TERMS if name in term.names), None)
