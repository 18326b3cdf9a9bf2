"""Which pixel lies where in which element: the static table that every image pass runs over, and the motion of its
elements.

Geometry only: it does not know a grey value. Pixels are sorted by element; pixels of no element, outside the mask or
of elements outside the image are simply not in the table.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numba import njit
from scipy import sparse

from idic.correlation.pixels.cells import (CELLS, EDGES, N_MONOMIALS, N_NODES, TRANSFORMS, find_owners, monomial_slopes,
                                           monomials, sort_by_owner, to_monomials)
from idic.errors import InputError
from idic.fe import Block
from idic.images import Camera

EDGE_TOLERANCE = 1e-6  # of a cell's size: a pixel on the edge between two elements belongs to one of them


@dataclass(frozen=True, eq=False)
class PixelMap:
    """The pixels of the visible elements, sorted by element (then row by row).

    Attributes
    ----------
    shape : (ny, nx)
    nodes_px : array (n_nodes, 2)
        (column, row) of all nodes of the mesh, visible or not.
    element : array (n_elements,)
        Global index of each element that owns a pixel; everything "per element" here is in this order.
    conn : array (n_elements, 8), int32
        Its nodes; zeros beyond the cell's own number of nodes.
    kind : array (n_elements,)
        Index into `idic.correlation.pixels.cells.CELLS`.
    start : array (n_elements + 1,)
        Pixels of element e: ``start[e]`` to ``start[e + 1]``.
    ix, iy : array (n_pixels,), int32
        Column and row.
    a, b : array (n_pixels,), float32
        Position in the element's own coordinates.
    centre : array (n_elements, 2)
        Mean of (a, b): where the deformation gradient of the element is taken.
    inverse_jacobian : array (n_elements, 2, 2)
        d(a, b)/d(column, row) there.
    n_unowned : int
        Pixels of the given mask that lie in no element.
    """

    shape: tuple[int, int]
    nodes_px: np.ndarray
    element: np.ndarray
    conn: np.ndarray
    kind: np.ndarray
    start: np.ndarray
    ix: np.ndarray
    iy: np.ndarray
    a: np.ndarray
    b: np.ndarray
    centre: np.ndarray
    inverse_jacobian: np.ndarray
    n_unowned: int = 0

    @property
    def n_nodes(self) -> int:
        return len(self.nodes_px)

    @cached_property
    def around_nodes(self) -> sparse.csr_array:
        """1 where an element of the map has a node  # (n_nodes, n_elements)"""
        used = np.arange(self.conn.shape[1]) < N_NODES[self.kind][:, None]
        nodes, owner = self.conn[used], np.nonzero(used)[0]
        return sparse.csr_array((np.ones(len(nodes)), (nodes, owner)), shape=(self.n_nodes, len(self.conn)))

    @property
    def n_elements(self) -> int:
        return len(self.element)

    @property
    def n_pixels(self) -> int:
        return len(self.ix)

    @property
    def pixels_per_element(self) -> np.ndarray:
        return np.diff(self.start)  # (n_elements,)

    @property
    def visible_nodes(self) -> np.ndarray:
        """Indices of the nodes of elements that own a pixel."""
        return np.unique(self.conn[self._is_node])

    @property
    def _is_node(self):
        return np.arange(N_MONOMIALS) < N_NODES[self.kind][:, None]  # (n_elements, 8)

    def valid_but(self, exclude: np.ndarray | None) -> np.ndarray:
        """1 of every pixel, 0 of those with the numbers `exclude`  # (n_pixels,) uint8"""
        valid = np.ones(self.n_pixels, dtype=np.uint8)
        if exclude is not None:
            valid[exclude] = 0
        return valid

    def points(self) -> np.ndarray:
        """(column, row) of the pixels  # (n_pixels, 2)"""
        return np.column_stack([self.ix, self.iy]).astype(float)

    def shape_matrix(self) -> sparse.csr_array:
        """Shape function of every node at every pixel, in double precision  # (n_pixels, n_nodes)"""
        rows, columns, values = [], [], []
        owner = np.repeat(np.arange(self.n_elements), self.pixels_per_element)
        m = monomials(self.a.astype(float), self.b.astype(float))
        for kind in np.unique(self.kind):
            of_kind = np.flatnonzero(self.kind[owner] == kind)
            n = N_NODES[kind]
            values.append((m[of_kind] @ TRANSFORMS[kind])[:, :n].ravel())
            rows.append(np.repeat(of_kind, n))
            columns.append(self.conn[owner[of_kind], :n].ravel())
        triplet = (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns)))
        return sparse.csr_array(triplet, shape=(self.n_pixels, self.n_nodes))

    def interpolate(self, nodal: np.ndarray) -> np.ndarray:
        """A nodal field at the pixels  # (n_nodes, ...) -> (n_pixels, ...)"""
        return self.shape_matrix() @ nodal

    def to_image(self, values: np.ndarray, fill: float = np.nan) -> np.ndarray:
        """Values of the pixels as an image, `fill` where there is no pixel  # (n_pixels,) -> (ny, nx)"""
        image = np.full(self.shape, fill, dtype=np.result_type(np.asarray(values).dtype, np.float32))
        image[self.iy, self.ix] = values
        return image

    def deformation_gradient(self, u_px: np.ndarray) -> np.ndarray:
        """F = d(x + u)/dx in pixel coordinates, one per element  # (n_nodes, 2) px -> (n_elements, 2, 2)"""
        return self.element_gradients(self.element_coefficients(u_px))

    @cached_property
    def geometry(self) -> np.ndarray:
        """Monomial coefficients of the places of the nodes  # (n_elements, 2, 8) px"""
        return self.element_coefficients(self.nodes_px)

    @classmethod
    def of(cls, nodes: np.ndarray, cells: Sequence[Block], camera: Camera, image_shape: tuple[int, int],
           mask: np.ndarray | None = None) -> PixelMap:
        """Find the element and the place in it of every pixel.

        Elements are isoparametric in the image: their nodes are projected by the camera, their edges are those of the
        cell. A mesh may reach beyond the image.

        Parameters
        ----------
        nodes : array (n_nodes, 2|3), mm
        cells : blocks of tri3, quad4, tri6, quad8 (for solids the visible faces)
        camera : Camera
        image_shape : (ny, nx)
        mask : array (ny, nx), bool, optional
            True = correlate.

        Raises
        ------
        InputError
            Where the mask has another size, a cell is not a surface cell, or no pixel is left.
        """
        ny, nx = (int(n) for n in image_shape)
        unmasked = mask is None
        mask = checked_mask(mask, (ny, nx))
        nodes_px = camera.project(nodes)
        element, conn, kind = flat_elements(cells)
        boxes = element_boxes(nodes_px, conn, kind, ny, nx)
        inside = (boxes[:, 0] <= boxes[:, 1]) & (boxes[:, 2] <= boxes[:, 3])
        element, conn, kind, boxes = element[inside], conn[inside], kind[inside], boxes[inside]
        geometry = np.empty((len(element), 2, N_MONOMIALS))
        to_monomials(nodes_px, conn, kind, TRANSFORMS, N_NODES, geometry)
        if len(element):
            column0, row0 = int(boxes[:, 0].min()), int(boxes[:, 2].min())
            window = mask[row0 : boxes[:, 3].max() + 1, column0 : boxes[:, 1].max() + 1]
            owner, a, b = find_owners(geometry, kind % 2 == 0, boxes, window, column0, row0, EDGE_TOLERANCE)
            visible, start, iy, ix = sort_by_owner(owner, len(element))
        if not len(element) or not len(ix):
            raise nothing_visible(nodes_px, (ny, nx), mask)
        a, b = a[iy, ix], b[iy, ix]
        counts = np.diff(start)
        centre = np.column_stack([np.add.reduceat(a, start[:-1]), np.add.reduceat(b, start[:-1])]) / counts[:, None]
        jacobian = np.einsum("eck,ekd->ecd", geometry[visible], monomial_slopes(centre[:, 0], centre[:, 1]))
        return cls(
       (ny, nx), nodes_px, element[visible], conn[visible], kind[visible], start,
       (ix + column0).astype(np.int32), (iy + row0).astype(np.int32), a.astype(np.float32), b.astype(np.float32),
       centre, np.linalg.inv(jacobian), n_unowned=0 if unmasked else int(mask.sum()) - len(ix),
    )

    def element_coefficients(self, nodal: np.ndarray) -> np.ndarray:
        """Monomial coefficients of a nodal field per element  # (n_nodes, n_comp) -> (n_elements, n_comp, 8)"""
        nodal = np.ascontiguousarray(nodal, dtype=np.float64)
        if nodal.ndim != 2 or len(nodal) != self.n_nodes:
            raise ValueError(f"a nodal field must be ({self.n_nodes}, n), got {nodal.shape}")
        out = np.empty((self.n_elements, nodal.shape[1], N_MONOMIALS))
        to_monomials(nodal, self.conn, self.kind, TRANSFORMS, N_NODES, out)
        return out

    def element_gradients(self, coefficients: np.ndarray) -> np.ndarray:
        """F of a motion given by its coefficients, one per element  # (n_elements, 2, 8) px -> (n_elements, 2, 2)"""
        slopes = monomial_slopes(self.centre[:, 0], self.centre[:, 1])
        return np.eye(2) + np.einsum("eck,ekd,edj->ecj", coefficients, slopes, self.inverse_jacobian, optimize=True)

    def element_curvature(self, coefficients: np.ndarray, inverse: np.ndarray) -> np.ndarray:
        """Second derivatives of a motion along the axes of the frame, one per element; 0 where an element is flattened

        coefficients : (n_elements, 2, 8) px, inverse : (n_elements, 2, 2) F^-1 -> (n_elements, 2, 2, 2) px/px², by
        component and both directions
        """
        curvature = np.empty((self.n_elements, 2, 2, 2))
        _curvatures(coefficients, self.geometry, self.centre, self.inverse_jacobian, inverse, curvature)
        return curvature


def inverse_gradients(pixel_map: PixelMap, coefficients: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """F^-1 and det F of a motion given by its coefficients (n_elements, 2, 8) px; both 0 where an element is flattened

    # (n_elements, 2, 2), (n_elements,)
    """
    inverse, det = np.empty((pixel_map.n_elements, 2, 2)), np.empty(pixel_map.n_elements)
    _inverse_gradients(coefficients, pixel_map.centre, pixel_map.inverse_jacobian, inverse, det)
    return inverse, det


def at_nodes(pixel_map: PixelMap, matrices: np.ndarray) -> np.ndarray:
    """Mean over the elements around each node, the identity where there is none  # (nel, c, c) -> (n_nodes, c, c)"""
    around, size = pixel_map.around_nodes, matrices.shape[1]
    total = (around @ matrices.reshape(len(matrices), size**2)).reshape(pixel_map.n_nodes, size, size)
    count = np.diff(around.indptr)
    return np.where(count[:, None, None] > 0, total / np.maximum(count, 1)[:, None, None], np.eye(size))


def checked_mask(mask: np.ndarray | None, shape: tuple[int, int]) -> np.ndarray:
    """The mask as bool, all True where there is none; InputError where its size is another  # (ny, nx)"""
    if mask is None:
        return np.ones(shape, dtype=bool)
    mask = np.asarray(mask)
    if mask.shape != shape:
        raise InputError("the mask and the images differ in size", key="mask", expected=f"{shape[1]} x {shape[0]} px",
                         found=" x ".join(str(n) for n in mask.shape[::-1]) + " px",
                         remedy="make the mask from the reference image")
    return mask.astype(bool)


def flat_elements(cells: Sequence[Block]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Global index (n,), nodes (n, 8) and kind (n,) of the cells that a camera sees."""
    element, conn, kind = [], [], []
    for block in cells:
        if block.cell not in CELLS:
            raise InputError(f"{block.cell} is not a cell that a camera can see", expected=", ".join(CELLS),
                             remedy="name the face set that the camera sees: surface = ...")
        table = np.zeros((len(block.connectivity), N_MONOMIALS), dtype=np.int32)
        table[:, : np.shape(block.connectivity)[1]] = block.connectivity
        conn.append(table)
        element.append(block.first + np.arange(len(table)))
        kind.append(np.full(len(table), CELLS.index(block.cell), dtype=np.int64))
    if not element:
        raise InputError("the mesh has no cell to correlate", expected=", ".join(CELLS),
                         remedy="use a mesh with such cells")
    return np.concatenate(element), np.concatenate(conn), np.concatenate(kind)


def element_boxes(nodes_px, conn, kind, ny, nx):
    """Columns and rows (first, last) that an element may own, clipped to the image  # (n_elements, 4)"""
    low, high = np.full((len(conn), 2), np.inf), np.full((len(conn), 2), -np.inf)
    for k in np.unique(kind):
        of_kind = kind == k
        points = nodes_px[conn[of_kind, : N_NODES[k]]]  # (n, nn, 2)
        corners = 3 if k % 2 == 0 else 4
        if N_NODES[k] > corners:  # a quadratic edge lies within the triangle of its Bezier control points
            ends = points[:, EDGES[corners]]  # (n, edges, 2 ends, 2)
            control = 2.0 * points[:, corners:] - ends.mean(axis=2)
            points = np.concatenate([points[:, :corners], control], axis=1)
        low[of_kind], high[of_kind] = points.min(axis=1), points.max(axis=1)
    margin = EDGE_TOLERANCE * (high - low).max(axis=1, initial=0.0, keepdims=True)
    low, high = np.clip([low - margin, high + margin], -1.0, max(ny, nx) + 1.0)  # keeps the integers small
    lowest, highest = np.maximum(np.ceil(low), 0), np.minimum(np.floor(high), [nx - 1, ny - 1])
    return np.column_stack([lowest[:, 0], highest[:, 0], lowest[:, 1], highest[:, 1]]).astype(np.int64)


def nothing_visible(nodes_px: np.ndarray, shape: tuple[int, int], mask: np.ndarray) -> InputError:
    """The error of a mesh that no pixel lies on."""
    low, high = nodes_px.min(axis=0), nodes_px.max(axis=0)
    if not mask.any():
        return InputError("the mask leaves no pixel to correlate", key="mask",
                          expected="some pixels that are not black",
                          remedy="paint the region of interest white")
    return InputError(
        "no pixel lies on the mesh", key="camera",
        expected=f"a mesh that overlaps the image: columns 0 to {shape[1] - 1}, rows 0 to {shape[0] - 1}, and the mask",
        found=f"a mesh from column {low[0]:.0f} to {high[0]:.0f}, row {low[1]:.0f} to {high[1]:.0f}",
        remedy="correct the scale and the place of the mesh in the image; `idic check` draws the mesh on it",
    )


@njit(cache=True, nogil=True)
def _inverse_gradients(motion, centre, inverse_jacobian, inverse, det):
    """Inverse and determinant of F = I + du/d(a, b) d(a, b)/dx at the centre of every element.

    motion (n_elements, 2, 8) monomial coefficients of u; centre (n_elements, 2); inverse_jacobian (n_elements, 2, 2);
    results inverse (n_elements, 2, 2), det (n_elements,). A flattened element (det 0) gets inverse 0 and takes no part.
    """
    for e in range(motion.shape[0]):
        a, b = centre[e]
        f = np.eye(2)
        for c in range(2):
            m = motion[e, c]
            by_a = m[1] + b * m[3] + 2.0 * a * m[4] + 2.0 * a * b * m[6] + b * b * m[7]
            by_b = m[2] + a * m[3] + 2.0 * b * m[5] + a * a * m[6] + 2.0 * a * b * m[7]
            for d in range(2):
                f[c, d] += by_a * inverse_jacobian[e, 0, d] + by_b * inverse_jacobian[e, 1, d]
        det[e] = f[0, 0] * f[1, 1] - f[0, 1] * f[1, 0]
        scale = 1.0 / det[e] if det[e] != 0.0 else 0.0
        inverse[e, 0, 0], inverse[e, 0, 1] = scale * f[1, 1], -scale * f[0, 1]
        inverse[e, 1, 0], inverse[e, 1, 1] = -scale * f[1, 0], scale * f[0, 0]


@njit(cache=True, nogil=True)
def _curvatures(motion, geometry, centre, inverse_jacobian, inverse, curvature):
    """Second derivatives of u at the centre of every element along the axes of the frame, u_c,kl F^-1_ki F^-1_lj.

    geometry (n_elements, 2, 8) monomial coefficients of the places of the nodes, the others as in `_inverse_gradients`;
    curvature (n_elements, 2, 2, 2) by c, i, j in px/px².
    """
    second, slope, by = np.empty((2, 3)), np.empty((2, 2)), np.empty((2, 2))
    for e in range(motion.shape[0]):
        a, b = centre[e]
        for i in range(2):
            for j in range(2):  # d (a, b) / d frame
                by[i, j] = inverse_jacobian[e, i, 0] * inverse[e, 0, j] + inverse_jacobian[e, i, 1] * inverse[e, 1, j]
        for c in range(2):
            m = motion[e, c]
            by_a = m[1] + b * m[3] + 2.0 * a * m[4] + 2.0 * a * b * m[6] + b * b * m[7]
            by_b = m[2] + a * m[3] + 2.0 * b * m[5] + a * a * m[6] + 2.0 * a * b * m[7]
            for d in range(2):
                slope[c, d] = by_a * inverse_jacobian[e, 0, d] + by_b * inverse_jacobian[e, 1, d]
        for c in range(2):
            m = motion[e, c]
            for k in range(3):  # by a a, a b, b b, less what the curved coordinates have of it
                order = 4 if k == 0 else (3 if k == 1 else 5)
                second[c, k] = m[order] - slope[c, 0] * geometry[e, 0, order] - slope[c, 1] * geometry[e, 1, order]
            aab = m[6] - slope[c, 0] * geometry[e, 0, 6] - slope[c, 1] * geometry[e, 1, 6]
            abb = m[7] - slope[c, 0] * geometry[e, 0, 7] - slope[c, 1] * geometry[e, 1, 7]
            second[c, 0] = 2.0 * (second[c, 0] + b * aab)
            second[c, 1] += 2.0 * (a * aab + b * abb)
            second[c, 2] = 2.0 * (second[c, 2] + a * abb)
            for i in range(2):
                for j in range(2):
                    curvature[e, c, i, j] = (second[c, 0] * by[0, i] * by[0, j] + second[c, 2] * by[1, i] * by[1, j]
                                             + second[c, 1] * (by[0, i] * by[1, j] + by[1, i] * by[0, j]))
