"""An experiment cut off after a frame: only its first frames, in the images and in every other record."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from idic.errors import InputError
from idic.images import LeadingFrames
from idic.model.records.experiment import Experiment
from idic.model.records.model import Model
from idic.model.records.parts import Channel, Column, Constant, Controlled, Parametrised, Temperature


def leading_frames(experiment: Experiment, n_frames: int) -> Experiment:
    """The experiment up to frame ``n_frames - 1``; later frames are neither simulated nor correlated.

    A window that grows with the test shows when a model begins to fail; a short window starts a search that fails on
    the whole test. (`Recording.excluded` leaves single frames out of the comparison only.)

    Raises
    ------
    InputError
        If no frame after the reference would remain.
    """
    model = experiment.model
    n_recorded = model.n_frames
    if not model.reference + 2 <= n_frames <= n_recorded:
        raise InputError("a window of frames outside the test", key="n_frames",
                         expected=f"{model.reference + 2} to {n_recorded} frames", found=f"{n_frames}",
                         remedy="keep the reference and at least one frame after it")
    if n_frames == n_recorded:
        return experiment
    cut = selected_frames(experiment, range(n_frames))
    cameras = tuple(replace(camera, stack=_images(camera.stack, n_frames), labels=camera.labels[:n_frames])
                    for camera in experiment.cameras)
    return replace(cut, recording=replace(cut.recording, stack=_images(experiment.recording.stack, n_frames)),
                   cameras=cameras)


def selected_frames(experiment: Experiment, frames: Sequence[int]) -> Experiment:
    """The records of these frames (ascending, the reference among them) without any images or further cameras: what
    the simulation of a test with fewer frames needs."""
    model, recording = experiment.model, experiment.recording
    pick = np.asarray(frames)
    place = {int(frame): k for k, frame in enumerate(pick)}
    return replace(experiment, recording=replace(recording, labels=tuple(recording.labels[k] for k in pick),
                                                 stack=None, averaged=tuple(place[k] for k in recording.averaged
                                                                            if k in place),
                                                 excluded=tuple(place[k] for k in recording.excluded if k in place)),
                   model=replace(model, times=model.times[pick], reference=place[model.reference],
                                 prescribed=tuple(replace(p, drive=_drive(_from_zero(model, p.drive), pick))
                         for p in model.prescribed), loads=tuple(replace(load, drive=_drive(load.drive, pick))
                                                                 for load in model.loads),
                                 channels=tuple(_channel(channel, pick) for channel in model.channels),
                                 temperatures=tuple(_temperature(entry, pick) for entry in model.temperatures),
                                 cracks=tuple(replace(crack, hats=crack.hats[:, pick]) for crack in model.cracks)),
                   cameras=())


def _from_zero(model: Model, drive):
    """A logged motion whose rates count from those of the reference frame, whatever its number will be."""
    rates = drive.rates if isinstance(drive, (Column, Controlled)) else None
    return drive if rates is None else replace(drive, rates=model.rates_since_reference(rates))


def _drive(drive, pick: np.ndarray):
    if isinstance(drive, Column):
        corrections = tuple(replace(c, course=c.course[pick]) for c in drive.corrections)
        return replace(drive, values=drive.values[pick], rates=_cut(drive.rates, pick), corrections=corrections)
    if isinstance(drive, Constant):
        return replace(drive, corrections=tuple(replace(c, course=c.course[pick]) for c in drive.corrections))
    if isinstance(drive, Controlled):
        return replace(drive, course=drive.course[pick], rates=_cut(drive.rates, pick))
    if isinstance(drive, Parametrised):
        return replace(drive, courses=_cut(drive.courses, pick))
    return drive


def _channel(channel: Channel, pick: np.ndarray) -> Channel:
    return replace(channel, values=channel.values[pick], rates=_cut(channel.rates, pick), full_scale=channel.largest,
                   hats={name: hat[pick] for name, hat in channel.hats.items()})


def _temperature(entry: Temperature, pick: np.ndarray) -> Temperature:
    hats = None if entry.hats is None else entry.hats[:, pick]
    if isinstance(entry.drive, Column):
        return replace(entry, drive=_drive(entry.drive, pick))
    return replace(entry, drive=replace(entry.drive, values=entry.drive.values[pick]), hats=hats)


def _images(stack, n: int):
    return None if stack is None else LeadingFrames(stack, n)


def _cut(values: np.ndarray | None, pick: np.ndarray) -> np.ndarray | None:
    return None if values is None else values[pick]
