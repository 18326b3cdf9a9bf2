"""The mesh as a report shows it: the seen surface, or of a volume what its three sections cut out of the elements."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse

from idic.fe import Mesh
from idic.images import GAP_PX, Scanner
from idic.model import Experiment
from idic.report.result.record import EDGE

BESIDE_PX = 1e-3  # of the voxels: a section through nodes would cut nothing
# of each section: the axes of the volume (column, row, slice) along the columns and rows of the picture
PANES = ((0, 1, 2), (2, 1, 0), (0, 2, 1))  # and the one across it


@dataclass(frozen=True, eq=False)
class ShownMesh:
    """Points and cells in the picture.

    Attributes
    ----------
    points_px : array (n_points, 2)
        Column and row.
    cells : tuple of (cell name, (n, n_nodes) int)
    weights : csr_array (n_points, n_nodes), optional
        What of the nodal values is at each point; None: the points are the nodes.
    pane : array (n_points,), optional
        Which of `PANES` a point is in.
    """

    points_px: np.ndarray
    cells: tuple[tuple[str, np.ndarray], ...]
    weights: sparse.csr_array | None = None
    pane: np.ndarray | None = None

    def of(self, nodal: np.ndarray) -> np.ndarray:
        """A nodal field at the points  # (n_nodes, ...) -> (n_points, ...)"""
        if self.weights is None:
            return nodal
        return (self.weights @ nodal.reshape(len(nodal), -1)).reshape(len(self.points_px), *nodal.shape[1:])

    def moved_px(self, motion: np.ndarray) -> np.ndarray:
        """The points after a motion in the image  # (n_nodes, 2 or 3) px -> (n_points, 2)"""
        at = self.of(motion)
        if self.pane is None:
            return self.points_px + at[:, :2]
        along = np.array([axes[:2] for axes in PANES])[self.pane]
        return self.points_px + np.take_along_axis(at, along, axis=1)

    @classmethod
    def seen_by(cls, experiment: Experiment, camera) -> ShownMesh:
        """The mesh of a view by this camera."""
        model = experiment.model
        if isinstance(camera, Scanner):
            return _cut(model.mesh, camera.project(model.mesh.nodes), experiment.recording.volumes.shape)
        if experiment.recording.quantity == "height" and model.is_section:
            faces = model.mesh.edge_sets[model.surface]
            cells = ((EDGE, np.array([model.mesh.face_nodes(face) for face in faces])),)
        else:
            cells = tuple((block.cell, block.connectivity) for block in model.mesh.surface_cells(model.surface))
        return cls(camera.project(model.mesh.nodes), cells)


def _cut(mesh: Mesh, nodes_px: np.ndarray, shape: tuple[int, int, int]) -> ShownMesh:
    """What three sections through the middle of the volume, or of the mesh, cut out of the elements."""
    size = np.array(shape)[::-1]
    places = size // 2 + BESIDE_PX
    low, high = nodes_px.min(axis=0), nodes_px.max(axis=0)
    if not ((places > low) & (places < high)).all():
        places = np.floor((low + high) / 2) + BESIDE_PX
    origin = ((0.0, 0.0), (size[0] + GAP_PX, 0.0), (0.0, size[1] + GAP_PX))
    points, rows, pane, cells = [], [], [], {"tri3": [], "quad4": []}
    for number, (across_columns, across_rows, normal) in enumerate(PANES):
        distance = nodes_px[:, normal] - places[normal]
        points_of_edges: dict[tuple[int, int], int] = {}
        for block in mesh.blocks:
            n_corners = block.kind.n_corners
            corners = block.connectivity[:, :n_corners]
            crossed = (distance[corners].min(axis=1) < 0) & (distance[corners].max(axis=1) > 0)
            for cell in corners[crossed]:
                polygon = []
                for a, b in block.kind.edges:
                    first, second = sorted((int(cell[a]), int(cell[b])))
                    if distance[first] * distance[second] >= 0:
                        continue
                    if (first, second) not in points_of_edges:
                        share = distance[first] / (distance[first] - distance[second])
                        place = (1 - share) * nodes_px[first] + share * nodes_px[second]
                        points_of_edges[first, second] = len(points)
                        points.append(np.array(origin[number]) + place[[across_columns, across_rows]])
                        rows.append((first, second, share))
                        pane.append(number)
                    polygon.append(points_of_edges[first, second])
                _add(cells, polygon, points)
    first, second, share = (np.array(column) for column in zip(*rows, strict=True))
    n = np.arange(len(rows))
    at = np.concatenate([n, n]), np.concatenate([first, second])
    weights = sparse.csr_array((np.concatenate([1 - share, share]), at), shape=(len(rows), mesh.n_nodes))
    tables = tuple((name, np.array(table)) for name, table in cells.items() if table)
    return ShownMesh(np.array(points), tables, weights, np.array(pane))


def element_sections(mesh: Mesh, nodes_px: np.ndarray, shape: tuple[int, int, int],
                     at: tuple[int, int, int]) -> list[list[np.ndarray]]:
    """What three sections at (column, row, slice) cut out of every element: polygons (k, 2) in the picture."""
    size, polygons = np.array(shape)[::-1], [[] for _ in range(mesh.n_elements)]
    origin = ((0.0, 0.0), (size[0] + GAP_PX, 0.0), (0.0, size[1] + GAP_PX))
    for start, (across_columns, across_rows, normal) in zip(origin, PANES, strict=True):
        distance = nodes_px[:, normal] - at[normal] - BESIDE_PX
        plane = nodes_px[:, [across_columns, across_rows]]
        for block in mesh.blocks:
            corners = block.connectivity[:, :block.kind.n_corners]
            crossed = (distance[corners].min(axis=1) < 0) & (distance[corners].max(axis=1) > 0)
            first, second = np.array(block.kind.edges).T
            for number in np.flatnonzero(crossed):
                edges = np.stack([corners[number][first], corners[number][second]])
                a, b = edges[:, distance[edges[0]] * distance[edges[1]] < 0]
                share = (distance[a] / (distance[a] - distance[b]))[:, None]
                points = (1 - share) * plane[a] + share * plane[b]
                angle = np.arctan2(*(points - points.mean(axis=0)).T)
                polygons[block.first + number].append(np.array(start) + points[np.argsort(angle)])
    return polygons


def _add(cells: dict[str, list], polygon: list[int], points: list[np.ndarray]) -> None:
    """A cut of one element as cells: a triangle, a quadrilateral, or triangles around its first corner."""
    at = np.array([points[k] for k in polygon])
    centred = at - at.mean(axis=0)
    ring = [polygon[k] for k in np.argsort(np.arctan2(centred[:, 1], centred[:, 0]))]
    if len(ring) == 4:
        cells["quad4"].append(ring)
    else:
        cells["tri3"] += [[ring[0], ring[k], ring[k + 1]] for k in range(1, len(ring) - 1)]
