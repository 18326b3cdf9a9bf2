"""An experiment as if it had ended earlier: only its first frames, in the images and in every record beside them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from idic.errors import InputError
from idic.experiment import Channel, Column, Experiment, FurtherCamera, Parametrised, Temperature
from idic.images.stack_views import LeadingFrames


def leading_frames(experiment: Experiment, n_frames: int) -> Experiment:
    """The experiment up to frame ``n_frames - 1``; later frames are neither simulated nor correlated.

    A window that grows with the test tells when a model begins to fail, and starts a search that would get lost in the
    whole of it. (`Experiment.excluded` leaves single frames out of the comparison only.)

    Raises
    ------
    InputError
        If nothing after the reference frame would be left.
    """
    last = experiment.n_frames
    if not experiment.reference + 2 <= n_frames <= last:
        raise InputError("a window of frames outside the test", key="n_frames",
                         expected=f"{experiment.reference + 2} to {last} frames", found=f"{n_frames}",
                         remedy="keep the reference and at least one frame after it")
    if n_frames == last:
        return experiment
    return replace(
        experiment, times=experiment.times[:n_frames], labels=experiment.labels[:n_frames],
        stack=_images(experiment.stack, n_frames),
        excluded=tuple(k for k in experiment.excluded if k < n_frames),
        prescribed=tuple(replace(p, drive=_drive(p.drive, n_frames)) for p in experiment.prescribed),
        loads=tuple(replace(load, drive=_drive(load.drive, n_frames)) for load in experiment.loads),
        channels=tuple(_channel(channel, n_frames) for channel in experiment.channels),
        temperatures=tuple(_temperature(entry, n_frames) for entry in experiment.temperatures),
        cameras=tuple(_camera(camera, n_frames) for camera in experiment.cameras))


def _drive(drive, n: int):
    if isinstance(drive, Column):
        return replace(drive, values=drive.values[:n], rates=_cut(drive.rates, n))
    if isinstance(drive, Parametrised):
        return replace(drive, courses=_cut(drive.courses, n))
    return drive


def _channel(channel: Channel, n: int) -> Channel:
    return replace(channel, values=channel.values[:n], rates=_cut(channel.rates, n))


def _temperature(entry: Temperature, n: int) -> Temperature:
    if isinstance(entry.drive, Column):
        return replace(entry, drive=_drive(entry.drive, n))
    return replace(entry, drive=replace(entry.drive, values=entry.drive.values[:n]))


def _camera(camera: FurtherCamera, n: int) -> FurtherCamera:
    return replace(camera, stack=_images(camera.stack, n), labels=camera.labels[:n])


def _images(stack, n: int):
    return None if stack is None else LeadingFrames(stack, n)


def _cut(values: np.ndarray | None, n: int) -> np.ndarray | None:
    return None if values is None else values[:n]
