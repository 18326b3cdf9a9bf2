"""Converts temperatures of [[boundary]] into records: logged columns, assumed courses, infrared images on the nodes.

``temperature = { column = "temperature_C", nodes = "ALL" }`` or ``{ images = "infrared/*.tif", unit = "C" }``: one
image per frame, ``T = scale * value + offset``, seen by the camera of the experiment or with ``matrix_px_per_unit`` and
``origin_px`` of its own. The logged motion of the boundaries moves the mesh in the infrared images (in between:
Laplace's equation; the lateral contraction is neglected). ``{ course = [[0.0, 20.0], [600.0, 21.5]] }`` is an assumed
course over time (s).
"""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from idic.correlation import NodalField, onto_nodes
from idic.errors import InputError
from idic.experiment_file.schema.experiment_file import ExperimentFile
from idic.experiment_file.schema.boundary import TemperatureTable
from idic.experiment_file.tables.boundaries import Context, logged
from idic.experiment_file.tables.lengths import Lengths, maps_a_plane
from idic.fe import Mesh, conducted, unreached
from idic.images import Camera
from idic.laws import EXPANSION, KELVIN, REFERENCE
from idic.experiment_file.tables.corrections import free_course
from idic.model import Column, Constant, KNOTS, Prescribed, TEMPERATURE, Temperature, TemperatureField, knot_name
from idic.parameters import Parameter
from idic.readers import FileStack, factor_between, matching_files, open_stack

WARMTH_K = 100.0  # unit of a knot in the search, which leaves a direction that is worse determined than that
WHOLE = "ALL"  # the whole mesh, unless it has a set of this name


@dataclass(frozen=True)
class Body:
    """The heated body: final mesh, surface and scale, prescribed motion, times of the frames (s)."""

    mesh: Mesh
    kind: str
    surface: str | None
    scale: Lengths
    image_shape: tuple[int, int]
    prescribed: tuple[Prescribed, ...]
    times: np.ndarray


def infrared_stacks(config: ExperimentFile, folder: Path, file) -> dict[int, FileStack]:
    """The infrared images by the number of their [[boundary]]."""
    return {number: open_stack(_paths(boundary.temperature, folder, file, f"boundary[{number}].temperature"), file=file,
                               key=f"boundary[{number}].temperature.images", with_gaps=True)
            for number, boundary in enumerate(config.boundary)
            if boundary.temperature is not None and boundary.temperature.images is not None}


def temperatures(config: ExperimentFile, body: Body, context: Context, infrared: Mapping[int, FileStack],
                 parameters: list[Parameter]) -> tuple[tuple[Temperature, ...], list[str]]:
    """All temperatures of an experiment and notes on them.

    infrared : images by the number of their [[boundary]]

    Raises
    ------
    InputError
        A column is missing, number or size of the images is wrong, an image lacks the body, or ``alpha`` has no
        temperature, or a free course stands beside what it does not fit.
    """
    records, notes = [], []
    for number, boundary in enumerate(config.boundary):
        if boundary.temperature is None:
            continue
        table, key = boundary.temperature, f"boundary[{number}].temperature"
        nodes = table.nodes or boundary.nodes
        nodes = None if nodes == WHOLE and WHOLE not in body.mesh.node_sets else nodes
        read = _column if table.column is not None else _course if table.course is not None else _field
        drive, note = read(table, body, context, infrared.get(number), key)
        knots, hats = free_course(table.knots or KNOTS, context) if table.course == "free" else ((), None)
        records.append(Temperature(nodes, drive, KELVIN if _unit(table, context) == "K" else 0.0, knots, hats))
        notes.append(f"{key}: {note}")
    _check_expansion(parameters, bool(records), context.file)
    dependent = [p.name for p in parameters if p.name.endswith(f".{REFERENCE.name}")]
    _require_alone(records, dependent, context.file)
    if dependent and not records:
        raise InputError("a law depends on the temperature, which is not given", file=context.file,
                         key=f"material.{dependent[0]}",
                         expected='a [[boundary]] with temperature = { column = "temperature_C" }, '
                         "or infrared images", found="none",
                         remedy="give the temperature, or leave the temperature terms out")
    if records and not dependent and not any(p.name.endswith(f".{EXPANSION.name}") for p in parameters):
        notes.append("no material has alpha or a law that depends on the temperature, so it has no effect; write e.g.  "
                     'alpha = { value = 1e-5, unit = "1/K", identify = true }')
    return tuple(records), notes


def _require_alone(records: list[Temperature], dependent: list[str], file) -> None:
    """A free course is a change of the whole body: it neither adds to a temperature nor has a value in °C."""
    free_record = next((entry for entry in records if entry.hats is not None), None)
    if free_record is None:
        return
    if free_record.nodes is not None:
        raise InputError("a free course of the temperature of a part", file=file, key="[[boundary]] temperature",
                         expected="the temperature of the whole body", found=f"nodes = {free_record.nodes!r}",
                         remedy='write temperature = { course = "free" } in a [[boundary]] of its own, without nodes')
    if len(records) > 1:
        raise InputError("a free course next to a temperature that is given", file=file,
                         key="[[boundary]] temperature", expected='{ course = "free" } alone, or temperatures '
                         "that are given", found=f"{len(records) - 1} more", remedy="leave one or the other out")
    if dependent:
        raise InputError("a free course of the temperature where a law depends on its value", file=file,
                         key="[[boundary]] temperature", expected='the temperature in °C: { column = "temperature_C" } '
                         "or { course = [[time_s, temperature], …] }", found=f'course = "free"; {", ".join(dependent)}',
                         remedy="give the temperature, or leave the temperature terms of the law out")


def _unit(table: TemperatureTable, context: Context) -> str | None:
    """The unit that the file or the log states; None: °C"""
    if table.unit is None and table.column is not None and context.log is not None:
        return context.log.unit(table.column)
    return table.unit


def knots_of_temperature(config: ExperimentFile, context: Context, file) -> list[Parameter]:
    """Degrees of freedom of a temperature whose course the data give; one at most."""
    tables = [table.temperature for table in config.boundary
              if table.temperature is not None and table.temperature.course == "free"]
    if len(tables) > 1:
        raise InputError("two free courses of the temperature", file=file, key="[[boundary]] temperature",
                         expected="one, of the whole body", found=str(len(tables)), remedy="leave the others out")
    frames = free_course(tables[0].knots or KNOTS, context)[0] if tables else ()
    return [Parameter(knot_name(TEMPERATURE, frame), 0.0, "K", True, scale=WARMTH_K) for frame in frames]


def temperature_images(config: ExperimentFile, folder: Path, file) -> list[Path]:
    """The infrared images of an experiment, for its identity."""
    return [path for number, boundary in enumerate(config.boundary)
            if boundary.temperature is not None and boundary.temperature.images is not None
            for path in _paths(boundary.temperature, folder, file, f"boundary[{number}].temperature")]


def with_copied_images(boundary: list[Mapping], source: Path, folder: Path, file) -> list[dict]:
    """The [[boundary]] tables of another experiment in `folder`, to which the infrared images are copied."""
    tables = []
    for number, table in enumerate(boundary):
        heat = dict(table.get("temperature") or {})
        if "images" in heat:
            patterns = [heat["images"]] if isinstance(heat["images"], str) else heat["images"]
            target = folder / f"infrared_{number}"
            target.mkdir()
            for k, path in enumerate(matching_files(source, patterns, file=file, key="temperature.images")):
                shutil.copy(path, target / f"{k:04d}_{path.name}")
            heat["images"] = f"{target.name}/*"
        tables.append(dict(table) | ({"temperature": heat} if heat else {}))
    return tables


def _check_expansion(parameters: list[Parameter], warmed: bool, file) -> None:
    for parameter in parameters:
        if parameter.name.endswith(f".{EXPANSION.name}") and not warmed and (parameter.value != 0.0 or parameter.free):
            raise InputError("thermal expansion without a temperature", file=file, key=f"material.{parameter.name}",
                             expected='a [[boundary]] with temperature = { column = "temperature_C" }, or infrared '
                             "images", found="none", remedy="give the temperature, or leave alpha out")


def _column(table: TemperatureTable, body: Body, context: Context, stack: FileStack | None,
            key: str) -> tuple[Column, str]:
    values, _, rates = logged(table.column, "K", table.unit, context, f"{key}.column")
    change = values - values[context.reference]
    return (Column(table.column, values, rates=rates),
            f"{table.column} from {values.min():g} to {values.max():g}, "
            f"change since the reference {change.min():+.3g} to {change.max():+.3g} K")


def _course(table: TemperatureTable, body: Body, context: Context, stack: FileStack | None,
            key: str) -> tuple[TemperatureField, str]:
    if table.course == "free":
        return (TemperatureField(np.zeros((len(body.times), body.mesh.n_nodes)), f"{key}.course"),
                "its course is identified, alike in the whole body")
    factor = factor_between(table.unit, "K", file=context.file, key=f"{key}.unit") if table.unit else 1.0
    times, levels = np.array(table.course).T
    if context.times is None and not 0.0 <= times[0] < times[-1] <= context.n_frames - 1:
        raise InputError("a course in seconds on a test without times", file=context.file, key=f"{key}.course",
                         expected="frame_interval_s or image_times in [experiment], or a column time_s in the log",
                         found=f"a course from {times[0]:g} to {times[-1]:g} s; {context.n_frames} frames",
                         remedy="give the times of the frames")
    if times[-1] <= body.times[0] or times[0] >= body.times[-1]:
        raise InputError("the course lies before or after all images", file=context.file, key=f"{key}.course",
                         expected=f"times within {body.times[0]:.12g} … {body.times[-1]:.12g} s, those of the images",
                         found=f"a course from {times[0]:.12g} to {times[-1]:.12g} s",
                         remedy="give the course in the times of the images, those of the log")
    values = factor * np.interp(body.times, times, levels)
    change = values - values[context.reference]
    field = np.broadcast_to(values[:, None], (len(values), body.mesh.n_nodes))
    return (TemperatureField(field, f"{key}.course"),
            f"a course of {len(times)} points{'' if context.times is not None else ' over the numbers of the frames'}, "
            f"change since the reference {change.min():+.3g} to {change.max():+.3g} K")


def _paths(table: TemperatureTable, folder: Path, file, key: str) -> list[Path]:
    return matching_files(folder, table.images, file=file, key=f"{key}.images")


def _field(table: TemperatureTable, body: Body, context: Context, stack: FileStack | None,
           key: str) -> tuple[TemperatureField, str]:
    factor = factor_between(table.unit, "K", file=context.file, key=f"{key}.unit") if table.unit else 1.0
    assert stack is not None  # a table with images
    if stack.n_frames != context.n_frames:
        raise InputError("the number of infrared images differs from the number of images", file=context.file,
                         key=f"{key}.images", expected=f"{context.n_frames}, one per frame in the same order",
                         found=str(stack.n_frames),
                         remedy="name one infrared image per frame; excluded frames need one too")
    if body.surface is not None and body.kind != "solid":
        raise InputError("infrared images of a cross-section", file=context.file, key=f"{key}.images",
                         expected="a specimen that is seen face on", found=f"surface = {body.surface!r}",
                         remedy="give the temperature as a column")
    camera = _camera(table, body, stack.shape, context, key)
    images = (table.scale * np.asarray(stack.frame(k), float) + table.offset for k in range(stack.n_frames))
    motion = _logged_motion(body, context)
    try:
        field = onto_nodes(body.mesh, body.mesh.surface_cells(body.surface), camera, images, motion,
                           table.smoothing_px, table.edge_margin_px)
    except InputError as error:
        raise InputError(error.what, file=context.file, key=f"{key}.{error.key or 'images'}", expected=error.expected,
                         found=error.found, remedy=error.remedy) from None
    return (TemperatureField(factor * field.values, f"{key}.images"),
            _words(table, field, factor, context, motion, camera))


def _camera(table: TemperatureTable, body: Body, shape, context: Context, key: str) -> Camera:
    if table.matrix_px_per_unit is not None:
        matrix = np.array(table.matrix_px_per_unit) / body.scale.factor
        if not maps_a_plane(matrix):
            raise InputError("the matrix does not map a plane", file=context.file, key=f"{key}.matrix_px_per_unit",
                             expected="two directions that differ", found=str(table.matrix_px_per_unit),
                             remedy="give d column/dx, d column/dy; d row/dx, d row/dy in px per mesh unit")
        return Camera.from_matrix(matrix, table.origin_px)
    if tuple(shape) != tuple(body.image_shape):
        raise InputError("infrared images of another size without a calibration", file=context.file,
                         key=f"{key}.images",
                         expected=f"{body.image_shape[1]} x {body.image_shape[0]} px, as the images",
                         found=f"{shape[1]} x {shape[0]} px",
                         remedy="give matrix_px_per_unit and origin_px of the infrared camera")
    if not isinstance(body.scale.camera, Camera):
        raise InputError("infrared images without a calibration of their own", file=context.file, key=f"{key}.images",
                         expected="matrix_px_per_unit and origin_px of the infrared camera",
                         found="the pinhole camera of the grey images", remedy="give them")
    return body.scale.camera


def _logged_motion(body: Body, context: Context) -> np.ndarray | None:
    """Motion of the nodes from the logged boundaries, mm; None if there are none  # (n_frames, n_nodes, dim)"""
    mesh = body.mesh
    motion, has_motion = np.zeros((context.n_frames, *mesh.nodes.shape)), False
    for component in range(mesh.n_dim):
        values = np.full(motion.shape[:2], np.nan)
        for entry in body.prescribed:
            if "xyz".index(entry.component) == component and isinstance(entry.drive, (Column, Constant)):
                course = entry.drive.values if isinstance(entry.drive, Column) else entry.drive.value
                values[:, mesh.node_sets[entry.nodes]] = np.broadcast_to(course, context.n_frames)[:, None]
        if unreached(mesh, ~np.isnan(values[0])) is None:
            motion[:, :, component], has_motion = conducted(mesh, values), True
    motion[context.reference] = 0.0
    return motion if has_motion and motion.any() else None


def _words(table: TemperatureTable, field: NodalField, factor: float, context: Context, motion, camera) -> str:
    values, change = field.values * factor, (field.values - field.values[context.reference]) * factor
    parts = [f"{len(values)} infrared images, {values.min():.4g} to {values.max():.4g}, change since the reference "
             f"{change.min():+.3g} to {change.max():+.3g} K",
             f"{field.n_pixels} pixels onto {field.visible.sum()} nodes"]
    if table.noise_std is not None:  # of a change, of two images
        parts.append(f"a nodal change scatters by {np.sqrt(2) * field.noise * table.noise_std * factor:.2g} K")
    if not field.visible.all():
        n_hidden = (~field.visible).sum()
        parts.append(f"{n_hidden} nodes are not visible: their temperatures are interpolated by conduction")
    moved = 0.0 if motion is None else float(np.abs(motion).max() / camera.pixel_size)
    parts.append(f"corrected for {moved:.2g} px of logged motion; each further px of motion is an error of up to "
                 f"{field.steepest * factor:.2g} K")
    return "; ".join(parts)
