"""Which edge element every image column of a cross-section shows.

A cross-section seen from above moves alike in all image rows, so the pixel map of two dimensions shrinks to one entry
per image column: the edge, its shape functions there and their slopes. Where only half of a symmetric section is
modelled, a column of the other half shows the mirrored edge (``side`` -1).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from idic.errors import InputError
from idic.fe import Mesh
from idic.images import Camera

RIM_PX = 8  # columns next to the image's ends: the spline's mirror boundary bends a sloping profile there
_NEWTON_STEPS = 4


@dataclass(frozen=True, eq=False)
class SectionMap:
    """The correlated image columns and the edge elements they lie on.

    Attributes
    ----------
    shape : (ny, nx) of the images.
    n_nodes : int
        Of the whole mesh.
    column : array (n_columns,), int32
        Image columns, sorted by edge.
    edge : array (n_columns,)
        Number of the edge in the set; every number from 0 to n_elements - 1 occurs, in runs.
    conn : array (n_columns, 3)
        Nodes of the edge: its ends and its middle (a 2-node edge repeats an end, with weight 0).
    weight, slope : arrays (n_columns, 3)
        Shape functions at the column, and d/d(column) of them, 1/px.
    side : array (n_columns,)
        -1 where the column shows the mirrored half: motion along the section has the opposite sign there.
    valid : array (ny, n_columns), bool
        Pixels in the ROI.
    """

    shape: tuple[int, int]
    n_nodes: int
    column: np.ndarray
    edge: np.ndarray
    conn: np.ndarray
    weight: np.ndarray
    slope: np.ndarray
    side: np.ndarray
    valid: np.ndarray

    @property
    def n_columns(self) -> int:
        return len(self.column)

    @cached_property
    def n_pixels(self) -> int:
        return int(self.valid.sum())

    @property
    def n_elements(self) -> int:
        return int(self.edge[-1]) + 1

    @property
    def pixels_per_element(self) -> np.ndarray:
        return np.bincount(self.edge, self.valid.sum(axis=0)).astype(np.int64)

    @property
    def visible_nodes(self) -> np.ndarray:
        """Indices of the nodes of edges that own a column."""
        return np.unique(self.conn)

    @cached_property
    def numbers(self) -> np.ndarray:
        """Number of each pixel in the order of `points`; means nothing outside of the ROI  # (ny, n_columns)"""
        return (np.cumsum(self.valid.ravel()) - 1).reshape(self.valid.shape)

    @cached_property
    def first_columns(self) -> np.ndarray:
        """The first column of every edge  # (n_elements,)"""
        return np.flatnonzero(np.diff(self.edge, prepend=-1))

    @cached_property
    def edge_dofs(self) -> np.ndarray:
        """Degrees of freedom 3 node + component of every edge, motion along the section and height  # (n_elements,
        6)"""
        return (3 * self.conn[self.first_columns][:, :, None] + [0, 2]).reshape(-1, 6)

    @cached_property
    def pairs(self) -> np.ndarray:
        """Products of the shape functions at every column  # (n_columns, 9)"""
        return (self.weight[:, :, None] * self.weight[:, None, :]).reshape(-1, 9)

    def points(self) -> np.ndarray:
        """(column, row) of the pixels, row by row  # (n_pixels, 2)"""
        row, k = np.nonzero(self.valid)
        return np.column_stack([self.column[k], row]).astype(float)

    def to_image(self, values: np.ndarray, fill: float = np.nan) -> np.ndarray:
        """Values of the pixels (order of `points`) as an image  # (n_pixels,) -> (ny, nx)"""
        image = np.full(self.shape, fill, dtype=np.result_type(np.asarray(values).dtype, np.float32))
        row, k = np.nonzero(self.valid)
        image[row, self.column[k]] = values
        return image

    def at_columns(self, nodal: np.ndarray) -> np.ndarray:
        """A nodal field at the columns, as on the modelled side  # (n_nodes, ...) -> (n_columns, ...)"""
        return np.einsum("ka,ka...->k...", self.weight, nodal[self.conn])

    def slope_at_columns(self, nodal: np.ndarray) -> np.ndarray:
        """d/d(column) of the same  # (n_nodes, ...) -> (n_columns, ...)"""
        return np.einsum("ka,ka...->k...", self.slope, nodal[self.conn])


def build_section_map(mesh: Mesh, surface: str, camera: Camera, image_shape: tuple[int, int],
                      mask: np.ndarray | None = None, symmetric: bool = False, margin_px: int = 0) -> SectionMap:
    """Find the edge of every image column.

    Parameters
    ----------
    surface : str
        Edge set in view; its upright edges take no part.
    mask : array (ny, nx), bool, optional
        True = correlate.
    symmetric : bool
        The mesh is the half x >= 0 of the specimen: the image shows the other half as well.
    margin_px : int
        Columns left out at the ends of the section.

    Raises
    ------
    InputError
        Where mesh x does not run along the image rows, where a symmetric section is seen by a distorting camera, or
        where no column is left.
    """
    ny, nx = (int(n) for n in image_shape)
    _check_camera(camera, symmetric)
    conn, middle = _edges(mesh, surface)
    x = mesh.nodes[:, 0]
    sides = (1.0, -1.0) if symmetric else (1.0,)
    parts = []
    for side in sides:
        px = camera.project(np.column_stack([side * x, np.zeros(len(x))]))[:, 0]
        parts.append(_owned_columns(px[conn], middle, nx))
    column, edge, xi, dxi = (np.concatenate(values) for values in zip(*parts, strict=True))
    side = np.repeat(sides, [len(part[0]) for part in parts])
    keep = _inside(column, margin_px, nx)
    first = np.sort(np.unique(column, return_index=True)[1])  # the axis of symmetry belongs to one side only
    keep[np.setdiff1d(np.arange(len(column)), first)] = False
    valid = np.ones((ny, len(column)), bool) if mask is None else np.asarray(mask, bool)[:, column]
    keep &= valid.any(axis=0)
    if not keep.any():
        raise InputError("no image column shows the surface", key="camera",
                         expected=f"a section that overlaps columns {RIM_PX} to {nx - 1 - RIM_PX} of the images",
                         found=f"{surface} within columns {column.min()} to {column.max()}" if len(column) else surface,
                         remedy="check pixel_size_mm, origin_px, axes, mesh_unit and the mask")
    order = np.flatnonzero(keep)[np.lexsort((column[keep], edge[keep]))]
    xi, edge = xi[order], edge[order]
    weight, d_weight = _shape_functions(xi, middle[edge])
    return SectionMap((ny, nx), len(x), column[order].astype(np.int32), np.unique(edge, return_inverse=True)[1],
                      conn[edge], weight, d_weight * dxi[order, None], side[order], valid[:, order])


def _check_camera(camera: Camera, symmetric: bool) -> None:
    along = camera.jacobian(np.zeros((1, 2)))[0, :, 0]
    if abs(along[1]) > 1e-9 * abs(along[0]) or (camera.k1 and abs(along[1]) > 0):
        raise InputError("the section does not run along the image rows", key="camera.axes",
                         expected='mesh x along "+col" or "-col" and no rotation: all rows then show one section',
                         found=f"(column, row) per mm of x: {along[0]:.4g}, {along[1]:.4g}",
                         remedy="turn the images by 90 degrees, or correct axes and rotation_deg")
    if symmetric and (camera.k1 or np.any(camera.tilt)):
        raise InputError("a symmetric half-model seen by a distorting camera", key="experiment.symmetry",
                         expected="no k1, tilt_x, tilt_y, or a mesh of the whole section", found="both",
                         remedy="model the whole section")


def _edges(mesh: Mesh, surface: str) -> tuple[np.ndarray, np.ndarray]:
    """Nodes of the edges that have a length along x  # (n, 3), and whether the third is a middle node (n,) bool"""
    faces = [mesh.face_nodes(face) for face in mesh.edge_sets[surface]]
    length = np.array([abs(np.ptp(mesh.nodes[nodes[:2], 0])) for nodes in faces])
    edges = [nodes for nodes, size in zip(faces, length, strict=True) if size > 1e-9 * length.max(initial=0.0)]
    if not edges:
        raise InputError("the surface has no edge that can be seen from above", key="experiment.surface",
                         expected="edges along x", found=surface, remedy="name the upper edge of the section")
    conn = np.array([[*nodes, nodes[0]][:3] for nodes in edges], dtype=np.int64)
    return conn, np.array([len(nodes) == 3 for nodes in edges])


def _owned_columns(px: np.ndarray, middle: np.ndarray, nx: int):
    """Columns within each edge, the edge, the place xi in [-1, 1] and d(xi)/d(column)  # 4 x (n,)"""
    low, high = px[:, :2].min(axis=1), px[:, :2].max(axis=1)
    first, end = np.maximum(np.ceil(low), 0).astype(int), np.minimum(np.ceil(high), nx).astype(int)  # half open
    end += (high == np.floor(high)) & (high == high.max()) & (high <= nx - 1)  # the end of the section
    counts = np.maximum(end - first, 0)
    edge = np.repeat(np.arange(len(px)), counts)
    column = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts) + np.repeat(first, counts)
    a, b = px[edge, 0], px[edge, 1]
    c = np.where(middle[edge], px[edge, 2], 0.5 * (a + b))
    bend = 0.5 * (a + b) - c  # p(xi) = c + (b - a)/2 xi + bend xi^2
    xi = (column - c) / (0.5 * (b - a))
    for _ in range(_NEWTON_STEPS):
        xi = xi - (c + 0.5 * (b - a) * xi + bend * xi**2 - column) / (0.5 * (b - a) + 2.0 * bend * xi)
    return column, edge, xi, 1.0 / (0.5 * (b - a) + 2.0 * bend * xi)


def _inside(column: np.ndarray, margin_px: int, nx: int) -> np.ndarray:
    """Columns away from the ends of the image and of the section  # (n,) bool"""
    if len(column) == 0:
        return np.zeros(0, bool)
    low, high = column.min(), column.max()
    low = low + margin_px if low > 0 else 0
    high = high - margin_px if high < nx - 1 else nx - 1
    return (column >= max(low, RIM_PX)) & (column <= min(high, nx - 1 - RIM_PX))


def _shape_functions(xi: np.ndarray, middle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Lagrange polynomials of the ends and the middle, and their slopes in xi  # (n, 3) each"""
    m = middle.astype(float)
    weight = np.stack([0.5 * (1 - xi) - 0.5 * m * (1 - xi**2), 0.5 * (1 + xi) - 0.5 * m * (1 - xi**2),
                       m * (1 - xi**2)], axis=1)
    slope = np.stack([-0.5 + m * xi, 0.5 + m * xi, -2.0 * m * xi], axis=1)
    return weight, slope
