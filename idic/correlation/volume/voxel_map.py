"""Which voxel lies where in which element of a solid: the table that every pass over a scan runs over.

Voxels are kept as runs along the rows, element by element, so that the table is small beside the volume; elements come
in blocks of neighbours, whose voxels and halo are all that a pass holds of a scan. The places of voxels in an element
with straight edges follow from its affine map; those of other elements are a table of 6 bytes per voxel.

A voxel on the face between two elements belongs to one of them: all voxels are taken a little beside their middle.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy
from numba import njit

from idic.correlation.volume.solid_cells import (
    MIDDLES, N_SOLID_NODES, N_TERMS, POWERS, SOLIDS, TABLE_SCALE, coefficients_of, monomial_slopes,
)
from idic.errors import InputError
from idic.fe import Block
from idic.images import picture_places, picture_shape

VOXELS_PER_BLOCK = 4_000_000  # of the bounding box: 100 MB with halo and copies
HALO_PX = 28  # voxels along each axis that the filters of a block need beside it
LEAST_BLOCK_PX = 32  # side of a block: below, the halo is most of it
BESIDE = np.array([1.3e-4, 1.7e-4, 2.3e-4])  # voxels: further than rounding, nearer than any motion that is measured
MAX_BEND = 1e-4  # voxels that the places of an affine element may be off
ReadMask = Callable[[slice, slice, slice], np.ndarray]


@dataclass(frozen=True, eq=False)
class VoxelMap:
    """The voxels of the elements, sorted by element, then slice by slice and row by row.

    Attributes
    ----------
    shape : (nz, ny, nx)
    nodes_px : array (n_nodes, 3)
        (column, row, slice) of all nodes of the mesh.
    element : array (n_elements,)
        Global index of each element that owns a voxel; everything "per element" here is in this order.
    conn : array (n_elements, n_max), int64
        Its nodes; zeros beyond the cell's own number of nodes.
    kind : array (n_elements,)
        Index into `SOLIDS`.
    run_start : array (n_elements + 1,); run : array (n_runs, 4), int32
        Column, row and slice where each run begins, and its length.
    start : array (n_elements + 1,)
        Voxels of element e: ``start[e]`` to ``start[e + 1]``.
    affine : array (n_elements,), bool; middle : array (n_elements, 3), int32
    places : array (n_elements, 3, 4), float32
        Of elements with straight edges: d place / d voxel, and the place of the voxel `middle`.
    table_start : array (n_elements,); table : array (3, n), int16
        Places of the voxels of the other elements, in steps of 1 / `TABLE_SCALE`.
    centre : array (n_elements, 3); inverse_jacobian : array (n_elements, 3, 3)
        Middle of the cell, where the deformation gradient is taken; d place / d (column, row, slice) there.
    blocks : array (n_blocks + 1,)
        First element of each block.
    at : tuple of int, optional
        Column, row and slice of three sections, where the map has their voxels alone.
    """

    shape: tuple[int, int, int]
    nodes_px: np.ndarray
    element: np.ndarray
    conn: np.ndarray
    kind: np.ndarray
    run_start: np.ndarray
    run: np.ndarray
    start: np.ndarray
    affine: np.ndarray
    middle: np.ndarray
    places: np.ndarray
    table_start: np.ndarray
    table: np.ndarray
    centre: np.ndarray
    inverse_jacobian: np.ndarray
    blocks: np.ndarray
    at: tuple[int, int, int] | None = None

    @property
    def n_nodes(self) -> int:
        return len(self.nodes_px)

    @property
    def n_elements(self) -> int:
        return len(self.element)

    @property
    def n_pixels(self) -> int:
        """Voxels of all elements."""
        return int(self.start[-1])

    @property
    def pixels_per_element(self) -> np.ndarray:
        """Voxels of each element  # (n_elements,)"""
        return np.diff(self.start)

    @property
    def is_node(self) -> np.ndarray:
        """Which columns of `conn` are nodes  # (n_elements, n_max) bool"""
        return np.arange(self.conn.shape[1]) < N_SOLID_NODES[self.kind][:, None]

    @property
    def visible_nodes(self) -> np.ndarray:
        """Indices of the nodes of elements that own a voxel."""
        return np.unique(self.conn[self.is_node])

    @cached_property
    def boxes(self) -> np.ndarray:
        """First and last (column, row, slice) of the voxels of each block  # (n_blocks, 2, 3)"""
        first = np.minimum.reduceat(self.run[:, :3], self.run_start[self.blocks[:-1]])
        ends = self.run[:, :3] + np.array([1, 0, 0]) * (self.run[:, 3:] - 1)
        return np.stack([first, np.maximum.reduceat(ends, self.run_start[self.blocks[:-1]])], axis=1)

    def points(self) -> np.ndarray:
        """(column, row, slice) of the voxels  # (n_voxels, 3)"""
        at = np.repeat(self.run[:, :3], self.run[:, 3], axis=0)
        ends = np.cumsum(self.run[:, 3])
        at[:, 0] += np.arange(len(at)) - np.repeat(ends - self.run[:, 3], self.run[:, 3])
        return at

    @cached_property
    def sections(self) -> VoxelMap:
        """The voxels of three sections alone: through the middle of the volume, or of the mesh where that is beside."""
        nz, ny, nx = self.shape
        chosen = only_sections(self, (nx // 2, ny // 2, nz // 2))
        if chosen.n_elements:
            return chosen
        low, high = self.boxes[:, 0].min(axis=0), self.boxes[:, 1].max(axis=0)
        return only_sections(self, tuple(int(place) for place in (low + high) // 2))

    def to_image(self, values: np.ndarray, fill: float = np.nan) -> np.ndarray:
        """Values of the voxels of the `sections` as the picture of three sections  # (n,) -> (rows, columns)"""
        part = self if self.at is not None else self.sections
        image = np.full(picture_shape(self.shape), fill, dtype=np.result_type(np.asarray(values).dtype, np.float32))
        for numbers, places in picture_places(part.points(), self.shape, part.at):
            image[places[:, 0], places[:, 1]] = np.asarray(values)[numbers]
        return image

    def at_nodes(self, matrices: np.ndarray) -> np.ndarray:
        """Mean over the elements around each node, the identity where there is none

        # (nel, c, c) -> (n_nodes, c, c)
        """
        used, size = self.is_node, matrices.shape[1]
        nodes, owner = self.conn[used], np.nonzero(used)[0]
        count = np.bincount(nodes, minlength=self.n_nodes)
        total = np.empty((self.n_nodes, size, size))
        for i in range(size):
            for j in range(size):
                total[:, i, j] = np.bincount(nodes, matrices[owner, i, j], self.n_nodes)
        return np.where(count[:, None, None] > 0, total / np.maximum(count, 1)[:, None, None], np.eye(size))

    def gradients(self, coefficients: np.ndarray) -> np.ndarray:
        """F of a motion given by its coefficients  # (n_elements, 3, n_max) voxels -> (n_elements, 3, 3)"""
        F = np.empty((self.n_elements, 3, 3))
        for k in np.unique(self.kind):
            n, of_kind = N_SOLID_NODES[k], self.kind == k
            slopes = monomial_slopes(k, MIDDLES[k][None])[0]  # (n, 3)
            F[of_kind] = np.eye(3) + coefficients[of_kind][:, :, :n] @ slopes @ self.inverse_jacobian[of_kind]
        return F


def build_voxel_map(nodes_px: np.ndarray, cells: Sequence[Block], shape: tuple[int, int, int], margin: int = 0,
                    border: int = 0, mask: ReadMask | None = None) -> VoxelMap:
    """Find the element of every voxel.

    Parameters
    ----------
    nodes_px : array (n_nodes, 3)
        (column, row, slice) of the nodes.
    shape : (nz, ny, nx)
    margin : voxels left out along the surface of the mesh; border : along the borders of the volume
    mask : reads a block of the mask by its slices; True: a voxel may be compared

    Raises
    ------
    InputError
        Cells that are no solids, or no voxel in any of them.
    """
    element, conn, kind = _flat(cells)
    order = _block_order(nodes_px, conn, kind)
    element, conn, kind, group = element[order[0]], conn[order[0]], kind[order[0]], order[1]
    geometry = coefficients_of(conn, kind, nodes_px)  # (n_elements, 3, n_max)
    runs, owner = _runs(geometry, kind, nodes_px[conn], shape, border)
    n_covered = len(runs)
    runs, owner = _kept(runs, owner, shape, margin, mask)
    if n_covered and not len(runs):
        raise InputError("mask and margin leave no voxel of the mesh", key="experiment.mask",
                         expected=f"places of the specimen wider than {2 * margin + 1} voxels", found="none",
                         remedy="check the mask, [scanner] air_below_gv, and edge_margin_px under [options]; `idic "
                                "check` draws mask and mesh in the volume")
    if not len(runs):
        low, high = nodes_px.min(axis=0), nodes_px.max(axis=0)
        raise InputError("no voxel lies in the mesh", key="scanner",
                         expected="a mesh within the volume: " + spans((0, 0, 0), np.array(shape)[::-1] - 1),
                         found="a mesh from " + spans(low, high),
                         remedy="check voxel_mm, origin_px, axes and mesh_unit; `idic check` draws the mesh in the "
                                "volume")
    visible, counts = np.unique(owner, return_counts=True)
    run_start = np.concatenate([[0], np.cumsum(counts)])
    start = np.concatenate([[0], np.cumsum(np.add.reduceat(runs[:, 3], run_start[:-1]))])
    geometry, conn, kind, element, group = (part[visible] for part in (geometry, conn, kind, element, group))
    middle = runs[run_start[:-1] + counts // 2, :3].astype(np.int32)
    inverse = _inverse_jacobians(geometry, kind)
    affine = _is_affine(geometry, kind)
    at_origin = MIDDLES[kind] - np.einsum("eij,ej->ei", inverse, _positions(geometry, kind, MIDDLES[kind]) - middle)
    places = np.concatenate([inverse, at_origin[:, :, None]], axis=2).astype(np.float32)
    sizes = np.where(affine, 0, np.diff(start))
    table_start = np.concatenate([[0], np.cumsum(sizes)])[:-1]
    table = np.empty((3, int(sizes.sum())), dtype=np.int16)
    _fill_table(np.flatnonzero(~affine), geometry, kind, N_SOLID_NODES, _EXPONENTS, MIDDLES, run_start, runs,
                table_start, table)
    blocks = np.concatenate([[0], np.flatnonzero(np.diff(group)) + 1, [len(visible)]])
    return VoxelMap(shape, nodes_px, element, conn, kind, run_start, runs, start, affine, middle, places, table_start,
                    table, MIDDLES[kind], inverse, blocks)


def spans(low, high) -> str:
    """A box in words  # (column, row, slice) each"""
    return ", ".join(f"{name} {first:.0f} to {farthest:.0f}"
                     for name, first, farthest in zip(("column", "row", "slice"), low, high, strict=True))


def only_sections(voxel_map: VoxelMap, at: tuple[int, int, int]) -> VoxelMap:
    """The voxels of three sections alone; at : column, row and slice that they run through."""
    column, row, plane = at
    owner = np.repeat(np.arange(voxel_map.n_elements), np.diff(voxel_map.run_start))
    run = voxel_map.run
    complete = (run[:, 1] == row) | (run[:, 2] == plane)
    crossed = ~complete & (run[:, 0] <= column) & (column < run[:, 0] + run[:, 3])
    keep = np.flatnonzero(complete | crossed)
    offset = np.where(crossed[keep], column - run[keep, 0], 0)
    chosen = run[keep].copy()
    chosen[:, 0] += offset.astype(np.int32)
    chosen[crossed[keep], 3] = 1
    return replace(_chosen(voxel_map, keep, chosen, offset, owner[keep]), at=at)


def _chosen(voxel_map: VoxelMap, keep: np.ndarray, chosen: np.ndarray, offset: np.ndarray,
            owner: np.ndarray) -> VoxelMap:
    """A map of parts of its runs; offset : voxels of each that are left out before the part."""
    visible, counts = np.unique(owner, return_counts=True)
    run_start = np.concatenate([[0], np.cumsum(counts)])
    if not len(visible):
        return replace(voxel_map, element=voxel_map.element[:0], run=chosen)
    start = np.concatenate([[0], np.cumsum(np.add.reduceat(chosen[:, 3], run_start[:-1]))])
    table, table_start = voxel_map.table, np.zeros(len(visible), dtype=np.int64)
    curved = ~voxel_map.affine[owner]
    if curved.any():
        ends = np.cumsum(voxel_map.run[:, 3])
        first = (ends - voxel_map.run[:, 3])[keep] + offset - voxel_map.start[owner] + voxel_map.table_start[owner]
        pieces = [np.arange(a, a + n) for a, n in zip(first[curved], chosen[curved, 3], strict=True)]
        table = table[:, np.concatenate(pieces)]
        sizes = np.where(voxel_map.affine[visible], 0, np.diff(start))
        table_start = np.concatenate([[0], np.cumsum(sizes)])[:-1]
    group = np.searchsorted(voxel_map.blocks, visible, side="right")
    blocks = np.concatenate([[0], np.flatnonzero(np.diff(group)) + 1, [len(visible)]])
    of_elements = {name: getattr(voxel_map, name)[visible] for name in (
        "element", "conn", "kind", "affine", "middle", "places", "centre", "inverse_jacobian")}
    return replace(voxel_map, **of_elements, run_start=run_start, run=chosen, start=start, table_start=table_start,
                   table=table, blocks=blocks)


def _flat(cells: Sequence[Block]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Global index (n,), nodes (n, n_max) and kind (n,) of the cells."""
    foreign = sorted({block.cell for block in cells} - set(SOLIDS))
    if foreign:
        raise InputError("elements that a volume is not compared with", key="experiment.mesh",
                         expected=", ".join(SOLIDS), found=", ".join(foreign), remedy="mesh the specimen with these")
    n_max = max(np.shape(block.connectivity)[1] for block in cells)
    element = np.concatenate([block.first + np.arange(len(block.connectivity)) for block in cells])
    conn = np.concatenate([np.pad(np.asarray(block.connectivity, dtype=np.int64),
                                  ((0, 0), (0, n_max - np.shape(block.connectivity)[1]))) for block in cells])
    kind = np.concatenate([np.full(len(block.connectivity), SOLIDS.index(block.cell)) for block in cells])
    return element, conn, kind


def _block_order(nodes_px: np.ndarray, conn: np.ndarray, kind: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The elements in the order of their blocks, and the block of each  # (n,), (n,)"""
    used = np.arange(conn.shape[1]) < N_SOLID_NODES[kind][:, None]
    middle = (nodes_px[conn] * used[:, :, None]).sum(axis=1) / used.sum(axis=1)[:, None]  # (n, 3)
    low = nodes_px.min(axis=0)
    extent = np.maximum(np.ptp(nodes_px, axis=0), 1.0)
    parts = _parts(extent)
    cell = np.minimum((middle - low) / extent * parts, parts - 1).astype(int)
    group = (cell[:, 2] * parts[1] + cell[:, 1]) * parts[0] + cell[:, 0]
    order = np.argsort(group, kind="stable")
    return order, group[order]


def _parts(extent: np.ndarray) -> np.ndarray:
    """Blocks along each axis: of all that are small enough those with the least voxels and halo  # (3,)"""
    most = np.maximum(extent // LEAST_BLOCK_PX, 1).astype(int)
    parts = np.stack(np.meshgrid(*(np.arange(1, n + 1) for n in most), indexing="ij"), axis=-1).reshape(-1, 3)
    size = (extent / parts).prod(axis=1)
    allowed = size <= max(VOXELS_PER_BLOCK, size.min())
    with_halo = (extent / parts + HALO_PX).prod(axis=1) * parts.prod(axis=1)
    return parts[np.argmin(np.where(allowed, with_halo, np.inf))]


def _positions(geometry: np.ndarray, kind: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Positions of one place in each element  # (n_elements, 3) -> (n_elements, 3) voxels"""
    out = np.empty((len(geometry), 3))
    for k in np.unique(kind):
        n, of_kind = N_SOLID_NODES[k], kind == k
        powers = (places[of_kind][:, None, :] ** POWERS[k][None]).prod(axis=2)
        out[of_kind] = np.einsum("ecm,em->ec", geometry[of_kind][:, :, :n], powers)
    return out


def _inverse_jacobians(geometry: np.ndarray, kind: np.ndarray) -> np.ndarray:
    """d place / d voxel in the middle of each cell  # (n_elements, 3, 3)"""
    out = np.empty((len(geometry), 3, 3))
    for k in np.unique(kind):
        n, of_kind = N_SOLID_NODES[k], kind == k
        out[of_kind] = np.linalg.inv(geometry[of_kind][:, :, :n] @ monomial_slopes(k, MIDDLES[k][None])[0])
    return out


def _is_affine(geometry: np.ndarray, kind: np.ndarray) -> np.ndarray:
    """Whether the edges are straight and opposite ones parallel: beyond the linear terms there is nothing."""
    return np.abs(geometry[:, :, 4:]).sum(axis=2).max(axis=1, initial=0.0) < MAX_BEND


def _runs(geometry: np.ndarray, kind: np.ndarray, corners: np.ndarray, shape: tuple[int, int, int],
          border: int) -> tuple[np.ndarray, np.ndarray]:
    """Runs of the voxels of every element, and the element of each  # (n_runs, 4) int32, (n_runs,)"""
    used = np.arange(corners.shape[1]) < N_SOLID_NODES[kind][:, None]
    low = np.where(used[:, :, None], corners, np.inf).min(axis=1)
    high = np.where(used[:, :, None], corners, -np.inf).max(axis=1)
    slack = np.where(N_SOLID_NODES[kind] > 8, 0.125, 0.0)[:, None] * (high - low)  # a curved face bulges
    farthest = np.array(shape)[::-1] - 1 - border
    first = np.clip(np.ceil(low - slack - 1.0), border, farthest + 1).astype(np.int64)
    end = np.clip(np.floor(high + slack + 1.0), border - 1, farthest).astype(np.int64)
    rows = np.maximum(end - first + 1, 0)
    capacity = int((rows[:, 1] * rows[:, 2]).sum())
    affine, inverse = _is_affine(geometry, kind), _inverse_jacobians(geometry, kind)
    while True:
        run, owner = np.empty((capacity, 4), dtype=np.int32), np.empty(capacity, dtype=np.int32)
        n = _find_runs(geometry, kind, N_SOLID_NODES, _EXPONENTS, MIDDLES, first, end, BESIDE, affine, inverse, run,
                       owner)
        if n >= 0:
            return run[:n].copy(), owner[:n].copy()
        capacity *= 2  # a row can leave a curved element and enter it again


def _kept(run: np.ndarray, owner: np.ndarray, shape: tuple[int, int, int], margin: int,
          mask: ReadMask | None) -> tuple[np.ndarray, np.ndarray]:
    """The runs less voxels outside the mask, and less `margin` voxels along the surface of the others."""
    if (margin == 0 and mask is None) or not len(run):
        return run, owner
    thickness = max(1, int(VOXELS_PER_BLOCK // (shape[1] * shape[2])))
    pieces, owners, number = [], [], []
    by_slice = np.argsort(run[:, 2], kind="stable")
    slices = run[by_slice, 2]
    for first in range(int(slices[0]), int(slices[-1]) + 1, thickness):
        stop = min(first + thickness, int(slices[-1]) + 1)
        low, high = max(first - margin, 0), min(stop + margin, shape[0])
        around = by_slice[np.searchsorted(slices, low):np.searchsorted(slices, high)]
        inside = np.zeros((high - low, shape[1], shape[2]), dtype=np.uint8)
        _paint(run, around, low, inside)
        if mask is not None:
            inside &= np.asarray(mask(slice(low, high), slice(0, shape[1]), slice(0, shape[2])), dtype=bool)
        for axis in range(3) if margin else ():
            inside = scipy.ndimage.minimum_filter1d(inside, 2 * margin + 1, axis=axis, mode="nearest")
        inner = by_slice[np.searchsorted(slices, first):np.searchsorted(slices, stop)]
        capacity = int(run[inner, 3].sum()) // 2 + len(inner) + 1
        out, source = np.empty((capacity, 4), dtype=np.int32), np.empty(capacity, dtype=np.int64)
        n = _split(run, inner, low, inside, out, source)
        pieces.append(out[:n].copy())
        owners.append(owner[source[:n]])
        number.append(source[:n].copy())
    order = np.argsort(np.concatenate(number), kind="stable")
    return np.concatenate(pieces)[order], np.concatenate(owners)[order]


def _padded_exponents() -> np.ndarray:
    table = np.zeros((len(SOLIDS), N_TERMS, 3), dtype=np.int64)
    for kind, powers in enumerate(POWERS):
        table[kind, :len(powers)] = powers
    return table


_EXPONENTS = _padded_exponents()


@njit(cache=True, nogil=True)
def _place(geometry, n, exponents, x, y, z, place):
    """Newton for the place in a cell of a position; False: not found.

    geometry (3, n_max) monomial coefficients; place (3,): where to begin, and the result
    """
    power = np.empty((3, 3))
    slope = np.empty((3, 3))
    J = np.empty((3, 3))
    for _ in range(25):
        for d in range(3):
            power[d, 0], power[d, 1], power[d, 2] = 1.0, place[d], place[d] * place[d]
            slope[d, 0], slope[d, 1], slope[d, 2] = 0.0, 1.0, 2.0 * place[d]
        rx, ry, rz = x, y, z
        J[:] = 0.0
        for m in range(n):
            i, j, k = exponents[m]
            value = power[0, i] * power[1, j] * power[2, k]
            by_a = slope[0, i] * power[1, j] * power[2, k]
            by_b = power[0, i] * slope[1, j] * power[2, k]
            by_c = power[0, i] * power[1, j] * slope[2, k]
            rx -= geometry[0, m] * value
            ry -= geometry[1, m] * value
            rz -= geometry[2, m] * value
            for c in range(3):
                J[c, 0] += geometry[c, m] * by_a
                J[c, 1] += geometry[c, m] * by_b
                J[c, 2] += geometry[c, m] * by_c
        det = (J[0, 0] * (J[1, 1] * J[2, 2] - J[1, 2] * J[2, 1]) - J[0, 1] * (J[1, 0] * J[2, 2] - J[1, 2] * J[2, 0])
               + J[0, 2] * (J[1, 0] * J[2, 1] - J[1, 1] * J[2, 0]))
        if det == 0.0:
            return False
        da = (rx * (J[1, 1] * J[2, 2] - J[1, 2] * J[2, 1]) - J[0, 1] * (ry * J[2, 2] - J[1, 2] * rz)
              + J[0, 2] * (ry * J[2, 1] - J[1, 1] * rz)) / det
        db = (J[0, 0] * (ry * J[2, 2] - J[1, 2] * rz) - rx * (J[1, 0] * J[2, 2] - J[1, 2] * J[2, 0])
              + J[0, 2] * (J[1, 0] * rz - ry * J[2, 0])) / det
        dc = (J[0, 0] * (J[1, 1] * rz - ry * J[2, 1]) - J[0, 1] * (J[1, 0] * rz - ry * J[2, 0])
              + rx * (J[1, 0] * J[2, 1] - J[1, 1] * J[2, 0])) / det
        place[0] += da
        place[1] += db
        place[2] += dc
        if not (abs(place[0]) < 10.0 and abs(place[1]) < 10.0 and abs(place[2]) < 10.0):
            return False
        if abs(da) + abs(db) + abs(dc) < 1e-10:
            return True
    return False


@njit(cache=True, nogil=True)
def _is_inside(kind, place):
    a, b, c = place[0], place[1], place[2]
    if kind == 0 or kind == 2:
        return a >= 0.0 and b >= 0.0 and c >= 0.0 and a + b + c <= 1.0
    return -1.0 <= a <= 1.0 and -1.0 <= b <= 1.0 and -1.0 <= c <= 1.0


@njit(cache=True, nogil=True)
def _find_runs(geometry, kind, n_nodes, exponents, middles, first, end, offsets, affine, inverse, run, owner):
    """Fill the runs of all elements; returns their number, -1 where there are more than fit."""
    count, place, centre = 0, np.empty(3), np.empty(3)
    for e in range(len(geometry)):
        n = n_nodes[kind[e]]
        for d in range(3):  # where the middle of the cell is
            centre[d] = geometry[e, d, 0]
            for m in range(1, 4):
                centre[d] += geometry[e, d, m] * middles[kind[e], m - 1]
        for z in range(first[e, 2], end[e, 2] + 1):
            for y in range(first[e, 1], end[e, 1] + 1):
                open_run, is_near = False, False
                for x in range(first[e, 0], end[e, 0] + 1):
                    px, py, pz = x + offsets[0], y + offsets[1], z + offsets[2]
                    if affine[e]:
                        is_near = True
                        gx, gy, gz = px - centre[0], py - centre[1], pz - centre[2]
                        for d in range(3):
                            place[d] = (middles[kind[e], d] + inverse[e, d, 0] * gx + inverse[e, d, 1] * gy
                                        + inverse[e, d, 2] * gz)
                    else:
                        if not is_near:
                            place[:] = middles[kind[e]]
                        is_near = _place(geometry[e], n, exponents[kind[e]], px, py, pz, place)
                    if is_near and _is_inside(kind[e], place):
                        if open_run:
                            run[count - 1, 3] += 1
                        elif count == len(run):
                            return -1
                        else:
                            run[count, 0], run[count, 1], run[count, 2], run[count, 3] = x, y, z, 1
                            owner[count] = e
                            count += 1
                            open_run = True
                    else:
                        open_run = False
    return count


@njit(cache=True, nogil=True)
def _fill_table(elements, geometry, kind, n_nodes, exponents, middles, run_start, run, table_start, table):
    """Places of the voxels of curved elements."""
    place = np.empty(3)
    for e in elements:
        k = table_start[e]
        for j in range(run_start[e], run_start[e + 1]):
            place[:] = middles[kind[e]]
            for i in range(run[j, 3]):
                _place(geometry[e], n_nodes[kind[e]], exponents[kind[e]], float(run[j, 0] + i), float(run[j, 1]),
                       float(run[j, 2]), place)
                for d in range(3):
                    table[d, k] = np.int16(np.rint(min(max(place[d], -1.02), 1.02) * TABLE_SCALE))
                k += 1


@njit(cache=True, nogil=True)
def _paint(run, numbers, low, inside):
    for j in numbers:
        for x in range(run[j, 0], run[j, 0] + run[j, 3]):
            inside[run[j, 2] - low, run[j, 1], x] = 1


@njit(cache=True, nogil=True)
def _split(run, numbers, low, inside, out, source):
    """The parts of runs that are inside; returns their number."""
    count = 0
    for j in numbers:
        open_run = False
        for x in range(run[j, 0], run[j, 0] + run[j, 3]):
            if inside[run[j, 2] - low, run[j, 1], x]:
                if open_run:
                    out[count - 1, 3] += 1
                else:
                    out[count, 0], out[count, 1], out[count, 2], out[count, 3] = x, run[j, 1], run[j, 2], 1
                    source[count] = j
                    count += 1
                    open_run = True
            else:
                open_run = False
    return count
