"""A mesh of fewer elements whose nodes are among those of the given one, for runs that only have to be near.

In a mesh of quadrilaterals or bricks opposite edges of an element belong together; followed from element to element
they make a layer that runs through the whole body. A layer is taken out by closing it: the two ends of each of its
edges become one node, where one of them was. The result is a mesh again (Borden, Benzley & Shepherd 2002, "sheet
collapse"). The layer that has grown least goes first, so that elements keep their proportions.

Corners of the outline and the borders of every set stay where they are; a layer that cannot be closed without moving
them, or that is all there is between two faces or two borders, stays too: plies of one element each, a loaded strip one
face wide. quad8 become quad4, hex20 hex8.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from idic.fe.mesh.element import cell_type
from idic.fe.mesh.mesh import Block, Mesh

_QUAD = (((0, 1), (3, 2)), ((1, 2), (0, 3)))
_BRICK = (((0, 1), (3, 2), (4, 5), (7, 6)), ((1, 2), (0, 3), (5, 6), (4, 7)), ((0, 4), (1, 5), (2, 6), (3, 7)))
OPPOSITE = {"quad4": _QUAD, "quad8": _QUAD, "hex8": _BRICK, "hex20": _BRICK}  # edges of an element that run alike
LINEAR = {"quad4": "quad4", "quad8": "quad4", "hex8": "hex8", "hex20": "hex8"}
MIN_CORNER_JACOBIAN = 0.1  # of the largest Jacobian of an element, the smallest: else a layer stays
MAX_FLAT_SPREAD = 0.35  # of normals at a node: less spread than about 40 degrees is no corner


@dataclass(frozen=True)
class Coarse:
    """The mesh, and which nodes of the finer one its nodes are  # (n_nodes,)"""

    mesh: Mesh
    nodes: np.ndarray

    @classmethod
    def of(cls, mesh: Mesh, n_elements: int) -> Coarse | None:
        """A mesh of about so many elements, or of as few as can be; None where no layer can be taken out."""
        if mesh.n_elements <= n_elements or any(block.cell not in OPPOSITE for block in mesh.blocks):
            return None
        layers, body = _layers(mesh), _Body(mesh)
        edges, owner = np.concatenate([layer.edges for layer in layers]), np.repeat(
            np.arange(len(layers)), [len(layer.edges) for layer in layers])

        def lengths(at: np.ndarray) -> np.ndarray:
            """Mean length of the edges of every layer."""
            edge_lengths = np.linalg.norm(mesh.nodes[at[edges[:, 1]]] - mesh.nodes[at[edges[:, 0]]], axis=1)
            return np.bincount(owner, edge_lengths) / np.bincount(owner)

        first = lengths(body.at)
        waiting = np.array([layer.can_close for layer in layers])
        while waiting.any() and body.n_elements > n_elements:
            grown = np.where(waiting, np.round(lengths(body.at) / first, 6), np.inf)
            k = int(np.argmin(grown))
            waiting[k] = False
            choices = [candidate for side in (0, 1) if (candidate := body.without(layers[k], side)) is not None]
            if choices:  # onto the side that leaves the shorter neighbours
                body = min(choices,
                           key=lambda candidate: float((lengths(candidate.at) / first)[waiting].max(initial=0.0)))
        return None if body.n_elements == mesh.n_elements else body.as_mesh()


@dataclass(frozen=True)
class _Layer:
    """edges : (n, 2) nodes on the one and on the other side; outer : (n,) whether an edge lies on the boundary;
    elements : (m,) global indices."""

    edges: np.ndarray
    outer: np.ndarray
    elements: np.ndarray
    can_close: bool


def _layers(mesh: Mesh) -> list[_Layer]:
    """All layers. Directed edges that run alike are linked; a layer is found once in either direction."""
    tails, heads, owners, groups, group = [], [], [], [], 0
    for block in mesh.blocks:
        for alike in OPPOSITE[block.cell]:
            for a, b in alike:
                tails.append(block.connectivity[:, a])
                heads.append(block.connectivity[:, b])
                owners.append(block.first + np.arange(block.n_elements))
                groups.append(group + np.arange(block.n_elements))
            group += block.n_elements
    pairs = np.stack([np.concatenate(tails), np.concatenate(heads)], axis=1)
    owners, groups = np.concatenate(owners), np.concatenate(groups)  # group: one direction of one element
    key = pairs[:, 0] * mesh.n_nodes + pairs[:, 1]
    back = pairs[:, 1] * mesh.n_nodes + pairs[:, 0]
    edge_keys, place = np.unique(np.concatenate([key, back]), return_inverse=True)
    forward, backward = place[:len(key)], place[len(key):]
    first = np.unique(groups, return_index=True)[1][groups]  # the first edge of the same direction of the same element
    links = np.concatenate([np.stack([forward, forward[first]]), np.stack([backward, backward[first]])], axis=1)
    n = len(edge_keys)
    _, label = connected_components(sparse.coo_array((np.ones(links.shape[1]), tuple(links)), shape=(n, n)), False)
    outer = _boundary_edges(mesh)
    layers = []
    for number in np.unique(np.minimum(label[forward], label[backward])):
        edges = np.unique(edge_keys[label == number])
        ends = np.stack([edges // mesh.n_nodes, edges % mesh.n_nodes], axis=1)
        of_layer = (label[forward] == number) | (label[backward] == number)
        passes = np.unique(np.stack([owners[of_layer], groups[of_layer]], axis=1), axis=0)[:, 0]
        crossed = len(np.unique(passes)) < len(passes) or len(np.intersect1d(ends[:, 0], ends[:, 1])) > 0
        layers.append(_Layer(ends, np.isin(np.sort(ends, axis=1) @ [mesh.n_nodes, 1], outer), np.unique(passes),
                             not crossed))
    return layers


def _boundary_edges(mesh: Mesh) -> np.ndarray:
    """Edges on the boundary, as lower node times number of nodes plus higher node."""
    ends = []
    for face in mesh.boundary_faces():
        corners = _corners(mesh, face)
        ends += [(corners[k], corners[(k + 1) % len(corners)]) for k in range(len(corners))]
    return np.unique(np.sort(np.array(ends, dtype=np.int64), axis=1) @ [mesh.n_nodes, 1])


def _corners(mesh: Mesh, face: np.ndarray) -> np.ndarray:
    n = mesh.block_of(int(face[0])).kind.n_face_corners
    return mesh.face_nodes(face)[:n]


class _Body:
    """A mesh with some layers closed.

    at : (n_nodes,) which node each node has become; alive : (n_elements,) bool
    """

    def __init__(self, mesh: Mesh):
        self.mesh = mesh
        self.at = np.arange(mesh.n_nodes)
        self.alive = np.ones(mesh.n_elements, dtype=bool)
        self.rank, self.member = _rank(mesh), _membership(mesh)
        self.borders = (_border_of_elements(mesh), _border_of_faces(mesh))

    @property
    def n_elements(self) -> int:
        return int(self.alive.sum())

    def without(self, layer: _Layer, side: int) -> _Body | None:
        """The body with a layer closed onto its one side wherever that is allowed; None where it cannot be."""
        ends = self.at[layer.edges]
        if np.any(ends[:, 0] == ends[:, 1]):
            return None
        key = np.sort(ends, axis=1) @ [self.mesh.n_nodes, 1]
        outer = np.isin(key, key[layer.outer])
        rank, member = self.rank[ends], self.member[ends]  # (n, 2), (n, 2, n_sets)
        if np.any((rank.min(axis=1) > 0) & ~outer):
            return None  # all there is between two faces
        of_elements, of_faces = (border.crossed_by(ends, key) for border in self.borders)
        if np.any(of_elements | (of_faces & outer)):
            return None  # all there is of a set
        onto = [~np.any(member[:, 1 - k] & ~member[:, k], axis=1) & (rank[:, 1 - k] <= rank[:, k]) for k in (0, 1)]
        corners = (rank == self.mesh.n_dim).all(axis=1)
        if np.any(~(onto[0] | onto[1]) | corners):
            return None
        keep = np.where(onto[side], side, 1 - side)
        rows = np.arange(len(ends))
        becomes = np.arange(self.mesh.n_nodes)
        becomes[ends[rows, 1 - keep]] = ends[rows, keep]
        closed = object.__new__(_Body)
        closed.mesh, closed.rank, closed.member, closed.borders = self.mesh, self.rank, self.member, self.borders
        closed.at, closed.alive = becomes[self.at], self.alive.copy()
        closed.alive[layer.elements] = False
        sets = self.mesh.element_sets.values()
        if not closed.alive.any() or any(len(members) and not closed.alive[np.asarray(members)].any()
                                         for members in sets):
            return None
        return closed if closed._has_volume(closed.at != self.at) else None

    def _has_volume(self, moved: np.ndarray) -> bool:
        """Whether no element that is left is inverted, or flat in a corner, by nodes that have moved  # (n_nodes,)"""
        for block in self.mesh.blocks:
            cell = cell_type(LINEAR[block.cell])
            corners = block.connectivity[:, :cell.n_nodes]
            changed = self.alive[block.first:block.first + block.n_elements] & moved[corners].any(axis=1)
            x = self.mesh.nodes[self.at[corners[changed]]]
            gradients = cell.shape_gradients(cell.reference_nodes)
            det = np.linalg.det(np.einsum("eai,qaj->eqij", x, gradients))
            if np.any(det.min(axis=1) < MIN_CORNER_JACOBIAN * det.max(axis=1)):
                return False
        return True

    def as_mesh(self) -> Coarse:
        """The coarser mesh, with all sets."""
        mesh = self.mesh
        cells, labels = [], []
        for block in mesh.blocks:
            alive = self.alive[block.first:block.first + block.n_elements]
            corners = cell_type(LINEAR[block.cell]).n_nodes
            cells.append((LINEAR[block.cell], self.at[block.connectivity[alive][:, :corners]]))
        nodes = np.unique(np.concatenate([connectivity.ravel() for _, connectivity in cells]))
        node_map, first, blocks = np.full(mesh.n_nodes, -1), 0, []
        node_map[nodes] = np.arange(len(nodes))
        for cell, connectivity in cells:
            blocks.append(Block(cell, node_map[connectivity], first))
            first += len(connectivity)
        labels, number = mesh.element_labels[self.alive], np.cumsum(self.alive) - 1  # type: ignore[assignment]
        bare = Mesh(mesh.nodes[nodes], tuple(blocks), node_labels=mesh.node_labels[nodes], element_labels=labels)
        node_sets = {name: node_map[members][node_map[members] >= 0]
                     for name, members in ((n, np.asarray(o)) for n, o in mesh.node_sets.items())}
        elements = {name: number[members[self.alive[members]]] for name, members in
                    ((n, np.asarray(o)) for n, o in mesh.element_sets.items())}
        return Coarse(replace(bare, node_sets=node_sets, element_sets=elements, edge_sets=self._faces(bare, node_map)),
                      nodes)

    def _faces(self, bare: Mesh, node_map: np.ndarray) -> dict[str, np.ndarray]:
        """Boundary faces whose corners are those of a face of the set, after closing."""
        faces = bare.boundary_faces()
        keys = [tuple(sorted(_corners(bare, face))) for face in faces]
        edge_sets = {}
        for name, set_faces in self.mesh.edge_sets.items():
            set_keys = {tuple(sorted(node_map[self.at[_corners(self.mesh, face)]])) for face in np.asarray(set_faces)}
            edge_sets[name] = faces[[key in set_keys for key in keys]]
        return edge_sets


def _rank(mesh: Mesh) -> np.ndarray:
    """0 inside, 1 on a face, 2 on an edge (in 2D: a corner), 3 in a corner of a solid  # (n_nodes,)"""
    normals: dict[int, list[np.ndarray]] = {}
    for face in mesh.boundary_faces():
        corners = _corners(mesh, face)
        x = mesh.nodes[corners]
        if mesh.n_dim == 2:
            normal = np.array([x[1, 1] - x[0, 1], x[0, 0] - x[1, 0]])
        else:
            normal = np.cross(x[2] - x[0], x[-1] - x[1])
        for node in corners:
            normals.setdefault(int(node), []).append(normal / max(np.linalg.norm(normal), 1e-300))
    rank = np.zeros(mesh.n_nodes, dtype=int)
    for node, node_normals in normals.items():
        rank[node] = int((np.linalg.svd(np.array(node_normals),
                                        compute_uv=False) > MAX_FLAT_SPREAD * np.sqrt(len(node_normals))).sum())
    return rank


@dataclass(frozen=True)
class _Border:
    """Where elements, or faces of the outline, of one kind meet those of another; those in the same sets are of a kind.

    nodes : (n_nodes,) bool; edges : (n,) lower node times number of nodes plus higher node
    """

    nodes: np.ndarray
    edges: np.ndarray

    def crossed_by(self, ends: np.ndarray, key: np.ndarray) -> np.ndarray:
        """Whether an edge leads from border to border, and not along it  # (n, 2), (n,) -> (n,) bool"""
        return self.nodes[ends].all(axis=1) & ~np.isin(key, self.edges)

    @classmethod
    def of(cls, n_nodes: int, ends: np.ndarray, kinds: np.ndarray) -> _Border:
        """ends : (n, 2) nodes of all edges of all cells; kinds : (n,) of the cell of each edge"""
        keys, place = np.unique(np.sort(ends, axis=1) @ [n_nodes, 1], return_inverse=True)
        of_nodes, of_edges = _several(n_nodes, ends.ravel(), np.repeat(kinds, 2)), _several(len(keys), place, kinds)
        return cls(of_nodes, keys[of_edges])


def _several(n: int, places: np.ndarray, kinds: np.ndarray) -> np.ndarray:
    """Which of n places have more than one kind  # (m,), (m,) -> (n,) bool"""
    lowest, highest = np.full(n, np.iinfo(np.int64).max), np.full(n, -1)
    np.minimum.at(lowest, places, kinds)
    np.maximum.at(highest, places, kinds)
    return lowest < highest


def _border_of_elements(mesh: Mesh) -> _Border:
    members = np.zeros((mesh.n_elements, len(mesh.element_sets)), dtype=bool)
    for k, indices in enumerate(mesh.element_sets.values()):
        members[np.asarray(indices), k] = True
    kinds = _kinds(members)
    ends, of_edges = [], []
    for block in mesh.blocks:
        for pair in (pair for alike in OPPOSITE[block.cell] for pair in alike):
            ends.append(block.connectivity[:, pair])
            of_edges.append(kinds[block.first:block.first + block.n_elements])
    return _Border.of(mesh.n_nodes, np.concatenate(ends), np.concatenate(of_edges))


def _border_of_faces(mesh: Mesh) -> _Border:
    """In the plane its edges are the faces."""
    faces = mesh.boundary_faces()
    sets = [{tuple(face) for face in np.asarray(members)} for members in mesh.edge_sets.values()]
    kinds = _kinds(np.array([[tuple(face) in members for members in sets] for face in faces], dtype=bool))
    ends, of_edges = [], []
    for face, kind in zip(faces, kinds, strict=True):
        corners = _corners(mesh, face)
        ends.append(np.stack([corners, np.roll(corners, -1)], axis=1))
        of_edges.append(np.full(len(corners), kind))
    return _Border.of(mesh.n_nodes, np.concatenate(ends), np.concatenate(of_edges))


def _kinds(members: np.ndarray) -> np.ndarray:
    """Number of the combination of sets of each row  # (n, n_sets) bool -> (n,)"""
    if not members.shape[1]:
        return np.zeros(len(members), dtype=int)
    return np.unique(members, axis=0, return_inverse=True)[1].ravel()


def _membership(mesh: Mesh) -> np.ndarray:
    """Which sets a node belongs to: node sets, face sets, the elements around it  # (n_nodes, n_sets) bool"""
    sets = [np.asarray(indices) for indices in mesh.node_sets.values()]
    sets += [mesh.face_set_nodes(np.asarray(indices)) for indices in mesh.edge_sets.values()]
    for indices in mesh.element_sets.values():
        inside = np.isin(np.arange(mesh.n_elements), np.asarray(indices))
        sets.append(np.concatenate([b.connectivity[inside[b.first:b.first + b.n_elements]].ravel()
                                    for b in mesh.blocks]))
    member = np.zeros((mesh.n_nodes, len(sets)), dtype=bool)
    for k, indices in enumerate(sets):
        member[indices, k] = True
    return member
