"""Where measured points and the mesh lie: the grid of the points, and the camera from the mesh to it.

The points of the reference stage span a grid whose unit, the "pixel" of the experiment, is the distance of neighbours;
columns run along x and rows against y. [camera] places a mesh that has axes of its own in the system of the points.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from idic.errors import InputError
from idic.experiment_file.schema.experiment_file import ExperimentFile
from idic.fe import Mesh
from idic.images import Camera
from idic.model import Depth, FieldPoints
from idic.readers import Edges, MIN_HOLE, MeasuredPoints, Placement, loops_of


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
    axes = _field_axes(config)
    if axes[0][1:] == axes[1][1:]:
        raise InputError("both axes point along the same direction", file=file, key="camera.axes",
                         expected='one along x, one along y, e.g. ["+x", "+y"]', found=str(table.axes),
                         remedy="correct one of them")
    return _camera_at(points, np.array(table.origin_mm or (0.0, 0.0)), axes, table.rotation_deg)


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
    edges = Edges.of(mesh.nodes[:, :2] @ base.T, mesh.surface_cells(config.experiment.surface))
    origin = np.full(2, np.nan) if table.origin_mm is None else np.array(table.origin_mm)
    start = Placement(origin, float(np.radians(table.rotation_deg)), 0.0)
    loops = sorted(loops_of(points.positions, points.pitch), key=lambda loop: -float(np.prod(np.ptp(loop, axis=0))))
    loops = [loop for k, loop in enumerate(loops) if k == 0 or len(loop) >= MIN_HOLE]
    try:
        placement, equivalents = edges.fitted_placement(points.positions, loops, points.pitch, start)
    except InputError as error:
        raise InputError(error.what, file=file, key=error.key, expected=error.expected, found=error.found,
                         remedy=error.remedy) from None
    degrees = float(np.degrees((placement.angle + np.pi) % (2.0 * np.pi) - np.pi))
    note = (f"the mesh is laid along the outline of the points: origin_mm = [{placement.origin[0]:.3f}, "
            f"{placement.origin[1]:.3f}], "
            f"rotation_deg = {degrees:.3f}; the points end {placement.margin:.2g} mm before its edges, "
            f"{np.sqrt(placement.cost):.2g} mm rms off that; {100 * placement.on_edges:.0f} % of the outline are along "
            f"edges")
    if equivalents:
        turns = ", ".join(f"{np.degrees(equivalent.angle - placement.angle) % 360.0:.0f}°"
                          for equivalent in equivalents)
        note += (f". The mesh is symmetric: turned by {turns} it fits equally well. The smallest rotation from "
                 "rotation_deg is used; another matters only for sets, loads and material directions that are less "
                 "symmetric")
    return _camera_at(points, placement.origin, _field_axes(config), degrees), note


def _field_axes(config: ExperimentFile) -> list[str]:
    """Where the axes of the mesh point, in columns and rows of the grid of the points."""
    names = {"+x": "+col", "-x": "-col", "+y": "-row", "-y": "+row"}
    return [names.get(axis, axis) for axis in (config.camera and config.camera.axes) or ("+x", "+y")]


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
