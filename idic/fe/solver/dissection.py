"""Nested dissection of a mesh by position (George, 1973, doi:10.1137/0710032): elimination order of a direct solver.

The elements are halved across their longest extent again and again. The nodes that two halves share are a separator;
it is eliminated after both halves. Parts that are not halved any more are leaves. Elements are halved between two
layers where that leaves halves of similar size: separators of structured meshes are plane.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

LEAF_ELEMENTS = {2: 8, 3: 32}  # by dimension; the largest part that is not halved
_MIN_HALF = 0.25  # of a part; where a plane cut leaves less, the part is halved by count


@dataclass(frozen=True)
class Incidences:
    """Every node with each of its elements, node after node.

    nodes, elements (n_pairs,) int; centres (n_elements, n_dim) mm
    """

    nodes: np.ndarray
    elements: np.ndarray
    centres: np.ndarray
    n_nodes: int


@dataclass(frozen=True)
class Level:
    """One level of the dissection.

    part (n_elements,) : part of each element, before halving; the halves of part p are 2 p and 2 p + 1
    chosen (n_nodes,) bool : separators between the halves; all nodes left at the last level, those of no element too
    separated (n_nodes,) bool : separators of the levels above
    """

    part: np.ndarray
    chosen: np.ndarray
    separated: np.ndarray


def incidences(coordinates: np.ndarray, connectivities: list[np.ndarray]) -> Incidences:
    """Nodes and elements of blocks of elements.

    coordinates : (n_nodes, n_dim) mm; connectivities : per block (n_elements, nodes per element)
    """
    centres = np.concatenate([coordinates[block].mean(axis=1) for block in connectivities])
    counts = [block.shape for block in connectivities]
    elements = np.repeat(np.arange(len(centres)), np.concatenate([np.full(n, m) for n, m in counts]))
    nodes = np.concatenate([block.ravel() for block in connectivities])
    order = np.argsort(nodes, kind="stable")
    return Incidences(nodes[order], elements[order], centres, len(coordinates))


def dissect(mesh: Incidences) -> Iterator[Level]:
    """Levels from the first cut to the leaves."""
    leaf = LEAF_ELEMENTS[mesh.centres.shape[1]]
    part, separated = np.zeros(len(mesh.centres), dtype=np.int64), np.zeros(mesh.n_nodes, dtype=bool)
    while True:
        is_last = np.bincount(part).max() <= leaf
        halves = part if is_last else 2 * part + _upper_half(mesh.centres, part)
        chosen = ~separated
        if not is_last:
            chosen &= _divided(mesh.nodes, halves[mesh.elements], mesh.n_nodes)
        yield Level(part, chosen, separated)
        if is_last:
            return
        separated, part = separated | chosen, halves


def separators(mesh: Incidences, eliminated: np.ndarray) -> tuple[list[np.ndarray], list[list[int]]]:
    """Nodes of each separator or leaf and the separators or leaves directly below, in elimination order (postorder).

    Parameters
    ----------
    eliminated : (n_nodes,) bool
        The nodes to eliminate.

    Returns
    -------
    per front (n,) int, none empty; per front the numbers of its children
    """
    first = np.flatnonzero(np.diff(mesh.nodes, prepend=-1))
    element = np.zeros(mesh.n_nodes, dtype=np.int64)  # one element of each node
    element[mesh.nodes[first]] = mesh.elements[first]
    levels = []
    for level in dissect(mesh):
        nodes = np.flatnonzero(level.chosen & eliminated)
        part = level.part[element[nodes]]
        order = np.argsort(part, kind="stable")
        parts, starts = np.unique(part[order], return_index=True)
        groups = np.split(nodes[order], starts[1:]) if len(parts) else []
        levels.append((set(np.unique(level.part).tolist()), dict(zip(parts.tolist(), groups, strict=True))))
    fronts: list[np.ndarray] = []
    children: list[list[int]] = []

    def eliminate(depth: int, part: int) -> list[int]:
        """Append all fronts of a part; the numbers of those without a parent in it."""
        if depth == len(levels) or part not in levels[depth][0]:
            return []
        below = eliminate(depth + 1, 2 * part) + eliminate(depth + 1, 2 * part + 1)
        front = levels[depth][1].get(part)
        if front is None:
            return below
        fronts.append(front)
        children.append(below)
        return [len(fronts) - 1]

    eliminate(0, 0)
    return fronts, children


def _upper_half(centres: np.ndarray, part: np.ndarray) -> np.ndarray:
    """1 for the elements in the upper half of their part along its longest extent, else 0  # (n_elements,)"""
    counts = np.bincount(part)
    used = np.flatnonzero(counts)
    place = np.zeros(len(counts), dtype=np.int64)
    place[used] = np.arange(len(used))
    part, counts = place[part], counts[used]  # parts without elements have no extent
    order = np.argsort(part, kind="stable")
    starts = np.cumsum(counts) - counts
    extents = np.maximum.reduceat(centres[order], starts) - np.minimum.reduceat(centres[order], starts)
    along = centres[np.arange(len(centres)), np.argmax(extents, axis=1)[part]]
    extent = extents.max(axis=1)
    along = np.round(along / np.where(extent > 0.0, extent, 1.0)[part], 9)  # a layer of elements has one place
    order = np.lexsort((along, part))
    upper = np.empty(len(part), dtype=np.int64)
    upper[order] = 2 * (np.arange(len(part)) - np.repeat(starts, counts)) >= np.repeat(counts, counts)
    beyond = along > along[order[starts + (counts - 1) // 2]][part]
    share = np.bincount(part, weights=beyond) / counts
    plane = (np.minimum(share, 1.0 - share) >= _MIN_HALF)[part]
    return np.where(plane, beyond, upper)


def _divided(nodes: np.ndarray, parts: np.ndarray, n_nodes: int) -> np.ndarray:
    """True for the nodes whose elements are in several parts; nodes : sorted, with the part of one element each"""
    first = np.flatnonzero(np.diff(nodes, prepend=-1))
    divided = np.zeros(n_nodes, dtype=bool)
    divided[nodes[first]] = np.minimum.reduceat(parts, first) < np.maximum.reduceat(parts, first)
    return divided
