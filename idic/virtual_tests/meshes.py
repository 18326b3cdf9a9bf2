"""Structured meshes of the built-in examples, and the Abaqus input file of a mesh.

A mesh is a set of mapped patches, or layers of it; nodes that coincide are merged. The same geometry is meshed twice:
coarsely for the user, finely and quadratically for the truth.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from idic.fe import Mesh, inp_text, make_mesh

MERGE_DISTANCE = 1e-7  # mm: nodes of neighbouring patches closer than this are one node


@dataclass(frozen=True)
class Patch:
    """A mapped rectangle: ``shape(s, t)`` takes arrays in 0…1 to x, y in mm; `n`, `m` elements along s and t."""

    shape: Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]
    n: int
    m: int


def mesh_patches(patches: Sequence[Patch], cell: str) -> tuple[np.ndarray, np.ndarray]:
    """Nodes (n_nodes, 2) mm and connectivity (nel, 4|8) of patches meshed with "quad4" or "quad8"."""
    order = 2 if cell == "quad8" else 1
    points, elements, first = [], [], 0
    for patch in patches:
        s, t = np.meshgrid(
            np.linspace(0, 1, order * patch.n + 1), np.linspace(0, 1, order * patch.m + 1), indexing="ij"
        )
        points.append(np.stack(patch.shape(s, t), axis=-1).reshape(-1, 2))
        elements.append(first + grid_cells(patch.n, patch.m, order))
        first += s.size
    nodes, conn = _merge(np.concatenate(points), np.concatenate(elements))
    return nodes, _counter_clockwise(nodes, conn)


def strip_with_hole(
    length: float,
    width: float,
    radius: float,
    cell: str = "quad4",
    around: int = 6,
    radial: int = 7,
    along: int = 4,
    grading: float = 1.6,
    name: str = "sheet",
) -> Mesh:
    """A strip along x with a central hole; node sets LEFT and RIGHT (its ends), element set `name`.

    Parameters
    ----------
    length, width, radius : float, mm
    around : int
        Elements per eighth of the hole; `radial`: from the hole to the square around it; `along`: from that square
        (of the strip's width) to each end.
    grading : float
        Exponent of the radial spacing; 1: even.
    """
    half = width / 2.0

    def ring(quarter: int):
        def shape(s, t):
            angle = np.pi / 2 * quarter + np.pi / 4 * (2.0 * s - 1.0)
            local = angle - np.pi / 2 * quarter
            blend = t**grading
            inner = radius * np.cos(angle), radius * np.sin(angle)
            c, d = np.cos(np.pi / 2 * quarter), np.sin(np.pi / 2 * quarter)
            x, y = half * np.ones_like(s), half * np.tan(local)
            outer = c * x - d * y, d * x + c * y
            return tuple((1.0 - blend) * i + blend * o for i, o in zip(inner, outer, strict=True))

        return Patch(shape, 2 * around, radial)

    def side(sign: float):
        return Patch(
            lambda s, t: (sign * (half + t * (length / 2 - half)), half * np.tan(np.pi / 4 * (2 * s - 1))),
            2 * around,
            along,
        )

    nodes, conn = mesh_patches([ring(q) for q in range(4)] + [side(1.0), side(-1.0)], cell)
    ends = {
        "LEFT": np.flatnonzero(nodes[:, 0] < -length / 2 + MERGE_DISTANCE),
        "RIGHT": np.flatnonzero(nodes[:, 0] > length / 2 - MERGE_DISTANCE),
    }
    return make_mesh(nodes, [(cell, conn)], node_sets=ends, element_sets={name: np.arange(len(conn))})


def layered(flat: Mesh, planes: np.ndarray, name: str = "BODY") -> Mesh:
    """A flat mesh of quad4 or quad8 as layers of hex8 or hex20 between planes; its node sets go through all of them.

    planes : (n + 1,) heights in mm, increasing
    """
    cell, quads, n = flat.blocks[0].cell, flat.blocks[0].connectivity, len(flat.nodes)
    heights = planes if cell == "quad4" else np.sort(np.concatenate([planes, 0.5 * (planes[1:] + planes[:-1])]))
    step = 1 if cell == "quad4" else 2
    corners = np.unique(quads[:, :4])
    # a brick has no node in the middle of a face
    plane_nodes = [np.arange(n) if k % step == 0 else corners for k in range(len(heights))]
    first = np.cumsum([0, *(len(nodes) for nodes in plane_nodes)])
    number = np.full((len(heights), n), -1)
    for k, indices in enumerate(plane_nodes):
        number[k, indices] = first[k] + np.arange(len(indices))
    nodes = np.concatenate([np.column_stack([flat.nodes[indices], np.full(len(indices), z)])
                            for indices, z in zip(plane_nodes, heights, strict=True)])
    bricks = []
    for k in range(0, len(heights) - 1, step):
        parts = [number[k][quads[:, :4]], number[k + step][quads[:, :4]]]
        if step == 2:
            parts += [number[k][quads[:, 4:]], number[k + 2][quads[:, 4:]], number[k + 1][quads[:, :4]]]
        bricks.append(np.hstack(parts))
    sets = {entry: np.setdiff1d(number[:, members], [-1]) for entry, members in flat.node_sets.items()}
    n_bricks = len(quads) * len(bricks)
    return make_mesh(nodes, [("hex8" if step == 1 else "hex20", np.concatenate(bricks))], node_sets=sets,
                     element_sets={name: np.arange(n_bricks)})


def write_inp(mesh: Mesh, path: Path, title: str) -> None:
    """Write a mesh with its node, element and edge (face) sets as an Abaqus input file (mm)."""
    path.write_text(inp_text(mesh, title), encoding="utf-8")


def grid_cells(n: int, m: int, order: int) -> np.ndarray:
    """Connectivity of an n x m grid of cells on (order n + 1) x (order m + 1) points, s first  # (n m, 4|8)"""
    at = np.arange((order * n + 1) * (order * m + 1)).reshape(order * n + 1, order * m + 1)
    i, j = (order * a.ravel() for a in np.meshgrid(np.arange(n), np.arange(m), indexing="ij"))
    o = order
    corners = [at[i, j], at[i + o, j], at[i + o, j + o], at[i, j + o]]
    if order == 1:
        return np.stack(corners, axis=1)
    return np.stack([*corners, at[i + 1, j], at[i + 2, j + 1], at[i + 1, j + 2], at[i, j + 1]], axis=1)


def _merge(points: np.ndarray, conn: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """One node per place, only those in use, ordered by x then y."""
    keys = np.round(points / MERGE_DISTANCE).astype(np.int64)
    used = np.unique(conn)
    _, first_row, inverse = np.unique(keys[used], axis=0, return_index=True, return_inverse=True)
    number = np.full(len(points), -1)
    number[used] = inverse.ravel()
    return points[used[first_row]], number[conn]


def _counter_clockwise(nodes: np.ndarray, conn: np.ndarray) -> np.ndarray:
    """Cells turned so that their corners run counter-clockwise."""
    x = nodes[conn[:, :4]]
    a, b = x[:, 2] - x[:, 0], x[:, 3] - x[:, 1]
    wrong = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0] < 0
    turned = conn.copy()
    turned[wrong, :4] = conn[wrong][:, [0, 3, 2, 1]]
    if conn.shape[1] == 8:
        turned[wrong, 4:] = conn[wrong][:, [7, 6, 5, 4]]
    return turned
