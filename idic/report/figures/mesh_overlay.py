"""The mesh drawn on the reference image, to be looked at before the first simulation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import to_rgba

from idic.images import CAMERA_PARAMETERS, LENS_PARAMETERS, PLACED_TURNS
from idic.report.figures.style import CYCLE, FAINT, Picture, look, new_figure, to_picture
from idic.report.result.record import RunRecord

_WIDTH, _MAX_HEIGHT = 9.0, 9.0  # inch
_MARGIN_SHARE = 0.03  # of the image, around it


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
    with look():
        figure = new_figure(_WIDTH, float(np.clip(_WIDTH * span[1] / span[0] + 0.6, 2.5, _MAX_HEIGHT)))
        axis = figure.add_subplot()
        limits = np.nanpercentile(image, (0.5, 99.5))
        axis.imshow(image, cmap="gray", vmin=limits[0], vmax=max(limits[1], limits[0] + 1e-12), interpolation="nearest")
        if mask is not None:
            shade = np.zeros((*mask.shape, 4))
            shade[~mask] = to_rgba(CYCLE[0], 0.35)
            axis.imshow(shade, interpolation="nearest")
            axis.plot([], [], "s", color=CYCLE[0], alpha=0.5, ms=8, label="masked")
        _outlines(
            axis, [cell for cell, is_visible in zip(cells_px, visible, strict=True) if not is_visible], FAINT,
            "outside the image"
        )
        _outlines(axis, [cell for cell, is_visible in zip(cells_px, visible, strict=True) if is_visible], CYCLE[1],
                  "mesh")
        for number, (name, points) in enumerate(sets_px.items()):
            axis.plot(points[:, 0], points[:, 1], "o", ms=2.5, color=CYCLE[(number + 2) % len(CYCLE)], label=name)
        margin = _MARGIN_SHARE * span
        axis.set(
            xlim=(low[0] - margin[0], high[0] + margin[0]),
            ylim=(high[1] + margin[1], low[1] - margin[1]),
            aspect="equal",
            xlabel="column [px]",
            ylabel="row [px]",
        )
        axis.grid(False)
        figure.legend(loc="outside lower center", ncols=6)
        return to_picture(
            figure,
            "mesh_on_image",
            "Mesh on the reference image",
            "Edges and holes of the mesh must lie on those of the specimen.",
        )


def mesh_on_points(points: np.ndarray, cells: Sequence[np.ndarray], sets: Mapping[str, np.ndarray]) -> Picture:
    """Outlines of the elements on the points of a measured field, in the axes of the mesh.

    points : (n, 2) mm; cells : corners (n_corners, 2) mm in walking order; sets : {name: (n, 2)} mm
    """
    everything = np.concatenate([*cells, points])
    low, high = everything.min(axis=0), everything.max(axis=0)
    span, margin = high - low, _MARGIN_SHARE * (high - low).max()
    height = float(np.clip(_WIDTH * span[1] / max(span[0], 1e-9) + 0.6, 2.5, _MAX_HEIGHT))
    with look():
        figure = new_figure(float(np.clip((height - 0.6) * span[0] / max(span[1], 1e-9) + 1.6, 4.0, _WIDTH)), height)
        axis = figure.add_subplot()
        axis.plot(points[:, 0], points[:, 1], ".", ms=2.0, color="black", label="points")
        _outlines(axis, list(cells), CYCLE[1], "mesh")
        for number, (name, at) in enumerate(sets.items()):
            axis.plot(at[:, 0], at[:, 1], "o", ms=2.5, color=CYCLE[(number + 2) % len(CYCLE)], label=name)
        axis.set(xlim=(low[0] - margin, high[0] + margin), ylim=(low[1] - margin, high[1] + margin), aspect="equal",
                 xlabel="x [mm]", ylabel="y [mm]")
        axis.grid(False)
        figure.legend(loc="outside lower center", ncols=3)
        return to_picture(figure, "mesh_on_points", "Mesh on the measured points",
                          "Points end half a subset before the edges and holes of the specimen; the mesh reaches to "
                          "them.")


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
                           "and holes in the image is an independent check.")


def _outlines(axis: Axes, cells: list[np.ndarray], colour: str, label: str) -> None:
    if cells:
        closed = [np.concatenate([cell, cell[:1]]) for cell in cells]
        axis.add_collection(LineCollection(closed, colors=colour, linewidths=0.5, label=label))
