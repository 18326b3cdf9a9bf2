"""Channels of a frame: forces, pressures and extensometers as the log would show them (docs/method.md, equation 1.5).

A simulated value passes through the terms of the measuring chain: load cell, friction in the load train, offset, drift
(`idic.model.terms.channels.channel_terms`).
"""

from __future__ import annotations

import numpy as np

from idic.correlation.image_equations.context import CorrelationContext, FrameResponse
from idic.correlation.image_equations.equations import ChannelEquations
from idic.model import Experiment, shown_value
from idic.parameters import ParameterSet


def channel_values(experiment: Experiment, parameters: ParameterSet, simulated: np.ndarray, frame: int) -> np.ndarray:
    """What the channels would show for these simulated forces  # (n_channels,)"""
    return np.array([shown_value(experiment, channel, parameters, frame, float(force)).value
                     for channel, force in zip(experiment.model.channels, simulated, strict=True)], float)


def channel_equations(context: CorrelationContext, response: FrameResponse) -> ChannelEquations:
    """Residual of every channel and its derivative: by its terms, by the simulation, and by the time offset."""
    experiment, parameters, frame = context.experiment, context.parameters, response.frame
    n_channels, n = len(experiment.model.channels), len(context.names)
    residual, d_global, slopes = np.zeros(n_channels), np.zeros((n_channels, n)), np.ones(n_channels)
    shift = experiment.model.log_shift(parameters)
    for c, channel in enumerate(experiment.model.channels):
        reading = shown_value(experiment, channel, parameters, frame, float(response.channels[c]))
        rate, slopes[c] = 0.0 if channel.rates is None else channel.rates[frame], reading.slope
        residual[c] = channel.values[frame] + shift * rate - reading.value
        by_name = {**reading.by_name, "time.offset": -rate}
        for i, name in enumerate(context.names):
            d_global[c, i] = by_name.get(name, 0.0)
            if name in context.moving:
                d_global[c, i] += slopes[c] * response.dchannels[c, context.moving.index(name)]
    return ChannelEquations(residual, d_global, slopes[:, None] * response.local_dchannels)
