"""Motions of a camera during the test: names, courses and parameters for `idic.images.camera_motion`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from idic.errors import InputError
from idic.experiment_file.schema_cameras import CameraTable
from idic.images.camera import Camera
from idic.images.camera_motion import COLUMN, MAGNIFICATION, ROW, TURN, CameraMotion
from idic.model.experiment import FurtherCamera
from idic.parameters import Parameter

DRIFT, LOAD = "magnification_drift", "magnification_load"
_AT = {"col_at": (COLUMN, "px"), "row_at": (ROW, "px"), "turn_at": (TURN, "deg")}


def moving_camera(camera: Camera, table: CameraTable | None, context, times: np.ndarray | None) -> Camera:
    """The camera with all its motions, every amplitude zero.

    context : `idic.experiment_file.tables.boundaries.Context`; times : (n_frames,) s, None where none are known

    Raises
    ------
    InputError
        The log lacks the magnification column.
    """
    courses: dict[str, tuple[str, np.ndarray]] = {}
    if times is not None and len(times) > 1:
        courses[DRIFT] = (MAGNIFICATION, times - times[context.reference])
    if table is not None and table.magnification_column is not None:
        courses[LOAD] = (MAGNIFICATION, _column(table, context))
    if table is not None and table.motion == "free":
        for frame in range(context.n_frames):
            if frame != context.reference:
                at = (np.arange(context.n_frames) == frame).astype(float)
                courses |= {f"{stem}[{frame}]": (kind, at) for stem, (kind, _) in _AT.items()}
    if not courses:
        return camera
    return replace(camera, motion=CameraMotion(tuple(courses), tuple(kind for kind, _ in courses.values()),
                                               np.array([course for _, course in courses.values()]),
                                               np.zeros(len(courses))))


def motion_parameters(stem: str, camera: Camera, image_shape) -> list[Parameter]:
    """The amplitudes as degrees of freedom; a unit of their scale moves a corner of the image by three pixels."""
    if camera.motion is None:
        return []
    half, made = 0.5 * float(np.hypot(*image_shape)), []
    for name, kind, course in zip(camera.motion.names, camera.motion.kinds, camera.motion.courses, strict=True):
        reach = {MAGNIFICATION: half, TURN: float(np.radians(half))}.get(kind, 1.0) * float(np.abs(course).max())
        unit = _AT[name.partition("[")[0]][1] if "[" in name else "1/s" if name == DRIFT else ""
        made.append(Parameter(f"{stem}.{name}", 0.0, unit, "[" in name, scale=3.0 / (reach or 1.0)))
    return made


def with_identified_motions(camera: Camera, others: tuple[FurtherCamera, ...], table: CameraTable | None,
                            parameters: Sequence[Parameter]) -> tuple[Camera, tuple[FurtherCamera, ...]]:
    """The main and further cameras; only motions that are parameters are kept."""
    values = {parameter.name: parameter.value for parameter in parameters}
    main = _identified(camera, "camera" if table is None else table.name, values)
    return main, tuple(replace(other, camera=_identified(other.camera, other.name, values)) for other in others)


def _identified(camera: Camera, stem: str, values: Mapping[str, float]) -> Camera:
    motion = camera.motion
    kept = [] if motion is None else [i for i, name in enumerate(motion.names) if f"{stem}.{name}" in values]
    if not kept:
        return replace(camera, motion=None)
    names = tuple(motion.names[i] for i in kept)
    return replace(camera, motion=CameraMotion(names, tuple(motion.kinds[i] for i in kept), motion.courses[kept],
                                               np.array([values[f"{stem}.{name}"] for name in names])))


def _column(table: CameraTable, context) -> np.ndarray:
    """A column of the log from the reference on, relative to its largest change  # (n_frames,)"""
    key = "camera.magnification_column"
    if context.log is None:
        raise InputError("a column is named, but there is no log", file=context.file, key=key,
                         expected='loads = "loads.csv" in [experiment]',
                         found=f'column "{table.magnification_column}"', remedy="name the log")
    values = np.asarray(context.log.column(table.magnification_column, file=context.file, key=key), float)
    values = values - values[context.reference]
    return values / (np.abs(values).max() or 1.0)
