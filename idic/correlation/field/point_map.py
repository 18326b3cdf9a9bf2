"""Which measured point lies where in which element: the pixel map of a field.

Every point makes a row per component: along the columns, along the rows and, on the surface of a solid, along the
normal. The rows of an element are those of the first component, then those of the next.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numba import njit

from idic.correlation.pixels.cells import N_MONOMIALS, N_NODES, TRANSFORMS, invert, monomial_slopes, to_monomials
from idic.correlation.pixels.pixel_map import EDGE_TOLERANCE, PixelMap, flat_elements
from idic.errors import InputError
from idic.fe import Block
from idic.images import Camera


@dataclass(frozen=True, eq=False)
class PointMap(PixelMap):
    """A pixel map of scattered points.

    Attributes
    ----------
    positions : array (n_points, 2)
        (column, row) of all points of the field, in distances of neighbours.
    point, component : arrays (n_pixels,)
        Point of each row, and 0 (along the columns), 1 (along the rows) or 2 (along the normal).
    """

    positions: np.ndarray = None
    point: np.ndarray = None
    component: np.ndarray = None

    def points(self) -> np.ndarray:
        """(column, row) of the points of the rows  # (n_pixels, 2)"""
        return self.positions[self.point]

    def in_plane(self) -> PointMap:
        """The rows of the motion in the plane alone."""
        n = int(self.component.max()) + 1
        if n == 2:
            return self
        selection = self.component < 2
        rows = {name: getattr(self, name)[selection] for name in ("ix", "iy", "a", "b", "point", "component")}
        return replace(self, start=2 * self.start // n, n_unowned=2 * self.n_unowned // n, **rows)

    def to_image(self, values: np.ndarray, fill: float = np.nan) -> np.ndarray:
        """Root mean square of the components on the grid of the points, `fill` where there is none  # (ny, nx)"""
        values = np.asarray(values, dtype=float)
        finite = np.isfinite(values)
        place = (self.iy[finite].astype(np.int64) * self.shape[1] + self.ix[finite])
        size = self.shape[0] * self.shape[1]
        count, total = np.bincount(place, minlength=size), np.bincount(place, values[finite] ** 2, size)
        image = np.full(size, fill, dtype=np.float32)
        image[count > 0] = np.sqrt(total[count > 0] / count[count > 0])
        return image.reshape(self.shape)


def build_point_map(nodes: np.ndarray, cells: Sequence[Block], camera: Camera, positions: np.ndarray,
                    shape: tuple[int, int], mask: np.ndarray | None = None, n_components: int = 2) -> PointMap:
    """Find the element and the place in it of every point. Points beside the mesh are left out.

    Parameters
    ----------
    nodes : array (n_nodes, 2|3), mm
    camera : to the grid of the points, in distances of neighbours
    positions : array (n_points, 2)
    shape : (ny, nx) of that grid; mask : (ny, nx) bool, True: points here are compared, None: everywhere
    n_components : rows of a point, 2 or 3

    Raises
    ------
    InputError
        Where no point lies on the mesh.
    """
    nodes_px = camera.project(nodes)
    element, conn, kind = flat_elements(cells)
    geometry = np.empty((len(element), 2, N_MONOMIALS))
    to_monomials(nodes_px, conn, kind, TRANSFORMS, N_NODES, geometry)
    low, high = np.empty((len(element), 2)), np.empty((len(element), 2))
    for k in np.unique(kind):
        corners = nodes_px[conn[kind == k, :N_NODES[k]]]
        low[kind == k], high[kind == k] = corners.min(axis=1), corners.max(axis=1)
    margin = 0.25 * (high - low).max(axis=1, keepdims=True)  # curved edges bulge beyond their nodes
    owner, a, b = _owners(geometry, kind % 2 == 0, low - margin, high + margin, positions, EDGE_TOLERANCE)
    cell = np.clip(np.rint(positions), 0, [shape[1] - 1, shape[0] - 1]).astype(np.int32)
    inside = np.flatnonzero((owner >= 0) & (True if mask is None else mask[cell[:, 1], cell[:, 0]]))
    if len(inside) == 0:
        raise InputError("no measured point lies on the mesh", key="experiment.mesh",
                         expected=f"a mesh around the points: columns 0 to {shape[1] - 1}, rows 0 to {shape[0] - 1}",
                         found=f"a mesh from column {nodes_px[:, 0].min():.0f} to {nodes_px[:, 0].max():.0f}, row "
                         f"{nodes_px[:, 1].min():.0f} to {nodes_px[:, 1].max():.0f}",
                         remedy="check the place of the mesh; `idic check` draws it on the points")
    visible, number = np.unique(owner[inside], return_inverse=True)
    point, component, element_of = (np.tile(inside, n_components), np.repeat(np.arange(n_components), len(inside)),
                                    np.tile(number, n_components))
    order = np.lexsort((point, component, element_of))
    point, component = point[order], component[order]
    counts = np.bincount(element_of, minlength=len(visible))
    start = np.concatenate([[0], np.cumsum(counts)])
    a, b = a[point], b[point]
    centre = np.column_stack([np.add.reduceat(a, start[:-1]), np.add.reduceat(b, start[:-1])]) / counts[:, None]
    jacobian = np.einsum("eck,ekd->ecd", geometry[visible], monomial_slopes(centre[:, 0], centre[:, 1]))
    place = cell[point]
    return PointMap(shape, nodes_px, element[visible], conn[visible], kind[visible], start, place[:, 0].copy(),
                    place[:, 1].copy(), a.astype(np.float32), b.astype(np.float32), centre, np.linalg.inv(jacobian),
                    n_components * (len(positions) - len(inside)), positions, point, component)


@njit(cache=True, nogil=True)
def _owners(geometry, triangle, low, high, positions, tolerance):
    """Element of every point, -1 for none, and its place there  # (n_points,) each"""
    n = len(positions)
    owner, a, b = np.full(n, -1), np.zeros(n), np.zeros(n)
    excess = np.full(n, tolerance)
    for e in range(len(geometry)):
        middle = 1.0 / 3.0 if triangle[e] else 0.0
        for p in range(n):
            x, y = positions[p, 0], positions[p, 1]
            if x < low[e, 0] or x > high[e, 0] or y < low[e, 1] or y > high[e, 1]:
                continue
            converged, qa, qb = invert(geometry[e], x, y, middle, middle)
            if not converged:
                continue
            beyond = max(-qa, -qb, qa + qb - 1.0) if triangle[e] else max(abs(qa), abs(qb)) - 1.0
            if beyond < excess[p]:
                excess[p], owner[p], a[p], b[p] = beyond, e, qa, qb
    return owner, a, b
