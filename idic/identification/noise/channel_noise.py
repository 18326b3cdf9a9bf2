"""The noise of the channels of an accepted point: their correlation over frames in the covariance of the parameters.

    Cov(b) += w_c^2 [S_c^T Sigma_c S_c - sigma_c^2 S_c^T S_c]   (docs/method.md, equation 11.9)

per channel c, S_c its derivatives by the unknowns, w_c its weight, sigma_c the standard deviation that it is weighted
by.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from idic.correlation import CorrelationSystem
from idic.identification.noise.channel_correlation import ChannelNoise, channel_correlation
from idic.identification.noise.input_noise import logged_noise
from idic.identification.step.parameter_covariance import Scaled, scaled_system
from idic.identification.step.state import Evaluation
from idic.model import Channel, Column, Experiment, Model, Remedies
from idic.parameters import ParameterSet

MIN_STEP_SHARE = 1e-3  # of the range of a motion: less from frame to frame is none
MIN_REPEATED_SHARE = 0.4  # of the steps that move the specimen
MIN_RUNS = 3  # of equal readings, with jumps between them; fewer are plateaus
MIN_KEPT = 1e-3  # of a reading: the unknowns of a frame fit more of it, and it tells nothing


def weighted_std(model: Model, number: int) -> float:
    """Standard deviation that a channel is weighted by: the stated one, else that of its course."""
    return logged_noise(model, model.channels[number])


def estimated_channel_noise(experiment: Experiment, parameters: ParameterSet,
                            point: Evaluation) -> dict[int, ChannelNoise]:
    """The noise of channels that is estimated from the residual, by number: where it is correlated from frame to frame,
    or where no standard deviation is stated.

    Empty where weights are not those of noise.

    point : the accepted one, with the system of all free parameters
    """
    system = point.system
    if experiment.options.weighting != "noise" or not _knows_channels(system):
        return {}
    scaled = scaled_system(replace(system, end_noise=None), parameters, np.zeros_like(system.M), 0.0)
    noises = {}
    for number, channel in enumerate(experiment.model.channels):
        std = weighted_std(experiment.model, number)
        noise = _noise_of(scaled, system, channel, number, std)
        if noise is not None and (noise.is_correlated or noise.smooth is not None or not channel.noise_std):
            noises[number] = noise
    return noises


def _noise_of(scaled: Scaled, system: CorrelationSystem, channel: Channel, number: int,
              std: float) -> ChannelNoise | None:
    """What the unknowns of the frames have taken of a reading is given back: its residual by all other unknowns, less
    certain and not independent from frame to frame."""
    compared = np.flatnonzero(np.isfinite([record.channel_residual[number] for record in system.frames]))
    records = [system.frames[k] for k in compared]
    columns = np.array([record.channel_columns[number] for record in records]).reshape(len(records), -1)
    if not columns.any():
        return None
    shares, directions = np.linalg.eigh(system.retention_of(number)[np.ix_(compared, compared)])
    given_back = (directions / np.maximum(shares, MIN_KEPT)) @ directions.T
    rows = given_back @ (columns * scaled.slopes)
    residual = given_back @ np.array([record.channel_residual[number] for record in records])
    weighed = (columns * scaled.slopes).T / std**2
    local = std**2 * (given_back - np.eye(len(records)))
    simulated = np.array([channel.values[record.frame] for record in records]) - residual
    return channel_correlation(residual, rows, [record.frame for record in records], scaled.M - weighed @ rows,
                               scaled.b - weighed @ residual, std, bool(channel.noise_std), local, simulated)


def with_channel_noise(system: CorrelationSystem, model: Model,
                       noises: Mapping[int, ChannelNoise]) -> CorrelationSystem:
    """The system whose spread counts the correlation of the channels over frames."""
    if not noises:
        return system
    rows = np.array([record.channel_columns for record in system.frames])
    added = added_spread(rows, compared_readings(system), model, noises)
    return replace(system, spread=system.spread + added)


def compared_readings(system: CorrelationSystem) -> np.ndarray:
    """Which channels are compared in which frame  # (n_frames, n_channels) bool"""
    return np.isfinite([record.channel_residual for record in system.frames])


def added_spread(rows: np.ndarray, compared: np.ndarray, model: Model,
                 noises: Mapping[int, ChannelNoise]) -> np.ndarray:
    """What correlated channels add to the covariance of b  # (n, n)

    rows : (n_frames, n_channels, n) derivatives of the simulated channels; compared : (n_frames, n_channels)
    """
    added = np.zeros((rows.shape[2], rows.shape[2]))
    for number, noise in noises.items():
        std, channel_rows = weighted_std(model, number), rows[compared[:, number], number]
        change = noise.covariance - std**2 * np.eye(len(channel_rows))
        added += channel_rows.T @ change @ channel_rows / std**4
    return added


def smooth_spread(rows: np.ndarray, compared: np.ndarray, model: Model,
                  noises: Mapping[int, ChannelNoise]) -> np.ndarray | None:
    """What smooth errors of the channels add to the covariance of b  # (n, n), None where there are none

    rows, compared : as of `added_spread`
    """
    parts = [channel_rows.T @ noise.smooth @ channel_rows / weighted_std(model, number)**4
             for number, noise in noises.items() if noise.smooth is not None
             for channel_rows in [rows[compared[:, number], number]]]
    return sum(parts) if parts else None


def smooth_share(model: Model, noises: Mapping[int, ChannelNoise]) -> float:
    """Smooth error of the channels, rms over the rms reading, of the largest; 0 where there is none."""
    return max((_smooth_share(model.channels[number], noise) for number, noise in noises.items()), default=0.0)


def _smooth_share(channel: Channel, noise: ChannelNoise) -> float:
    if noise.smooth is None:
        return 0.0
    rms = np.sqrt(np.mean(channel.values[np.isfinite(channel.values)] ** 2))
    return float(np.sqrt(np.diagonal(noise.smooth).mean()) / max(rms, 1e-300))


def channel_noise_content(model: Model, noises: Mapping[int, ChannelNoise]) -> dict[str, dict]:
    """The correlated channels for the result (docs/quantities.md), in the units of their columns."""
    return {(channel := model.channels[number]).column: {
        "std": noise.std / channel.shown_factor,
        "weighted_std": weighted_std(model, number) / channel.shown_factor, "order": noise.order,
        "correlation": noise.correlation, "probability_independent": noise.independent}
        for number, noise in noises.items()}


def channel_noise_notes(model: Model, noises: Mapping[int, ChannelNoise]) -> list[str]:
    """Notes for the result."""
    smooth_notes = [
        f"Channel {(channel := model.channels[number]).column} has an error beside its noise that is smooth over the "
        f"frames, of about {100.0 * _smooth_share(channel, noise):.2g} % of its readings (rms). The error bars count "
        "it as an error of the model."
        for number, noise in noises.items() if noise.smooth is not None]
    return [f"The noise of channel {(channel := model.channels[number]).column} is correlated from frame to frame "
            f"({noise.correlation:.2f} between consecutive ones, standard deviation "
            f"{noise.std / channel.shown_factor:.3g} {channel.shown_unit}): it averages out less over the frames. The "
            "error bars count this."
            for number, noise in noises.items() if noise.is_correlated] + smooth_notes


def repeated_readings(experiment: Experiment) -> Iterator[str]:
    """Channels that repeat their reading while the specimen is moved: of a log slower than the images, or rounded."""
    model = experiment.model
    counted = [k for k in range(model.reference, model.n_frames) if k not in experiment.recording.excluded]
    drives = [entry.drive for entry in model.prescribed if isinstance(entry.drive, Column)]
    for channel in model.channels if len(counted) > 2 else ():
        for drive in (drive for drive in drives if channel.kind != "pressure" and drive.column != channel.column):
            steps, change = np.diff(drive.values[counted]), np.diff(channel.values[counted])
            moving = np.abs(steps) > MIN_STEP_SHARE * np.ptp(drive.values[counted])
            repeated, jumps = moving & (change == 0.0), np.abs(change[moving & (change != 0.0)])
            runs = np.count_nonzero(np.diff(np.r_[False, repeated].astype(int)) == 1)
            if not len(jumps) or runs < MIN_RUNS or repeated.sum() < MIN_REPEATED_SHARE * moving.sum():
                continue
            yield (f"{channel.column}: in {repeated.sum()} of the {moving.sum()} steps in which {drive.column} changes "
                   f"the reading is that of the frame before, and then jumps by "
                   f"{np.median(jumps) / channel.shown_factor:.3g} {channel.shown_unit}. Of a log slower than the "
                   "images, the repeated readings are late and bias every stress: give it with its own times (a column "
                   f"time_s{Remedies(experiment).times_of_images})"
                   + Remedies(experiment).possible(", or list the repeated frames in exclude_frames")
                   + Remedies(experiment).possible(". Of a coarse resolution: noise_std of at least 0.3 of it"))
            break


def _knows_channels(system: CorrelationSystem) -> bool:
    return bool(system.frames) and all(record.channel_columns.shape[1] == len(system.names) for record in system.frames)
