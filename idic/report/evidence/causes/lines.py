"""Lines of experiment.toml that a remedy may name, each for the kinds of experiments that can have it."""

from __future__ import annotations

import json
from collections.abc import Sequence

import numpy as np

from idic.images import Camera
from idic.model import Column, Experiment, Measured, Remedies
from idic.report.evidence.causes.evidence import Line

AXIS_NAMES = {(1, 0): "+col", (-1, 0): "-col", (0, 1): "+row", (0, -1): "-row"}
AXIS_NAMES_OF_FIELDS = {(1, 0): "+x", (-1, 0): "-x", (0, -1): "+y", (0, 1): "-y"}


def free_rigid_motion(experiment: Experiment) -> tuple[Line, ...]:
    """A rigid motion of every frame as an unknown; () where there is one already, or none can be."""
    model, recording = experiment.model, experiment.recording
    if recording.quantity == "height" or model.is_section:
        return ()
    measured = any(isinstance(entry.drive, Measured) for entry in model.prescribed)
    if recording.points is not None and (measured or recording.points.free_rigid):
        return ()  # a measured side moves with the specimen already
    return () if moves_freely(experiment) else (Line("camera", "motion", '"free"'),)


def excluded_frames(experiment: Experiment, frames: Sequence[int]) -> tuple[Line, ...]:
    """Frames to leave out, with those that are left out already; () where no two would remain."""
    names = Remedies(experiment).exclusion(frames)
    return (Line("experiment", "exclude_frames", names),) if names else ()


def other_axes(experiment: Experiment, change: np.ndarray) -> tuple[Line, ...]:
    """``axes`` after a turn or mirror image of the picture; () where the camera has none (a lens, a matrix of its own).

    change : (2, 2) of signs
    """
    camera = experiment.model.camera
    if not isinstance(camera, Camera) or not Remedies(experiment).can_have("axes"):
        return ()
    columns = np.rint((change @ camera.matrix / camera_scale(camera)).T).astype(int)
    names = AXIS_NAMES if experiment.recording.points is None else AXIS_NAMES_OF_FIELDS
    axes = [names.get((int(column[0]), int(column[1]))) for column in columns]
    return () if None in axes else (Line("camera", "axes", json.dumps(axes)),)


def camera_scale(camera: Camera) -> float:
    """px per mm."""
    return float(np.sqrt(abs(np.linalg.det(camera.matrix))))


def time_offset(experiment: Experiment) -> tuple[Line, ...]:
    """An offset between the clocks of images and log as an unknown; () where the log has no times of its own."""
    model = experiment.model
    drives = [*(entry.drive for entry in model.prescribed), *(load.drive for load in model.loads)]
    has_rates = any(getattr(drive, "rates", None) is not None for drive in drives)
    return (Line("dof", "time.offset"),) if has_rates and "time.offset" not in model.parameters.free else ()


def logged_motions(experiment: Experiment) -> list[Column]:
    """The logged columns that move the model."""
    return [entry.drive for entry in experiment.model.prescribed if isinstance(entry.drive, Column)]


def moves_freely(experiment: Experiment) -> bool:
    """Whether the camera has a rigid motion of its own in every frame."""
    motion = getattr(experiment.model.camera, "motion", None)
    return motion is not None and any("_at[" in name for name in motion.names)
