"""The sign of a force in the elastic beginning of the test, where no break, slip or unloading is in it.

    F - F_0 = s (m - m_0) + noise        m : motion of the set along the force, against that of the other end

A reaction is the force on a node set: it does work on the specimen as long as the specimen is elastic, so that s > 0.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from idic.measure import AffineMotions
from idic.model import Channel, Column, Experiment
from idic.report.evidence.causes.ends import component_px, counted_frames

BEGINNING = 0.5  # of the largest force: up to there the beginning is judged
MIN_FRAMES = 3  # the reference among them
MIN_Z = 3.0  # standard deviations by which the slope has to be negative
MIN_MOTION_NOISES = 5.0  # of a motion in images: less is noise


@dataclass(frozen=True)
class Slope:
    """Slope of the force over the motion, N/mm, its standard deviation, and where it was taken.

    motion : what moves, in words; nodes : the moving set; end : the last frame
    """

    value: float
    std: float
    motion: str
    nodes: str
    end: int

    @property
    def is_opposed(self) -> bool:
        return self.value < -MIN_Z * self.std

    @property
    def is_with_it(self) -> bool:
        return self.value > MIN_Z * self.std


def opposed_forces(experiment: Experiment, motions: AffineMotions | None = None) -> Iterator[str]:
    """Forces whose sign is that of another convention; motions : measured, where no motion was logged."""
    for channel in experiment.model.channels:
        slope = slope_of(experiment, channel, motions)
        if slope is None or not slope.is_opposed:
            continue
        with_it = "with" if slope.nodes == channel.nodes else "against"
        yield (f"{channel.column}: the force that holds {channel.nodes} goes {with_it} the motion of {slope.nodes}, "
               f"{slope.motion}; the log shows the opposite. factor = {-channel.factor:g} in simulated = {{ … }} "
               f"reverses the sign of the force (slope until {experiment.recording.labels[slope.end]}, where the test "
               f"is elastic: {slope.value:.3g} ± {slope.std:.1g} N/mm)")


def slope_of(experiment: Experiment, channel: Channel, motions: AffineMotions | None = None) -> Slope | None:
    """The slope of a force in the beginning, as it would be positive; None where no motion goes with it."""
    model = experiment.model
    if channel.kind != "reaction" or channel.component is None:
        return None
    counted = counted_frames(experiment)
    along = [entry for entry in model.prescribed if entry.component == channel.component]
    driven = [entry for entry in along if isinstance(entry.drive, Column)]
    if len(driven) == 1:
        entry, frames = driven[0], np.array([model.reference, *counted])
        values, name, least = np.asarray(entry.drive.values, float)[frames], entry.drive.column, 0.0
        sign = 1.0 if entry.nodes == channel.nodes else -1.0
        nodes = entry.nodes
    else:
        stretch = None if motions is None else _stretch(experiment, channel, along, motions)
        if stretch is None:
            return None
        frames, values, name, least = stretch
        sign, nodes = 1.0, channel.nodes
    force = sign * channel.factor * np.asarray(channel.values, float)[frames]
    return _slope(force - force[0], values - values[0], frames, channel.noise_std or 0.0, (name, nodes), least)


def _slope(force: np.ndarray, motion: np.ndarray, frames: np.ndarray, noise: float, names: tuple[str, str],
           least: float) -> Slope | None:
    """least : motion, mm, that noise alone reaches"""
    largest = np.abs(force).max(initial=0.0)
    if not largest > 0.0 or not np.isfinite(force).all() or not np.isfinite(motion).all():
        return None
    end = max(int(np.argmax(np.abs(force) >= BEGINNING * largest)) + 1, MIN_FRAMES)
    force, motion = force[:end], motion[:end]
    size = float(motion @ motion)
    if len(force) < MIN_FRAMES or not np.abs(motion).max() > least or not size > 0.0:
        return None
    value = float(force @ motion) / size
    scatter = float(((force - value * motion) ** 2).sum()) / (len(force) - 2)
    return Slope(value, float(np.sqrt(max(scatter, noise**2) / size)), *names, int(frames[end - 1]))


def _stretch(experiment: Experiment, channel: Channel, along: list,
             motions: AffineMotions) -> tuple[np.ndarray, np.ndarray, str, float] | None:
    """Frames and measured motion of the set of a force against the other end, mm; None where there are not two ends."""
    sets = list(dict.fromkeys(entry.nodes for entry in along))
    measured_frames = np.isfinite(motions.fits).all(axis=(1, 2))
    if len(sets) != 2 or channel.nodes not in sets or not measured_frames.any():
        return None
    moved = {}
    for name in sets:
        places, steps = component_px(experiment, name, channel.component)
        if not len(places):
            return None
        sizes = np.linalg.norm(steps, axis=1)
        moved[name] = np.einsum("npc,pc->np", motions.at(places), steps / sizes[:, None] ** 2).mean(axis=1)
        least = MIN_MOTION_NOISES * motions.noise_px / float(sizes.mean())
    other_set, = (name for name in sets if name != channel.nodes)
    frames = np.array([experiment.model.reference, *np.array(motions.frames)[measured_frames]])
    source = "the images" if experiment.recording.points is None else "the measured fields"
    return frames, np.array([0.0, *(moved[channel.nodes] - moved[other_set])[measured_frames]]), f"by {source}", least
