"""A mesh of half the element size: every element divided, fields carried over by the shape functions of their parents.

Triangles and quadrilaterals become four, bricks eight. The body stays as the elements describe it: curved edges of
quadratic elements stay curved, polygons stay polygons.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations, product

import numpy as np
from scipy import sparse

from idic.errors import InputError
from idic.fe.mesh.element import HALVED_AS, cell_type
from idic.fe.mesh.mesh import Block, Mesh

PARTS = 64  # every weight of a corner at a new node is a multiple of 1/64


@dataclass(frozen=True)
class Halved:
    """The finer mesh, and nodal fields of the coarse one on it: ``carry @ field``  # (n_new, n_old), old nodes first"""

    mesh: Mesh
    carry: sparse.csr_array


def halve(mesh: Mesh) -> Halved:
    """The mesh with every element divided.

    New nodes join a node set where it holds all corners of their edge or face and that is an outer one, or holds the
    whole element. Children carry the label of their element.

    Raises
    ------
    InputError
        If there are tetrahedra.
    """
    if not mesh.can_halve:
        raise InputError("tetrahedra are not divided", expected=", ".join(HALVED_AS),
                         found=", ".join(block.cell for block in mesh.blocks), remedy="use a mesh of bricks")
    nodes = _Nodes(mesh)
    blocks, children, first = [], [], 0
    for block in mesh.blocks:
        points = _children(block.cell)  # (n_children, n_nodes, dim)
        connectivity = nodes.add(block, points)
        blocks.append(Block(block.cell, connectivity, first))
        children.append(first + np.arange(len(connectivity)).reshape(block.n_elements, -1))
        first += len(connectivity)
    carry = nodes.carry()
    owner = lambda e: next(n for n, b in enumerate(mesh.blocks) if e < b.first + b.n_elements)  # noqa: E731
    family = lambda e: children[owner(e)][e - mesh.blocks[owner(e)].first]  # noqa: E731
    element_sets = {name: np.concatenate([family(int(e)) for e in np.asarray(members)])
                    for name, members in mesh.element_sets.items()}
    edge_sets = {name: np.array([(family(int(e))[child], child_face) for e, k in np.asarray(members)
                                 for child, child_face in _parts_of_face(mesh.blocks[owner(int(e))].cell, int(k))])
                 for name, members in mesh.edge_sets.items()}
    labels = np.concatenate([np.repeat(mesh.element_labels[b.first:b.first + b.n_elements], len(_children(b.cell)))
                             for b in mesh.blocks])
    fine = replace(mesh, nodes=carry @ mesh.nodes, blocks=tuple(blocks), node_sets=nodes.sets(),
                   element_sets=element_sets, edge_sets=edge_sets, element_labels=labels, node_labels=np.concatenate(
                       [mesh.node_labels, mesh.node_labels.max() + 1 + np.arange(len(nodes.keys) - mesh.n_nodes)]))
    return Halved(fine, carry)


class _Nodes:
    """Nodes of the finer mesh, each known by its corners and their weights: neighbours find the same one."""

    def __init__(self, mesh: Mesh):
        self.mesh = mesh
        self.keys: dict[tuple, int] = {}
        self.rows: list[tuple[np.ndarray, np.ndarray]] = []  # parents and their weights
        self.holders: list[set[int]] = []  # elements around each node
        node_keys: dict[int, tuple] = {}
        for block in mesh.blocks:
            cell = block.kind
            corners = _corners(_corner_weights(block.cell, cell.reference_nodes))
            for nodes in block.connectivity.tolist():
                node_keys.update(zip(nodes, (_key(nodes, point_corners) for point_corners in corners), strict=True))
        for node in range(mesh.n_nodes):
            self._append_node(node_keys.get(node, ((node, -1),)), np.array([node]), np.ones(1))

    def add(self, block: Block, points: np.ndarray) -> np.ndarray:
        """Nodes of the children of a block  # (n_elements * n_children, n_nodes)"""
        flat = points.reshape(-1, points.shape[-1])
        corners, values = _corners(_corner_weights(block.cell, flat)), block.kind.shape_functions(flat)
        connectivity = np.empty((block.n_elements, len(flat)), dtype=np.int64)
        for e, nodes in enumerate(block.connectivity.tolist()):
            for i in range(len(flat)):
                index = self.keys.get(key := _key(nodes, corners[i]))
                connectivity[e, i] = self._append_node(key, np.array(nodes), values[i]) if index is None else index
                self.holders[connectivity[e, i]].add(block.first + e)
        return connectivity.reshape(-1, points.shape[1])

    def _append_node(self, key: tuple, parents: np.ndarray, weights: np.ndarray) -> int:
        self.keys[key] = len(self.rows)
        self.rows.append((parents, weights))
        self.holders.append(set())
        return len(self.rows) - 1

    def carry(self) -> sparse.csr_array:
        sizes = [len(parents) for parents, _ in self.rows]
        rows = np.repeat(np.arange(len(self.rows)), sizes)
        columns, values = (np.concatenate(parts) for parts in zip(*self.rows, strict=True))
        return sparse.csr_array((values, (rows, columns)), shape=(len(self.rows), self.mesh.n_nodes))

    def sets(self) -> dict[str, np.ndarray]:
        outer = set(_outer(self.mesh))
        corners = [frozenset(node for node, _ in key) for key in self.keys]
        element_nodes = {block.first + e: frozenset(nodes) for block in self.mesh.blocks
                         for e, nodes in enumerate(block.connectivity.tolist())}
        node_sets = {}
        for name, members in self.mesh.node_sets.items():
            inside = frozenset(np.asarray(members).tolist())
            new_members = [n for n in range(self.mesh.n_nodes, len(corners)) if corners[n] <= inside
                           and (corners[n] in outer or any(element_nodes[e] <= inside for e in self.holders[n]))]
            node_sets[name] = np.concatenate([np.asarray(members, dtype=np.int64),
                                              np.array(new_members, dtype=np.int64)])
        return node_sets


def _key(nodes: list[int], corners: list[tuple[int, int]]) -> tuple:
    return tuple(sorted([(nodes[i], weight) for i, weight in corners]))


def _corners(weights: np.ndarray) -> list[list[tuple[int, int]]]:
    """The corners that count at every point, with their weights; weights : (n, n_corners) int"""
    return [[(i, int(weight)) for i, weight in enumerate(point_weights) if weight] for point_weights in weights]


def _corner_weights(cell: str, points: np.ndarray) -> np.ndarray:
    """Weights of the corners at reference points, in 1/64  # (n, n_corners) int"""
    return np.rint(PARTS * cell_type(HALVED_AS[cell]).shape_functions(np.asarray(points, dtype=float))).astype(int)


def _children(cell: str) -> np.ndarray:
    """Reference points of the children's nodes  # (n_children, n_nodes, dim)"""
    reference = np.asarray(cell_type(cell).reference_nodes, dtype=float)
    if cell.startswith("tri"):
        shifted = [0.5 * reference + shift for shift in ([0.0, 0.0], [0.5, 0.0], [0.0, 0.5])]
        return np.array([*shifted, 0.5 - 0.5 * reference])
    dim = reference.shape[1]
    return np.array([0.5 * reference + np.array(shift) for shift in product((-0.5, 0.5), repeat=dim)])


def _parts_of_face(cell: str, face: int) -> Iterator[tuple[int, int]]:
    """(child, face of the child) that lie on a face of their parent."""
    faces, n = cell_type(cell).faces, cell_type(cell).n_face_corners
    off = [i for i in range(cell_type(cell).n_corners) if i not in faces[face][:n]]
    for child, points in enumerate(_children(cell)):
        weights = _corner_weights(cell, points)
        for child_face, nodes in enumerate(faces):
            if not weights[np.ix_(list(nodes[:n]), off)].any():
                yield child, child_face


def _outer(mesh: Mesh) -> Iterator[frozenset[int]]:
    """Corners of the outer faces, and of their edges."""
    for face in mesh.boundary_faces():
        n = mesh.block_of(int(face[0])).kind.n_face_corners
        corners = mesh.face_nodes(face)[:n].tolist()
        yield frozenset(corners)
        if n > 2:
            yield from (frozenset(pair) for pair in combinations(corners, 2))
