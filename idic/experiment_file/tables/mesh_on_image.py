"""``mesh = { … }``: a rectangle or a drawn outline on the image, in mm of the mesh, or around measured points."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from idic.errors import InputError
from idic.experiment_file.measured_fields.placement import grid_of
from idic.experiment_file.schema.experiment_file import ExperimentFile
from idic.experiment_file.schema.experiment import MeshTable
from idic.experiment_file.tables.extruded import extruded
from idic.experiment_file.tables.lengths import Lengths
from idic.fe import Mesh, OUTLINE
from idic.images import AnyCamera, Camera, Stack
from idic.readers import (
    Drawing, FieldStack, MeasuredPoints, PointOutline, from_image, narrowest_width, roi_mesh, sides_of_any,
)

KEY = "experiment.mesh"
NEIGHBOURS_PER_ELEMENT = 3.0  # side of an element of a mesh around the points, where none is given


def mesh_on_image(config: ExperimentFile, scale: Lengths, stack: Stack, file: Path) -> tuple[Mesh, list[str]]:
    """The mesh of linear elements in mm that the table describes, and notes.

    Raises
    ------
    InputError
        The table does not suit the kind of the model, the frames or the scale, or the drawing cannot be meshed.
    """
    table, fields = config.experiment.mesh, isinstance(stack, FieldStack)
    if fields and table.in_px:
        raise InputError("a mesh in px on measured fields", file=file, key=KEY,
                         expected="around_points_mm, outline_points_mm, roi_mm, outline_mm or a mesh file",
                         found="roi_px" if table.outline_px is None else "outline_px",
                         remedy="write mesh = { around_points_mm = 1.0, element_mm = 4 }")
    is_solid = config.experiment.kind == "solid"
    if is_solid != (table.through_mm is not None):
        raise InputError(f"a mesh made on the {'points' if fields else 'image'} is plane", file=file,
                         key="experiment.kind", expected="plane_stress or plane_strain, or solid with through_mm in "
                         "mesh, its thickness", found=f"{config.experiment.kind}, {'no' if is_solid else 'with'} "
                         "through_mm", remedy="give through_mm, or a mesh file" if is_solid else
                         'leave through_mm out, or write kind = "solid"')
    mesh, notes = _plane_mesh(config, scale, stack, file)
    if table.through_mm is None:
        return mesh, notes
    if scale.unit != "mm":
        raise InputError("a solid without a scale", file=file, key="camera.pixel_size_mm", expected="the size of a "
                         "pixel: its thickness is in mm", found="lengths in px", remedy="give pixel_size_mm")
    return extruded(mesh, table.through_mm, table.layers, _towards(scale.camera)), notes


def _towards(camera: AnyCamera) -> int:
    """+1 where z of the mesh points to the camera; before one with a lens the mesh is seen so."""
    if not isinstance(camera, Camera):
        return 1
    return -1 if np.linalg.det(camera.jacobian(np.zeros((1, 2)))[0][:, :2]) > 0.0 else 1


def _plane_mesh(config: ExperimentFile, scale: Lengths, stack: Stack, file: Path) -> tuple[Mesh, list[str]]:
    """The mesh in the plane, and notes."""
    table, fields = config.experiment.mesh, isinstance(stack, FieldStack)
    if table.around_points_mm is not None and isinstance(stack, FieldStack):
        return _around_points(config, stack.points, scale.camera, file), [_margin_note(config, stack.points)]
    if table.outline_points_mm is not None and isinstance(stack, FieldStack):
        drawing, point_outline = _of_outline(config, stack.points, scale.camera, file)
        return drawing.mesh(file), [*_edge_notes(config, point_outline, stack.points.pitch), *_gap_notes(point_outline)]
    if not table.in_px:
        return _mesh_in_mm(table, scale, file, _ends(config) if fields else {}), []
    mesh = (drawing_of(table).mesh(file, KEY) if table.outline_px is not None
            else roi_mesh(table.roi_px, table.element_px, table.holes_px, down=True, file=file, key=KEY))
    return from_image(mesh, scale.camera), []


def _around_points(config: ExperimentFile, points: MeasuredPoints, camera: Camera, file: Path) -> Mesh:
    """A mesh of the rectangle around the points, in the axes of the mesh: ``mesh = { around_points_mm = 1.0 }``.

    Points never reach the edge of a specimen: the margin is what the system leaves out there, or two numbers, along x
    and along y.
    """
    table = config.experiment.mesh
    margin = np.broadcast_to(np.atleast_1d(table.around_points_mm), 2)
    at = camera.inverse(grid_of(points).positions_px)
    low, high = at.min(axis=0) - margin, at.max(axis=0) + margin
    size = table.element_mm or NEIGHBOURS_PER_ELEMENT * points.pitch
    down = bool((camera.jacobian(np.zeros((1, 2)))[0] @ (0.0, 1.0))[1] > 0)
    return roi_mesh((*low, *high), size, table.holes_mm, down=down, file=file, key=KEY)


def _of_outline(config: ExperimentFile, points: MeasuredPoints, camera: Camera,
                file: Path) -> tuple[Drawing, PointOutline]:
    """The outline of the points, with its holes, wider by a margin: ``mesh = { outline_points_mm = 0.7 }``.

    The ends along x and y are the sets LEFT, RIGHT, BOTTOM, TOP.
    """
    table = config.experiment.mesh
    at = camera.inverse(grid_of(points).positions_px)
    try:
        point_outline = PointOutline.around(at, points.pitch, float(table.outline_points_mm or 0.0))
    except InputError as error:
        raise InputError(error.what, file=file, key=KEY, expected=error.expected, found=error.found,
                         remedy=error.remedy) from None
    size = table.element_mm or NEIGHBOURS_PER_ELEMENT * points.pitch
    return Drawing(point_outline.outline.tolist(), [hole.tolist() for hole in point_outline.holes], size,
                   table.elements == "quads", point_outline.ends, table.mesher), point_outline


def _margin_note(config: ExperimentFile, points: MeasuredPoints) -> str:
    across, along = np.broadcast_to(np.atleast_1d(config.experiment.mesh.around_points_mm), 2)
    counted = any(entry.name.startswith(OUTLINE) for entry in config.dof)
    advice = (f"{OUTLINE} counts it in their error bars. With the true margins, leave it out" if counted else
              "no error bar counts it: make it as wide as the specimen")
    return (f"the rectangle around the points with margins of {across:.2g} and {along:.2g} mm along x and y: facets "
            f"end half their width before an edge, and the grid shows it to {0.5 * points.pitch:.2g} mm. Moduli by the "
            f"force are off as the width of the mesh is, and {advice}")


def _edge_notes(config: ExperimentFile, point_outline: PointOutline, pitch: float) -> list[str]:
    width, error = narrowest_width(point_outline, pitch)
    notch = f", that of a notch to {0.5 * error:.2g} mm" if error > pitch else ""
    counted = any(entry.name.startswith(OUTLINE) for entry in config.dof)
    advice = (f"{OUTLINE} identifies where the edges are" if counted else
              f"no error bar counts it: let [[dof]] {OUTLINE} identify where the edges are, or draw them (outline_mm)")
    return [f"the outline of the points with a margin of {config.experiment.mesh.outline_points_mm:.2g} mm: facets end "
            f"half their width before an edge, and the grid shows it to {0.5 * pitch:.2g} mm{notch}. If the margin is "
            f"half a facet, the narrowest width of {width:.3g} mm is off by up to {100.0 * error / width:.2g} %, and "
            f"so are moduli by the force; {advice}"]


def outline_share(config: ExperimentFile, stack: Stack, camera: Camera, file: Path) -> float | None:
    """By how much the narrowest width of a mesh from the outline of points may be off, of that width; None without."""
    if config.experiment.mesh.outline_points_mm is None or not isinstance(stack, FieldStack):
        return None
    point_outline = _of_outline(config, stack.points, camera, file)[1]
    width, error = narrowest_width(point_outline, stack.points.pitch)
    return error / width


def _gap_notes(point_outline: PointOutline) -> list[str]:
    if not len(point_outline.gaps):
        return []
    x, y, width = point_outline.gaps[np.argmax(point_outline.gaps[:, 2])]
    return [f"{len(point_outline.gaps)} gaps of the points, the widest {width:.3g} mm at ({x:.4g}, {y:.4g}), are "
            "filled by the mesh, as points that are missing; if the specimen has a hole there, draw it (outline_mm "
            "with holes_mm)"]


def _ends(config: ExperimentFile) -> dict[str, list[int]]:
    """Segments (from 1) of an outline in mm that are its ends, as those of an outline of points, unless they are named
    or defined otherwise."""
    table = config.experiment.mesh
    corners = [entry[-2:] for entry in table.outline_mm or [] if isinstance(entry, Sequence)]  # where arcs end
    if not corners:
        return {}  # a circle, or no outline
    ends = sides_of_any(np.array(corners, dtype=float))
    return {name: numbers for name, numbers in ends.items() if name not in config.sets and name not in table.edge_names}


def _mesh_in_mm(table: MeshTable, scale: Lengths, file: Path, ends: Mapping[str, list[int]]) -> Mesh:
    shape = "roi" if table.outline_mm is None else "outline"
    if scale.unit != "mm":
        raise InputError("an ROI in mm without a scale", file=file, key=f"{KEY}.{shape}_mm",
                         expected="camera.pixel_size_mm", found="no scale",
                         remedy=f"give pixel_size_mm, or {shape}_px")
    if table.outline_mm is not None:
        drawing = drawing_of(table)
        return replace(drawing, edge_names={**ends, **drawing.edge_names}).mesh(file, KEY)
    down = bool(scale.camera.jacobian(np.zeros((1, 2)))[0, 1, 1] > 0)
    return roi_mesh(table.roi_mm, table.element_mm, table.holes_mm, down=down, file=file, key=KEY)


def drawing_of(table: MeshTable) -> Drawing:
    """The drawing of a table with an outline."""
    quads = table.elements == "quads"
    if table.outline_px is not None:
        return Drawing(table.outline_px, table.holes_px, table.element_px, quads, table.edge_names, table.mesher)
    return Drawing(table.outline_mm, table.holes_mm, table.element_mm, quads, table.edge_names, table.mesher)


def arcs_of(config: ExperimentFile, stack: Stack, camera: Camera, file: Path) -> Drawing | None:
    """What mid-side nodes follow: an outline, drawn or of points, with its holes, or the holes of a rectangle; None
    without any."""
    table = config.experiment.mesh
    if table.outline_points_mm is not None and isinstance(stack, FieldStack):
        return _of_outline(config, stack.points, camera, file)[0]
    if table.is_drawn:
        return drawing_of(table)
    holes = table.holes_px or table.holes_mm
    return Drawing(holes[0], holes[1:], table.element_px or table.element_mm or 1.0) if holes else None
