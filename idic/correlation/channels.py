"""Channels of a frame: forces, pressures and extensometers as the log would show them (docs/method.md, equation 1.5).

    shown = scale F (1 + curvature F / F_max) + (friction + friction_share |F|) way + offset + drift (t - t_0)

or, in place of drift and friction, courses that the data give (``drift_knot[FRAME]``, ``friction_knot[FRAME]``,
`idic.model.free_course`). F_max is the
largest reading, way the direction of the load train (`idic.model.load_train`), t_0 the reference frame or `drift_from`.
"""

from __future__ import annotations

import numpy as np

from idic.correlation.image_equations.context import CorrelationContext, FrameResponse
from idic.correlation.image_equations.equations import ChannelEquations
from idic.model import Channel, Experiment, knot_name, way_of
from idic.parameters import ParameterSet

FRICTION = ("friction", "friction_share")  # degrees of freedom that need the direction of the load train


def channel_values(experiment: Experiment, parameters: ParameterSet, simulated: np.ndarray, frame: int) -> np.ndarray:
    """What the channels would show for these simulated forces, see the module  # (n_channels,)"""
    values = np.array(simulated, float)
    for c, channel in enumerate(experiment.channels):
        stem, F = f"channel.{channel.column}", values[c]
        values[c] *= _value(parameters, f"{stem}.scale", 1.0)
        if (curvature := _value(parameters, f"{stem}.curvature", 0.0)) != 0.0:
            values[c] *= 1.0 + curvature * F / channel.largest
        if friction := _friction(parameters, stem, F):
            values[c] += friction * _way(experiment, frame)
        values[c] += _value(parameters, f"{stem}.offset", 0.0)
        values[c] += _value(parameters, f"{stem}.drift", 0.0) * drifting(experiment, channel, frame)
        values[c] += sum(_value(parameters, name, 0.0) * change for name, change in knots(experiment, channel,
                                                                                          frame).items())
    return values


def measured_values(experiment: Experiment, parameters: ParameterSet) -> np.ndarray:
    """The logged channels of all frames, at the times of the images  # (n_frames, n_channels)"""
    shift = experiment.log_shift(parameters)
    columns = [channel.values + (shift * channel.rates if channel.rates is not None else 0.0)
               for channel in experiment.channels]
    return np.stack(columns, axis=1) if columns else np.zeros((experiment.n_frames, 0))


def channel_equations(context: CorrelationContext, response: FrameResponse) -> ChannelEquations:
    """Residual of every channel and its derivative: what `channel_values` counts, and the time offset."""
    experiment, parameters = context.experiment, context.parameters
    n_channels, n = len(experiment.channels), len(context.names)
    shown = channel_values(experiment, parameters, response.channels, response.frame)
    residual, d_global = np.zeros(n_channels), np.zeros((n_channels, n))
    slopes = np.ones(n_channels)
    shift = experiment.log_shift(parameters)
    for c, channel in enumerate(experiment.channels):
        F = response.channels[c]
        slopes[c] = _slope(experiment, channel, parameters, F, response.frame)
        rate = 0.0 if channel.rates is None else channel.rates[response.frame]
        residual[c] = channel.values[response.frame] + shift * rate - shown[c]
        own = _own_derivatives(experiment, channel, parameters, F, response.frame) | {"time.offset": -rate}
        for i, name in enumerate(context.names):
            d_global[c, i] = own.get(name, 0.0)
            if name in context.moving:
                d_global[c, i] += slopes[c] * response.dchannels[c, context.moving.index(name)]
    return ChannelEquations(residual, d_global, slopes[:, None] * response.local_dchannels)


def _own_derivatives(experiment: Experiment, channel: Channel, parameters: ParameterSet, F: float,
                     frame: int) -> dict[str, float]:
    """Of what a channel shows, by its own degrees of freedom; F : simulated."""
    stem = f"channel.{channel.column}"
    scale, curvature = _value(parameters, f"{stem}.scale", 1.0), _value(parameters, f"{stem}.curvature", 0.0)
    bent = F * F / channel.largest
    way = _way(experiment, frame) if any(f"{stem}.{name}" in parameters for name in FRICTION) else 0.0
    return {f"{stem}.scale": F + curvature * bent, f"{stem}.curvature": scale * bent, f"{stem}.offset": 1.0,
            f"{stem}.drift": drifting(experiment, channel, frame), f"{stem}.friction": way,
            f"{stem}.friction_share": way * abs(F)} | knots(experiment, channel, frame)


def _slope(experiment: Experiment, channel: Channel, parameters: ParameterSet, F: float, frame: int) -> float:
    """Change of what a channel shows with the simulated force."""
    stem = f"channel.{channel.column}"
    slope = _value(parameters, f"{stem}.scale", 1.0)
    if (curvature := _value(parameters, f"{stem}.curvature", 0.0)) != 0.0:
        slope *= 1.0 + 2.0 * curvature * F / channel.largest
    if share := _value(parameters, f"{stem}.friction_share", 0.0):
        slope += share * float(np.sign(F)) * _way(experiment, frame)
    return slope


def _friction(parameters: ParameterSet, stem: str, F: float) -> float:
    return _value(parameters, f"{stem}.friction", 0.0) + _value(parameters, f"{stem}.friction_share", 0.0) * abs(F)


def _way(experiment: Experiment, frame: int) -> float:
    """Direction of the load train, 0 where no motion is logged."""
    way = way_of(experiment.prescribed)
    return 0.0 if way is None else float(way[frame])


def _value(parameters: ParameterSet, name: str, default: float) -> float:
    return parameters[name].value if name in parameters else default


def knots(experiment: Experiment, channel: Channel, frame: int) -> dict[str, float]:
    """Change of a reading with the knots of a drift or friction whose course the data give."""
    stem, found = f"channel.{channel.column}", {}
    if channel.drift_hats is not None:
        found |= {knot_name(f"{stem}.drift", knot): float(hat[frame])
                  for knot, hat in zip(channel.drift_knots, channel.drift_hats, strict=True)}
    if channel.friction_hats is not None:
        way = _way(experiment, frame)
        found |= {knot_name(f"{stem}.friction", knot): way * float(hat[frame])
                  for knot, hat in zip(channel.friction_knots, channel.friction_hats, strict=True)}
    return found


def drifting(experiment: Experiment, channel: Channel, frame: int) -> float:
    """Seconds for which the reading of a channel has drifted."""
    start = experiment.times[experiment.reference] if channel.drift_from is None else channel.drift_from
    seconds = float(experiment.times[frame] - start)
    return seconds if channel.drift_from is None else max(seconds, 0.0)
