"""The mesh drawn on the reference image, to be looked at before the first simulation."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from PIL import Image

from idic.images import CAMERA_PARAMETERS, LENS_PARAMETERS, PLACED_TURNS
from idic.report.figures.mesh.sheet import Sheet, png
from idic.report.figures.picture import CYCLE, DPI, Colour, Picture, webp
from idic.report.result.record import RunRecord

_WIDTH, _MAX_HEIGHT = 9.0, 9.0  # inch
_MARGIN_SHARE = 0.03  # of the image, around it
_NODE, _MEASURED_POINT = 2.5, 1.0  # diameter in typographic points


def mesh_overlay(
    image: np.ndarray,
    cells_px: Sequence[np.ndarray],
    visible: np.ndarray,
    sets_px: Mapping[str, np.ndarray],
    mask: np.ndarray | None = None,
) -> Picture:
    """Outlines of the elements on the reference image, and the nodes of the sets that the experiment uses.

    Parameters
    ----------
    image : array (ny, nx), grey values or heights (NaN: gaps)
    cells_px : sequence of arrays (n_corners, 2), (column, row) px
        Corners of the cells that the camera could see, in walking order.
    visible : bool array (n_cells,)
        Those that reach into the image; the others are simulated only and drawn faintly.
    sets_px : {name: array (n, 2)}, px
        Nodes of the sets that are driven or measured.
    mask : bool array (ny, nx), optional
        False is shaded: not correlated.
    """
    ny, nx = image.shape
    everything = np.concatenate([*cells_px, [[0.0, 0.0], [nx - 1.0, ny - 1.0]]])
    low, high = everything.min(axis=0), everything.max(axis=0)
    span = np.maximum(high - low, 1.0)
    rows = float(np.clip(_WIDTH * span[1] / span[0] + 0.6, 2.5, _MAX_HEIGHT))
    inside = [cell for cell, is_visible in zip(cells_px, visible, strict=True) if is_visible]
    outside = [cell for cell, is_visible in zip(cells_px, visible, strict=True) if not is_visible]
    entries = [*([("masked", CYCLE[0], "shade")] if mask is not None else []),
               *([("outside the image", Colour.FAINT, "line")] if outside else []),
               *([("mesh", CYCLE[1], "line")] if inside else []), *_set_entries(sets_px)]
    margin = _MARGIN_SHARE * span
    sheet = Sheet(_size_px(_WIDTH, rows), low - margin, high + margin, ("column [px]", "row [px]"), True, entries)
    sheet.image(image)
    if mask is not None:
        sheet.shade(~mask, CYCLE[0])
    sheet.outlines(outside, Colour.FAINT)
    sheet.outlines(inside, CYCLE[1])
    _draw_sets(sheet, sets_px)
    return Picture("mesh_on_image", "Mesh on the reference image",
                   "Edges and holes of the mesh must lie on those of the specimen.", png(sheet.pixels()))


def mesh_on_points(points: np.ndarray, cells: Sequence[np.ndarray], sets: Mapping[str, np.ndarray]) -> Picture:
    """Outlines of the elements on the points of a measured field, in the axes of the mesh.

    points : (n, 2) mm; cells : corners (n_corners, 2) mm in walking order; sets : {name: (n, 2)} mm
    """
    everything = np.concatenate([*cells, points])
    low, high = everything.min(axis=0), everything.max(axis=0)
    span, margin = high - low, _MARGIN_SHARE * (high - low).max()
    height = float(np.clip(_WIDTH * span[1] / max(span[0], 1e-9) + 0.6, 2.5, _MAX_HEIGHT))
    columns = float(np.clip((height - 0.6) * span[0] / max(span[1], 1e-9) + 1.6, 4.0, _WIDTH))
    entries = [("points", Colour.BLACK, "point"), ("mesh", CYCLE[1], "line"), *_set_entries(sets)]
    sheet = Sheet(_size_px(columns, height), low - margin, high + margin, ("x [mm]", "y [mm]"), False, entries)
    sheet.points(points, Colour.BLACK, _MEASURED_POINT)
    sheet.outlines(cells, CYCLE[1])
    _draw_sets(sheet, sets)
    return Picture("mesh_on_points", "Mesh on the measured points",
                   "Points end half a subset before the edges and holes of the specimen; the mesh reaches to them.",
                   png(sheet.pixels()))


def identified_mesh(record: RunRecord) -> Picture | None:
    """The mesh where the identified geometry and camera put it on the reference image; None where neither was free."""
    identified = [name for name, entry in record.result["parameters"].items() if entry["free"]]
    of_camera = {*CAMERA_PARAMETERS, *LENS_PARAMETERS, *PLACED_TURNS}
    if not any(name.startswith("geometry.hole_") or name.rpartition(".")[2] in of_camera for name in identified):
        return None
    corners = [record.nodes_px[cell[:3 if kind.startswith("tri") else 4]]
               for kind, cells in record.cells for cell in cells if kind in ("tri3", "tri6", "quad4", "quad8")]
    if not corners:
        return None
    picture = mesh_overlay(record.reference, corners, np.ones(len(corners), bool), {})
    return replace(picture, name="mesh_identified", title="Mesh as identified on the reference image",
                   caption="Geometry and camera are identified from the motion alone: whether the mesh lies on edges "
                           "and holes in the image is an independent check.",
                   light=webp(np.asarray(Image.open(io.BytesIO(picture.png))), exact=True))


def _size_px(width: float, height: float) -> tuple[int, int]:
    return round(DPI * width), round(DPI * height)


def _set_entries(sets: Mapping[str, np.ndarray]) -> list[tuple[str, str, str]]:
    return [(name, _set_colour(number), "point") for number, name in enumerate(sets)]


def _draw_sets(sheet: Sheet, sets: Mapping[str, np.ndarray]) -> None:
    for number, points in enumerate(sets.values()):
        sheet.points(points, _set_colour(number), _NODE)


def _set_colour(number: int) -> str:
    return CYCLE[(number + 2) % len(CYCLE)]
