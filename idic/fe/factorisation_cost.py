"""Fill and operations of a direct solver, counted on the mesh before there is a matrix.

Nested dissection by position (George, 1973, doi:10.1137/0710032): the elements are halved across their longest extent
again and again. The nodes that two halves share are the separators. The front of a separator holds its own dofs, s, and
those of earlier separators around its part, b: s (s + 1) / 2 + s b entries of one triangle and about
s^3 / 3 + s^2 b + s b^2 multiplications. Minimum degree, which SuperLU uses here, fills more; `idic.report.evidence.cost`
knows by how much.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from idic.fe.mesh.mesh import Mesh

_ELEMENTS_OF_A_LEAF = {2: 8, 3: 32}  # by dimension; smaller leaves change the sums by less than a tenth


@dataclass(frozen=True)
class Fill:
    """entries : of one triangular factor; operations : multiplications of the symmetric factorisation"""

    entries: float
    operations: float


def dissected(mesh: Mesh) -> Fill:
    """The fill of the stiffness of a mesh, all dofs free, by nested dissection."""
    centres = np.concatenate([mesh.nodes[block.connectivity].mean(axis=1) for block in mesh.blocks])
    elements = np.concatenate([np.repeat(np.arange(block.first, block.first + block.n_elements),
                                         block.connectivity.shape[1]) for block in mesh.blocks])
    nodes = np.concatenate([block.connectivity.ravel() for block in mesh.blocks])
    order = np.argsort(nodes, kind="stable")
    nodes, elements = nodes[order], elements[order]  # every node with its elements, node after node
    part, entries, operations, size = np.zeros(len(centres), dtype=np.int64), 0.0, 0.0, len(centres)
    taken = np.zeros(mesh.n_nodes, dtype=bool)
    while True:
        last, n_parts = size <= _ELEMENTS_OF_A_LEAF[mesh.n_dim], int(part.max()) + 1
        halves = part if last else 2 * part + _upper_half(centres, part, n_parts)
        chosen = ~taken if last else ~taken & _divided(nodes, halves[elements], mesh.n_nodes)
        s = mesh.n_dim * _counted(part[elements], nodes, chosen, n_parts)
        b = mesh.n_dim * _counted(part[elements], nodes, taken, n_parts)
        entries += float((s * (s + 1) / 2 + s * b).sum())
        operations += float((s**3 / 3 + s**2 * b + s * b**2).sum())
        if last:
            return Fill(entries, operations)
        taken |= chosen
        part, size = halves, (size + 1) // 2


def _upper_half(centres: np.ndarray, part: np.ndarray, n_parts: int) -> np.ndarray:
    """1 for the elements beyond the median of their part along its longest extent, else 0  # (n_elements,)"""
    order = np.argsort(part, kind="stable")
    counts = np.bincount(part, minlength=n_parts)
    starts = np.cumsum(counts) - counts
    extents = np.maximum.reduceat(centres[order], starts) - np.minimum.reduceat(centres[order], starts)
    along = centres[np.arange(len(centres)), np.argmax(extents, axis=1)[part]]
    order = np.lexsort((along, part))
    upper = np.empty(len(part), dtype=np.int64)
    upper[order] = 2 * (np.arange(len(part)) - np.repeat(starts, counts)) >= np.repeat(counts, counts)
    return upper


def _divided(nodes: np.ndarray, parts: np.ndarray, n_nodes: int) -> np.ndarray:
    """True for the nodes whose elements are in several parts; nodes : sorted, with the part of one element each"""
    first = np.flatnonzero(np.diff(nodes, prepend=-1))
    divided = np.zeros(n_nodes, dtype=bool)
    divided[nodes[first]] = np.minimum.reduceat(parts, first) < np.maximum.reduceat(parts, first)
    return divided


def _counted(parts: np.ndarray, nodes: np.ndarray, chosen: np.ndarray, n_parts: int) -> np.ndarray:
    """Number of different chosen nodes at the elements of each part  # (n_parts,) float"""
    inside = chosen[nodes]
    pairs = np.unique(parts[inside] * len(chosen) + nodes[inside])
    return np.bincount(pairs // len(chosen), minlength=n_parts).astype(float)
