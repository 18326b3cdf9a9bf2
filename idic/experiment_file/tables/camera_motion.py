"""Motions of a camera during the test, or of the specimen before cameras with a lens: names, courses and parameters.

`idic.images.camera_motion` has the first, `idic.images.rigid_motion` the second kind.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from idic.errors import InputError
from idic.experiment_file.schema.cameras import CameraTable
from idic.images import (
    AnyCamera, CameraMotion, PLACEMENT_STEM, PlacedCamera, RIGID, RigidMotion, SCANNER, Scanner, ScannerMotion,
)
from idic.model import FurtherCamera, hats, knot_frames, knot_name
from idic.parameters import Parameter

DRIFT, LOAD = "magnification_drift", "magnification_load"
MAGNIFICATION = "magnification"
_AT = {"col_at": "column", "row_at": "row", "turn_at": "turn"}


def moving_camera(camera: AnyCamera, table: CameraTable | None, context, times: np.ndarray | None,
                  compared: Sequence[int], ends: np.ndarray | None = None,
                  thickness: float | None = None) -> AnyCamera:
    """The camera with all its motions, every amplitude zero.

    context : `idic.experiment_file.tables.boundaries.Context`; times : (n_frames,) s, None where none are known;
    compared : frames that show a motion of their own; ends : (2, 2) mm, lowest and highest x and y of a sheet, None
    where the body is none; thickness : mm

    Raises
    ------
    InputError
        The log lacks a column, or a body that is no sheet bends as one.
    """
    if isinstance(camera, PlacedCamera):
        return replace(camera, motion=_rigid_motion(table, context, times, compared))
    if isinstance(camera, Scanner):
        return replace(camera, motion=_scanner_motion(context, times, compared))
    courses: dict[str, tuple[str, np.ndarray]] = {}
    if times is not None and len(times) > 1:
        courses[DRIFT] = (MAGNIFICATION, times - times[context.reference])
    if table is not None and table.magnification_column is not None:
        courses[LOAD] = (MAGNIFICATION, _column("magnification_column", table.magnification_column, context))
    if table is not None and table.magnification_knots is not None:
        courses |= _knots(MAGNIFICATION, table.magnification_knots, context, times)
    if table is not None and table.deflections is not None:
        courses |= _deflections(table, context, times, ends)
    if table is not None and table.motion == "free":
        for frame in compared:
            at = (np.arange(context.n_frames) == frame).astype(float)
            courses |= {f"{stem}[{frame}]": (kind, at) for stem, kind in _AT.items()}
    if not courses:
        return camera
    return replace(camera, motion=CameraMotion(tuple(courses), tuple(kind for kind, _ in courses.values()),
                                               np.array([course for _, course in courses.values()]),
                                               np.zeros(len(courses)), ends, _lever(table, thickness)))


def _lever(table: CameraTable | None, thickness: float | None) -> float:
    """Distance of the camera times half the thickness, mm^2; 0 where either is unknown."""
    return 0.0 if table is None else 0.5 * (table.distance_mm or 0.0) * (thickness or 0.0)


def _knots(kind: str, knots: int, context, times: np.ndarray | None) -> dict[str, tuple[str, np.ndarray]]:
    frames = knot_frames(context.n_frames, context.reference, knots)
    at = np.arange(context.n_frames, dtype=float) if times is None else times
    return {knot_name(kind, frame): (kind, hat)
            for frame, hat in zip(frames, hats(at, context.reference, frames), strict=True)}


def _deflections(table: CameraTable, context, times: np.ndarray | None,
                 ends: np.ndarray | None) -> dict[str, tuple[str, np.ndarray]]:
    """Names, shapes and courses of the deflections of a sheet."""
    key = "camera.deflections"
    if ends is None:
        raise InputError("deflections of a body that is no sheet in grey images", file=context.file, key=key,
                         expected='kind = "plane_stress" or "plane_strain", seen face on',
                         found="another body, or fields", remedy="leave deflections out")
    courses: dict[str, tuple[str, np.ndarray]] = {}
    for number, entry in enumerate(table.deflections or ()):
        if entry.knots is not None:
            of_entry = _knots(entry.shape, entry.knots, context, times)
        elif entry.column is not None:
            name = f"deflections[{number}].column"
            of_entry = {f"{entry.shape}_load": (entry.shape, _column(name, entry.column, context))}
        elif times is not None and len(times) > 1:
            of_entry = {f"{entry.shape}_drift": (entry.shape, times - times[context.reference])}
        else:
            raise InputError("a deflection that grows with time, without times", file=context.file,
                             key=f"{key}[{number}]", expected="times of the frames, column or knots", found="neither",
                             remedy="give frame_interval_s, or name a column of the log")
        if set(of_entry) & set(courses):
            raise InputError("a deflection is given twice", file=context.file, key=f"{key}[{number}]",
                             expected="every shape once per kind of course", found=entry.shape,
                             remedy="leave one of them out")
        courses |= of_entry
    return courses


def _rigid_motion(table: CameraTable, context, times: np.ndarray | None,
                  compared: Sequence[int]) -> RigidMotion | None:
    """Every motion of the specimen as a rigid body that is known by name, every amplitude zero."""
    courses: dict[str, tuple[str, np.ndarray]] = {}
    for kind in RIGID:
        if times is not None and len(times) > 1:
            courses[f"{kind}_drift"] = (kind, times - times[context.reference])
        if table.motion_column is not None:
            courses[f"{kind}_load"] = (kind, _column("motion_column", table.motion_column, context))
    if table.motion == "free":
        for frame in compared:
            at = (np.arange(context.n_frames) == frame).astype(float)
            courses |= {f"{kind}_at[{frame}]": (kind, at) for kind in RIGID}
    if not courses:
        return None
    return RigidMotion(tuple(courses), tuple(kind for kind, _ in courses.values()),
                       np.array([course for _, course in courses.values()]), np.zeros(len(courses)))


def _scanner_motion(context, times: np.ndarray | None, compared: Sequence[int]) -> ScannerMotion:
    """Rigid motion and magnification of the scans: a drift in time, and of every scan alone; every amplitude zero."""
    courses: dict[str, tuple[str, np.ndarray]] = {}
    for kind in ScannerMotion.units:
        if times is not None and len(times) > 1:
            courses[f"{kind}_drift"] = (kind, times - times[context.reference])
        for frame in compared:  # of the magnification a knot in every scan
            name = knot_name(kind, frame) if kind == MAGNIFICATION else f"{kind}_at[{frame}]"
            courses[name] = (kind, (np.arange(context.n_frames) == frame).astype(float))
    return ScannerMotion(tuple(courses), tuple(kind for kind, _ in courses.values()),
                         np.array([course for _, course in courses.values()]), np.zeros(len(courses)))


def scanner_parameters(scanner: Scanner, shape: tuple[int, ...], is_free: bool) -> list[Parameter]:
    """The amplitudes of the drift; a unit of their scale moves a corner of the volume by three voxels.

    is_free : the rigid motion of every scan is identified
    """
    motion, parameters = scanner.motion, []
    if motion is None:
        return []
    half_mm = 0.5 * float(np.linalg.norm(np.array(shape)[::-1] * scanner.voxel_mm))
    for name, kind, course in zip(motion.names, motion.kinds, motion.courses, strict=True):
        unit = motion.units[kind]
        reach = {"deg": np.radians(half_mm), "": half_mm, "mm": 1.0}[unit] / scanner.pixel_size
        if name.endswith("_drift"):
            unit += "/s" if unit else "1/s"
        parameters.append(Parameter(f"{SCANNER}.{name}", 0.0, unit, is_free and "[" in name and kind != MAGNIFICATION,
                                    scale=3.0 / (float(reach * np.abs(course).max()) or 1.0)))
    return parameters


def rigid_parameters(camera: PlacedCamera, scales: Mapping[str, float]) -> list[Parameter]:
    """The amplitudes of the rigid motion as degrees of freedom; scales : of the six numbers, deg and mm."""
    motion, parameters = camera.motion, []
    if motion is None:
        return []
    for name, kind, course in zip(motion.names, motion.kinds, motion.courses, strict=True):
        unit = motion.units[kind] + ("/s" if name.endswith("_drift") else "")
        parameters.append(Parameter(f"{PLACEMENT_STEM}.{name}", 0.0, unit, "[" in name,
                                    scale=scales[kind] / (float(np.abs(course).max()) or 1.0)))
    return parameters


def motion_parameters(stem: str, camera: AnyCamera, image_shape) -> list[Parameter]:
    """The amplitudes as degrees of freedom; a unit of their scale moves a corner of the image by three pixels."""
    if camera.motion is None or isinstance(camera, PlacedCamera | Scanner):
        return []
    half, parameters = 0.5 * float(np.hypot(*image_shape)), []
    for name, kind, course in zip(camera.motion.names, camera.motion.kinds, camera.motion.courses, strict=True):
        bends = kind in CameraMotion.shapes
        reach = {"turn": float(np.radians(half)), "column": 1.0, "row": 1.0}.get(kind, half)
        unit = camera.motion.units[kind] if "_at[" in name else "1/s" if name.endswith("_drift") else ""
        parameters.append(Parameter(f"{stem}.{name}", 0.0, unit, "[" in name or bends,
                                    scale=3.0 / (reach * float(np.abs(course).max()) or 1.0)))
    return parameters


def with_identified_motions(camera: AnyCamera, cameras: tuple[FurtherCamera, ...], table: CameraTable | None,
                            parameters: Sequence[Parameter]) -> tuple[AnyCamera, tuple[FurtherCamera, ...]]:
    """The main and further cameras; only motions that are parameters are kept."""
    values = {parameter.name: parameter.value for parameter in parameters}
    stem = SCANNER if isinstance(camera, Scanner) else "camera" if table is None else table.name
    main = _identified(camera, stem, values)
    return main, tuple(replace(entry, camera=_identified(entry.camera, entry.name, values)) for entry in cameras)


def _identified(camera: AnyCamera, stem: str, values: Mapping[str, float]) -> AnyCamera:
    motion, stem = camera.motion, PLACEMENT_STEM if isinstance(camera, PlacedCamera) else stem
    indices = [] if motion is None else [i for i, name in enumerate(motion.names) if f"{stem}.{name}" in values]
    if not indices:
        return replace(camera, motion=None)
    names = tuple(motion.names[i] for i in indices)
    return replace(camera, motion=replace(motion, names=names, kinds=tuple(motion.kinds[i] for i in indices),
                                          courses=motion.courses[indices],
                                          values=np.array([values[f"{stem}.{name}"] for name in names])))


def _column(name: str, column: str, context) -> np.ndarray:
    """A column of the log from the reference on, relative to its largest change  # (n_frames,)"""
    key = f"camera.{name}"
    if context.log is None:
        raise InputError("a column is named, but there is no log", file=context.file, key=key,
                         expected='loads = "loads.csv" in [experiment]',
                         found=f'column "{column}"', remedy="name the log")
    values = np.asarray(context.log.column(column, file=context.file, key=key), float)
    values = values - values[context.reference]
    return values / (np.abs(values).max() or 1.0)
