"""[experiment] fields: the displacements that another DIC system exported, in the place of images.

The points of the reference stage span a grid whose unit, the "pixel" of the experiment, is the distance of neighbours;
columns run along x and rows against y. [camera] places a mesh that has axes of its own in the system of the points.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from idic.errors import InputError
from idic.experiment_file.schema import ExperimentFile
from idic.experiment_file.schema_experiment import ExperimentTable, StagesTable
from idic.fe.mesh.mesh import Mesh, surface_cells
from idic.images.camera import Camera
from idic.images.quality.field_noise import FieldNoise, field_noise
from idic.model.experiment import CorrelatedNoise, Depth, FieldPoints, Noise
from idic.readers.fields.bending import ALLOWED_SHARE, largest_bending
from idic.readers.fields.chosen_stages import StageRule, chosen_stages
from idic.readers.fields.flattened import Flattening
from idic.readers.fields.outline import MIN_HOLE, loops_of
from idic.readers.fields.placement import Edges, Placement, fitted_placement
from idic.readers.fields.plane import largest_change, out_of_plane
from idic.readers.fields.series import (
    UM_PER_MM, FieldSeries, FieldStack, MeasuredPoints, measured_points, open_fields,
)
from idic.readers.paths import matching_files

MIN_TOLD_BENDING = 0.005  # of the mean strain
MIN_TOLD_CURVATURE_STRAIN = 2e-5  # of a surface by bending, half a thickness away from the middle


def open_series(config: ExperimentFile, folder: Path, file: Path) -> FieldSeries:
    """All stages of the experiment."""
    table = config.experiment
    paths = matching_files(folder, table.fields, file=file, key="experiment.fields")
    pixel_size = config.camera.pixel_size_mm if config.camera else None
    return open_fields(paths, table.fields_format, table.fields_unit, pixel_size)


def stack_of(series: FieldSeries, references: Sequence[int], table: ExperimentTable) -> FieldStack:
    """The displacements since the mean of the reference stages; of a sheet those of its middle, laid flat. Of a solid
    and of a sheet of known thickness also that along the normal of the points."""
    points = measured_points(series, references)
    if points.heights is None:
        return FieldStack(series, points)
    if table.kind == "solid":
        return FieldStack(series, points, 3)
    half = table.thickness_mm if table.kind == "plane_stress" else None  # a cut in plane strain does not bend
    toward = _side(table) * (half or 0.0)
    return FieldStack(series, points, 3 if half else 2, Flattening.of(points.positions, points.heights, toward))


def _side(table: ExperimentTable) -> int:
    return 1 if table.fields_seen_from == "+z" else -1


def kept_stages(table: StagesTable, stack: FieldStack, references: Sequence[int],
                excluded: Sequence[int]) -> tuple[tuple[int, ...], str]:
    """The stages that the rule of `experiment.stages` keeps, and the rule in words."""
    rule = StageRule(table.every_strain, table.every_change_um, table.every_time_s, table.max)
    kept = chosen_stages(stack.series, stack.points, rule, references, excluded)
    return kept, (f"{len(kept)} of {len(stack.series.entries)} stages are compared, {rule.words}; the reference and "
                  f"the "
                  "last stage are among them (stages in [experiment])")


def grid_of(points: MeasuredPoints, subset_mm: float = 0.0, free_rigid: bool = False,
            depth: Depth | None = None) -> FieldPoints:
    """The points on their grid: the first column at the smallest x, the first row at the largest y."""
    px = (points.positions - _corner(points)) / points.pitch * [1.0, -1.0]
    nx, ny = (np.rint(px.max(axis=0)).astype(int) + 1).tolist()  # a point lies in the nearest place
    return FieldPoints(px, (ny, nx), points.pitch, subset_mm / points.pitch, free_rigid, depth)


def _corner(points: MeasuredPoints) -> np.ndarray:
    return np.array([points.positions[:, 0].min(), points.positions[:, 1].max()])


def field_camera(config: ExperimentFile, points: MeasuredPoints, file: Path) -> Camera:
    """From a point of the mesh (mm) to the grid of the points.

    Without [camera] the mesh has the axes of the points. ``origin_mm`` is where the origin of the mesh lies in them,
    ``axes`` and ``rotation_deg`` how its axes point: "+x", "-y" …

    Raises
    ------
    InputError
        [camera] holds keys that belong to images.
    """
    table, corner = config.camera, _corner(points)
    if table is None:
        return Camera.from_table(points.pitch, -corner / points.pitch * [1.0, -1.0], ("+col", "-row"))
    for key in ("origin_px", "matrix_px_per_unit", "noise_std_gv", "centre_px", "magnification_column"):
        if getattr(table, key) is not None:
            raise InputError("a key of images next to fields", file=file, key=f"camera.{key}",
                             expected="origin_mm, axes, rotation_deg, and pixel_size_mm for fields in px", found=key,
                             remedy="leave it out; fields_noise_um gives the noise of fields")
    wanted = _field_axes(config)
    if wanted[0][1:] == wanted[1][1:]:
        raise InputError("both axes point along the same direction", file=file, key="camera.axes",
                         expected='one along x, one along y, e.g. ["+x", "+y"]', found=str(table.axes),
                         remedy="correct one of them")
    return _camera_at(points, np.array(table.origin_mm or (0.0, 0.0)), wanted, table.rotation_deg)


def _camera_at(points: MeasuredPoints, origin_mm: np.ndarray, axes: Sequence[str], rotation_deg: float) -> Camera:
    return Camera.from_table(points.pitch, (origin_mm - _corner(points)) / points.pitch * [1.0, -1.0], axes,
                             rotation_deg)


def laid_on_outline(config: ExperimentFile, points: MeasuredPoints, mesh: Mesh, camera: Camera,
                    file: Path) -> tuple[Camera, str]:
    """The camera of a mesh that is laid along the outline of the points, ``[camera] placement = "outline"``, and a
    note.

    camera : as the table gives it: axes of the mesh, and its turn, or its place too, where several placements fit
    """
    table = config.camera
    assert table is not None
    base = Camera.from_table(points.pitch, (0.0, 0.0), _field_axes(config)).matrix * points.pitch * [[1.0], [-1.0]]
    edges = Edges.of(mesh.nodes[:, :2] @ base.T, surface_cells(mesh, config.experiment.surface))
    origin = np.full(2, np.nan) if table.origin_mm is None else np.array(table.origin_mm)
    near = Placement(origin, float(np.radians(table.rotation_deg)), 0.0)
    loops = sorted(loops_of(points.positions, points.pitch), key=lambda loop: -float(np.prod(np.ptp(loop, axis=0))))
    loops = [loop for k, loop in enumerate(loops) if k == 0 or len(loop) >= MIN_HOLE]
    try:
        found, others = fitted_placement(edges, points.positions, loops, points.pitch, near)
    except InputError as error:
        raise InputError(error.what, file=file, key=error.key, expected=error.expected, found=error.found,
                         remedy=error.remedy) from None
    degrees = float(np.degrees((found.angle + np.pi) % (2.0 * np.pi) - np.pi))
    note = (f"the mesh is laid along the outline of the points: origin_mm = [{found.origin[0]:.3f}, "
            f"{found.origin[1]:.3f}], "
            f"rotation_deg = {degrees:.3f}; the points end {found.margin:.2g} mm before its edges, "
            f"{np.sqrt(found.cost):.2g} mm rms off that; {100 * found.on_edges:.0f} % of the outline are along "
            f"edges")
    if others:
        turns = ", ".join(f"{np.degrees(one.angle - found.angle) % 360.0:.0f}°" for one in others)
        note += (f". The mesh is symmetric: turned by {turns} it fits equally well. The smallest rotation from "
                 "rotation_deg is used; another matters only for sets, loads and material directions that are less "
                 "symmetric")
    return _camera_at(points, found.origin, _field_axes(config), degrees), note


def _field_axes(config: ExperimentFile) -> list[str]:
    """Where the axes of the mesh point, in columns and rows of the grid of the points."""
    names = {"+x": "+col", "-x": "-col", "+y": "-row", "-y": "+row"}
    return [names.get(axis, axis) for axis in (config.camera and config.camera.axes) or ("+x", "+y")]


def depth_of(config: ExperimentFile, points: MeasuredPoints, free_rigid: bool) -> Depth | None:
    """How the displacement out of the plane is compared: on a solid, or on a sheet of known thickness, that was
    measured in three coordinates.

    Sides that move as the fields show do not hold the specimen out of its plane: then, and with ``motion = "free"``,
    every stage has an offset and two tilts of its own. A sheet bends in every stage as it likes.

    Raises
    ------
    InputError
        The change of thickness is asked for where nothing shows it.
    """
    table = config.experiment
    sheet = table.kind == "plane_stress" and table.thickness_mm is not None and config.solver is None
    if table.fields_thickness_change and (points.plane is None or not sheet):
        raise InputError("the change of thickness cannot be compared", key="experiment.fields_thickness_change",
                         expected="points of three coordinates, a sheet in plane stress, its thickness_mm, and the "
                         "built-in solver", found="points of two coordinates" if points.plane is None else
                         f"kind = {table.kind!r}" if table.kind != "plane_stress" else "no thickness_mm"
                         if table.thickness_mm is None else "[solver]", remedy="leave it out")
    if points.plane is None:
        return None
    if sheet and table.fields_thickness_change is not False:
        return Depth(side=_side(table))
    if table.kind != "solid":
        return None
    measured = any(drive is not None and drive.measured is not None for table in config.boundary
                   for drive in (table.u, table.ux, table.uy))
    return Depth(free=free_rigid or measured)


def rigid_is_free(config: ExperimentFile, file: Path) -> bool:
    """Whether every stage has a rigid motion of its own: ``[camera] motion = "free"``.

    Raises
    ------
    InputError
        A side is measured, whose motion holds that of the whole specimen.
    """
    if config.camera is None or config.camera.motion != "free":
        return False
    measured = next((table.nodes for table in config.boundary
                     for drive in (table.u, table.ux, table.uy, table.uz)
                     if drive is not None and drive.measured is not None), None)
    if measured is not None:
        raise InputError("a free rigid motion next to a measured side", file=file, key="camera.motion",
                         expected="sides that are fixed, or driven by the log",
                         found=f'the motion of {measured} is measured',
                         remedy="leave motion out: measured sides move with the specimen already")
    return True


def noise_of_fields(config: ExperimentFile, stack: FieldStack, points: FieldPoints, frames: Sequence[int],
                    reference: int, n_references: int, file: Path) -> Noise:
    """The noise of a point and its correlation: from the stages (`idic.images.quality.field_noise`), the size as given.

    Raises
    ------
    InputError
        The noise is neither given nor visible in the stages.
    """
    given = config.experiment.fields_noise_um
    found = _noise_seen(stack, points, frames, reference, n_references, (0, 1))
    if found is None:
        if given is None:
            raise InputError("the noise of the fields is not known", file=file, key="experiment.fields_noise_um",
                             expected="its standard deviation in µm, or three stages or more that show it",
                             found=f"{len(frames)} stages", remedy="give it: two stages at rest show it")
        return Noise(given, "given")
    std = found.std if given is None else given
    rows = tuple(tuple(float(value) for value in row) for row in found.correlation)
    return Noise(std, "stage_differences" if given is None else "given",
                 correlated=CorrelatedNoise(std, std * found.sum_std / found.std, rows, std))


def with_depth(points: FieldPoints, noise: Noise, stack: FieldStack, frames: Sequence[int], reference: int,
               n_references: int, asked: bool = True, thickness: float | None = None) -> tuple[FieldPoints, str]:
    """The points with the weight of the rows along the normal by their own noise, and a note.

    asked : False: of a sheet of this thickness (mm), only where its change can exceed that noise.

    The rows are weighed so that sums over many points scatter as those in the plane do; the correlation of neighbours
    is taken to be that in the plane. Where the stages do not show the noise, it is that in the plane.
    """
    assert points.depth is not None
    plane, own = noise.correlated, _noise_seen(stack, points, frames, reference, n_references, (2,))
    said = "" if not points.depth.free else "; an offset and two tilts of every stage are its own"
    if points.depth.side:
        most, std = _largest_change(stack, frames, thickness or 0.0), noise.std_gv if own is None else own.std
        said = (f"; of a sheet it is the change of thickness, up to {most:.2g} µm rms here; every stage bends by a "
                "polynomial of the third degree of its own")
        if not asked and most < (std or 0.0):
            return replace(points, depth=None), (
                f"the change of thickness moves the seen side by {most:.2g} µm rms at most, less than the noise along "
                f"the normal ({std:.2g} µm per point): it is not compared (fields_thickness_change = true compares it)")
    if own is None or plane is None:
        return replace(points, depth=replace(points.depth, std_um=noise.std_gv)), (
            "the displacement out of the plane is compared too, with the noise of the others" + said)
    weight = plane.sum_std_gv / own.sum_std
    gain = (weight * own.std / plane.recorded_gv) ** 2
    return replace(points, depth=replace(points.depth, weight=weight, noise_gain=gain, std_um=own.std)), (
        f"the displacement out of the plane is compared too; its noise is {own.std:.3g} µm per point{said}")


def _largest_change(stack: FieldStack, frames: Sequence[int], thickness: float) -> float:
    """What the last stage and the middle one can show of a change of thickness  # µm, rms over the points"""
    at = stack.points.positions
    looked = {frames[-1], frames[len(frames) // 2]}
    moved = (stack.frame(k)[:, :2].astype(float) * [1.0, -1.0] / UM_PER_MM for k in looked)
    return max(UM_PER_MM * largest_change(at, one, 0.5 * thickness) for one in moved)


def _noise_seen(stack: FieldStack, points: FieldPoints, frames: Sequence[int], reference: int, n_references: int,
                components: tuple[int, ...]) -> FieldNoise | None:
    files = tuple((entry.path, entry.number, entry.path.stat().st_mtime_ns) for entry in stack.entries)
    key = (files, stack.series.mm_per_unit, tuple(frames), reference, n_references, len(stack.points), components)
    return _seen_noise(_Recording(key, stack, points.positions_px))


@dataclass(frozen=True)
class _Components:
    """Some components of the displacement, as a stack of their own."""

    stack: FieldStack
    components: tuple[int, ...]

    def frame(self, k: int) -> np.ndarray:
        return self.stack.frame(k)[:, list(self.components)]


@dataclass(frozen=True)
class _Recording:
    """Stages, and all that tells them from others: files, their age, unit, frames, references, components."""

    key: tuple
    stack: FieldStack = field(compare=False)
    positions_px: np.ndarray = field(compare=False)


@lru_cache(maxsize=4)  # one command opens an experiment several times
def _seen_noise(recording: _Recording) -> FieldNoise | None:
    _, _, frames, reference, n_references, _, components = recording.key
    stack = _Components(recording.stack, components)
    return field_noise(stack, recording.positions_px, frames, reference, n_references)


def field_notes(stack: FieldStack, grid: FieldPoints, stages: Sequence[int],
                thickness: float | None) -> list[str]:
    """What a user should know of the fields: format, points, and motion out of the plane at the last of the stages."""
    series, points, last = stack.series, stack.points, stages[-1]
    extent = np.ptp(points.positions, axis=0)
    notes = [f"fields: {len(series.entries)} stages in the format {series.format}; {len(points)} points over "
             f"{extent[0]:.3g} x {extent[1]:.3g} mm, {grid.pitch_mm:.3g} mm apart; positions are those of the plane of "
             "the points" + (f", from which they lie {points.plane.flatness_mm:.2g} mm (rms)" if points.plane else "")]
    if points.plane is None:
        return notes
    moved = points.moved(series.stage(last))
    found = out_of_plane(points.positions, moved[:, 2])
    if found is None:
        return notes
    text = (f"out of the plane, at {series.labels[last]}: {found.rms_mm:.2g} mm rms, tilt "
            f"{np.degrees(np.hypot(*found.tilt)):.2g}°, curvature {1e3 * found.curvature:.2g} 1/m")
    if grid.depth is not None and not grid.depth.side:
        return [*notes, text]
    bending = 0.5 * found.curvature * (thickness or 0.0)
    text += ("; the plane model is compared with the mid-plane of the sheet, flattened: tilt, arcs"
             + (f" and the strain of bending at the surface ({bending:.1e})" if bending > MIN_TOLD_CURVATURE_STRAIN
                else " and bending" if thickness else "") + " are removed from the in-plane motion")
    if not thickness and 0.5 * found.curvature > MIN_TOLD_CURVATURE_STRAIN:
        text += "; with thickness_mm the strain of bending at the surface would be, too"
    most = largest_bending(stack, stages, thickness) if thickness else None
    if most is None or most.share < MIN_TOLD_BENDING:
        return [*notes, text]
    if most.share <= ALLOWED_SHARE:
        return [*notes, f"{text}. Bending is at most {100 * most.share:.2g} % of the mean strain"]
    return [*notes, f"{text}. At {series.labels[most.stage]} bending is {100 * most.share:.2g} % of the mean strain "
                    f"({most.strain:.1e}; a tension test allows 10 %): the grips may not be in line, or the sheet was "
                    "not flat"]
