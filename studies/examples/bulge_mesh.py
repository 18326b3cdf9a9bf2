"""Meshes of the bulge test: half the cross-section of a clamped elastomer membrane with a metal strip on top.

x runs from the symmetry axis (0) to the clamp (0.5 mm), y up from the wetted side. Elements are numbered column by
column and from below upwards, so that the edges of a set, in order of elements, run from the axis to the clamp.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from idic.fe import Mesh, make_mesh
from idic.virtual_tests import grid_cells

HALF_WIDTH, HALF_STRIP, FINE_END = 0.5, 0.05, 0.13  # mm: clamp, edge of the strip, end of the fine columns
STRIP_THICKNESS = 0.0002  # mm
BOTTOM, UPPER = 0, 2  # local edges of a quad8 whose first edge lies below


@dataclass(frozen=True)
class Columns:
    """Number of columns of elements under the strip, from there to `FINE_END`, and from there to the clamp.

    `ratios`: largest over smallest width in each part; the finest are at the edge of the strip and at the clamp.
    """

    strip: int
    near: int
    far: int
    ratios: tuple[float, float, float] = (3.0, 3.0, 3.0)


FULL = Columns(73, 85, 127)  # 643 elements, 2506 nodes
BASE = Columns(36, 40, 60)  # 308 elements, 1203 nodes: within 0.05 px of FULL
REDUCED = Columns(12, 10, 20)  # 96 elements: 0.8 px off in height, a tenth of the time


def bulge_mesh(thickness: float, columns: Columns = FULL, layers: int = 2) -> Mesh:
    """A conforming quad8 mesh of the half cross-section.

    Parameters
    ----------
    thickness : float
        Of the elastomer, mm.
    columns : Columns
    layers : int
        Of elements through the elastomer; the strip has one.

    Returns
    -------
    Mesh
        Element sets ``elastomer``, ``strip``; edge sets ``WETTED`` (below), ``TOP`` (what a camera above sees: the
        strip, then the bare elastomer; the upright side of the strip is not part of it); node sets ``AXIS`` (x = 0)
        and ``CLAMP`` (x = 0.5 mm).
    """
    x = np.concatenate([
        -_graded(-HALF_STRIP, 0.0, columns.strip, columns.ratios[0])[::-1],
        _graded(HALF_STRIP, FINE_END, columns.near, columns.ratios[1])[1:],
        HALF_WIDTH + FINE_END - _graded(FINE_END, HALF_WIDTH, columns.far, columns.ratios[2])[::-1][1:],
    ])  # fmt: skip
    y = np.append(np.linspace(0.0, thickness, layers + 1), thickness + STRIP_THICKNESS)
    column, layer = (a.ravel() for a in np.meshgrid(np.arange(len(x) - 1), np.arange(layers + 1), indexing="ij"))
    filled = (layer < layers) | (column < columns.strip)  # the strip is one more layer, on its own columns
    column, layer = column[filled], layer[filled]
    nodes, connectivity = _quad8(x, y, filled)
    elements = np.arange(len(column))
    top = elements[layer == np.where(column < columns.strip, layers, layers - 1)]
    return make_mesh(
        nodes,
        [("quad8", connectivity)],
        node_sets={
            "AXIS": np.flatnonzero(nodes[:, 0] == 0.0),
            "CLAMP": np.flatnonzero(nodes[:, 0] == HALF_WIDTH),
        },
        element_sets={"elastomer": elements[layer < layers], "strip": elements[layer == layers]},
        edge_sets={"WETTED": _edges(elements[layer == 0], BOTTOM), "TOP": _edges(top, UPPER)},
    )


def _graded(start: float, end: float, n: int, ratio: float) -> np.ndarray:
    """n + 1 places from start to end, the widths growing geometrically to `ratio` times the first."""
    widths = ratio ** (np.arange(n) / max(n - 1, 1))
    places = start + (end - start) * np.append(0.0, np.cumsum(widths)) / widths.sum()
    places[-1] = end
    return places


def _quad8(x: np.ndarray, y: np.ndarray, filled: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Nodes (n, 2) mm, numbered by x then y, and connectivity (n_elements, 8) of the present cells of a grid."""
    fine_x, fine_y = (np.insert(a, np.arange(1, len(a)), 0.5 * (a[1:] + a[:-1])) for a in (x, y))
    cells = grid_cells(len(x) - 1, len(y) - 1, 2)[filled]
    used, connectivity = np.unique(cells, return_inverse=True)
    nodes = np.stack([fine_x[used // len(fine_y)], fine_y[used % len(fine_y)]], axis=1)
    return np.round(nodes, 9) + 0.0, connectivity.reshape(-1, 8)  # 1e-9 mm: as a mesh file holds them


def _edges(elements: np.ndarray, local: int) -> np.ndarray:
    return np.stack([elements, np.full(len(elements), local)], axis=1)
