"""Channels of a frame: forces, pressures and extensometers as the log would show them (docs/method.md, equation 1.5)."""

from __future__ import annotations

import numpy as np

from idic.correlation.context import CorrelationContext, FrameResponse
from idic.correlation.equations import ChannelEquations
from idic.model.experiment import Experiment
from idic.parameters import ParameterSet


def channel_values(experiment: Experiment, parameters: ParameterSet, simulated: np.ndarray, frame: int) -> np.ndarray:
    """What the channels would show for these simulated forces: scale, offset and drift included  # (n_channels,)"""
    values = np.array(simulated, float)
    for c, channel in enumerate(experiment.channels):
        stem = f"channel.{channel.column}"
        values[c] *= _value(parameters, f"{stem}.scale", 1.0)
        values[c] += _value(parameters, f"{stem}.offset", 0.0)
        values[c] += _value(parameters, f"{stem}.drift", 0.0) * _elapsed(experiment, frame)
    return values


def measured_values(experiment: Experiment, parameters: ParameterSet) -> np.ndarray:
    """The logged channels of all frames, at the times of the images  # (n_frames, n_channels)"""
    shift = _value(parameters, "time.offset", 0.0)
    columns = [channel.values + (shift * channel.rates if channel.rates is not None else 0.0)
               for channel in experiment.channels]
    return np.stack(columns, axis=1) if columns else np.zeros((experiment.n_frames, 0))


def channel_equations(context: CorrelationContext, response: FrameResponse) -> ChannelEquations:
    """Residual of every channel and its derivative: scale, offset, drift and the time offset included."""
    experiment, parameters = context.experiment, context.parameters
    n_channels, n = len(experiment.channels), len(context.names)
    shown = channel_values(experiment, parameters, response.channels, response.frame)
    residual, d_global = np.zeros(n_channels), np.zeros((n_channels, n))
    scales = np.ones(n_channels)
    shift = _value(parameters, "time.offset", 0.0)
    for c, channel in enumerate(experiment.channels):
        stem = f"channel.{channel.column}"
        scales[c] = _value(parameters, f"{stem}.scale", 1.0)
        rate = 0.0 if channel.rates is None else channel.rates[response.frame]
        residual[c] = channel.values[response.frame] + shift * rate - shown[c]
        own = {f"{stem}.scale": response.channels[c], f"{stem}.offset": 1.0,
               f"{stem}.drift": _elapsed(experiment, response.frame), "time.offset": -rate}
        for i, name in enumerate(context.names):
            d_global[c, i] = own.get(name, 0.0)
            if name in context.moving:
                d_global[c, i] += scales[c] * response.dchannels[c, context.moving.index(name)]
    return ChannelEquations(residual, d_global, scales[:, None] * response.local_dchannels)


def _value(parameters: ParameterSet, name: str, default: float) -> float:
    return parameters[name].value if name in parameters else default


def _elapsed(experiment: Experiment, frame: int) -> float:
    return float(experiment.times[frame] - experiment.times[experiment.reference])
