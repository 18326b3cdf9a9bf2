"""Sums over the columns of a cross-section, carried to the nodes (docs/method.md, equation 9.5).

    L phi = g_x phi_u - phi_h,      g_x = (f_x + dh/dx) / (1 + du/dx)

u and h depend on the image column only, so M and b need no more of the pixels than the column sums of 1, f_x, f_x^2, r
and r f_x. Edge elements give the slope of the bulge, dh/dx, exactly column by column.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import sparse

from idic.correlation.pixels.section_map import SectionMap

LEVELLING = {"none": 0, "frame": 1, "tilt": 3}  # number of columns


@dataclass(frozen=True, eq=False)
class ColumnSums:
    """Sums over the valid rows of every column of 1, f_x, f_x^2, y, y f_x, y^2  # (n_columns,) each

    y : row in half image heights from the middle.
    """

    count: np.ndarray
    fx: np.ndarray
    fxfx: np.ndarray
    y: np.ndarray
    yfx: np.ndarray
    yy: np.ndarray

    def seen(self, columns: np.ndarray) -> ColumnSums:
        """The same with the other columns emptied  # columns (n_columns,) bool"""
        return ColumnSums(*(np.where(columns, value, 0.0) for value in vars(self).values()))


@dataclass(frozen=True, eq=False)
class SectionMotion:
    """Motion at the columns: u (px along the image row) and h (height), and their slopes per px  # (n_columns,) each"""

    section_map: SectionMap
    u: np.ndarray
    h: np.ndarray
    du: np.ndarray
    dh: np.ndarray

    @property
    def stretch(self) -> np.ndarray:
        """1 + du/dx, kept away from zero."""
        return np.maximum(1.0 + self.du, 1e-3)

    @cached_property
    def pull_back(self) -> np.ndarray:
        """What takes a nodal field of the frame to the reference: L = f_x v - (h' - h_x v), v = u' / (1 + u_x)

        Means over the columns around each node; the identity where there is none.

        Returns
        -------
        array (n_nodes, 3, 3)
        """
        section = self.section_map
        values = np.stack([1.0 / self.stretch, section.side * self.dh / self.stretch], axis=1)
        total, size = np.zeros((section.n_nodes, 2)), np.zeros(section.n_nodes)
        for nodes, weight in zip(section.conn.T, section.weight.T**2, strict=True):
            np.add.at(total, nodes, weight[:, None] * values)
            np.add.at(size, nodes, weight)
        inside = size > 0.0
        matrices = np.tile(np.eye(3), (section.n_nodes, 1, 1))
        matrices[inside, 0, 0] = total[inside, 0] / size[inside]
        matrices[inside, 2, 0] = -total[inside, 1] / size[inside]
        return matrices


def section_motion(section_map: SectionMap, motion: np.ndarray) -> SectionMotion:
    """Nodal motion at the columns, mirrored where they show the other half  # motion (n_nodes, 3)"""
    if not np.isfinite(motion).all():
        raise ValueError("the nodal displacement is not finite")
    field = motion[:, [0, 2]]
    value, slope = section_map.at_columns(field), section_map.slope_at_columns(field)
    side = section_map.side
    return SectionMotion(section_map, side * value[:, 0], value[:, 1], side * slope[:, 0], slope[:, 1])


def column_sums(fx: np.ndarray, valid: np.ndarray, y: np.ndarray) -> ColumnSums:
    """Sums over the valid rows of every column  # fx, valid (ny, n_columns), y (ny,)"""
    slope, row = np.where(valid, fx, 0.0).astype(float), y[:, None] * valid
    return ColumnSums(valid.sum(axis=0).astype(float), slope.sum(axis=0), (slope**2).sum(axis=0), row.sum(axis=0),
                      (row * slope).sum(axis=0), (row * y[:, None]).sum(axis=0))


def nodal_sums(pm: SectionMap, moved: SectionMotion, sums: np.ndarray,
               total: ColumnSums) -> tuple[np.ndarray, sparse.csr_array]:
    """q (3 n_nodes,) and H (3 n_nodes, 3 n_nodes) of a frame, from its column sums (docs/method.md, equation 9.5).

    sums : (n_columns, N_SUMS) of `section_pass.section_sums`; total : over the rows that the frame shows.
    """
    along, slope = pm.side / moved.stretch, moved.dh
    rhs = np.stack([along * (sums[:, 1] + slope * sums[:, 0]), -sums[:, 0]], axis=1)  # (n_columns, 2)
    gg = along**2 * (total.fxfx + 2.0 * slope * total.fx + slope**2 * total.count)
    g1 = -along * (total.fx + slope * total.count)
    start, dofs = pm.first_columns, pm.edge_dofs
    q_edge = np.add.reduceat((pm.weight[:, :, None] * rhs[:, None, :]).reshape(-1, 6), start)
    parts = np.add.reduceat(np.stack([gg, g1, total.count], axis=1)[:, :, None] * pm.pairs[:, None, :], start)
    h_edge = parts.reshape(-1, 3, 3, 3)[:, [[0, 1], [1, 2]]].transpose(0, 3, 1, 4, 2)  # (n_edges, node, c, node, c)
    size = 3 * pm.n_nodes
    q = np.bincount(dofs.ravel(), q_edge.ravel(), size)
    index = (np.repeat(dofs, 6, axis=1).ravel(), np.tile(dofs, (1, 6)).ravel())
    return q, sparse.coo_array((h_edge.ravel(), index), shape=(size, size)).tocsr()


def levelling_blocks(pm: SectionMap, x: np.ndarray, moved: SectionMotion, sums: np.ndarray, total: ColumnSums,
                     levelling: str) -> tuple[sparse.csr_array, np.ndarray, np.ndarray]:
    """Coupling of the nodes with the levelling columns (3 n_nodes, nb), the columns' own block and right-hand side.

    x : (n_columns,) column in half image widths from the middle
    """
    nb = LEVELLING[levelling]
    size = 3 * pm.n_nodes
    if nb == 0:
        return sparse.csr_array((size, 0)), np.zeros((0, 0)), np.zeros(0)
    along = pm.side / moved.stretch
    ones = [total.count, x * total.count, total.y]  # sums of the levels, and of the levels times f_x
    slopes = [total.fx, x * total.fx, total.yfx]
    coupling = np.zeros((size, nb))
    for b in range(nb):
        pair = np.stack([-along * (slopes[b] + moved.dh * ones[b]), ones[b]], axis=1)  # (n_columns, 2)
        nodal = np.einsum("ka,kc->kac", pm.weight, pair)
        np.add.at(coupling[:, b], 3 * pm.conn[:, :, None] + [0, 2], nodal)
    block = np.array([[total.count.sum(), ones[1].sum(), ones[2].sum()],
                      [ones[1].sum(), (x * ones[1]).sum(), (x * total.y).sum()],
                      [ones[2].sum(), (x * total.y).sum(), total.yy.sum()]])[:nb, :nb]
    rhs = -np.array([sums[:, 0].sum(), x @ sums[:, 0], sums[:, 3].sum()])[:nb]
    return sparse.csr_array(coupling), block, rhs
