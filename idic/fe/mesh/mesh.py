"""The mesh as read: nodes, blocks of equal cells, named sets; its visible part and its boundary."""

from __future__ import annotations

import weakref
from collections import defaultdict
from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass, field
from typing import Any, TypeVar

import numpy as np

from idic.errors import InputError
from idic.fe.mesh.element import HALVED_AS, QUADRATIC, RAISED_BY_DEFAULT, Cell, cell_type

Found = TypeVar("Found")


@dataclass(frozen=True)
class Block:
    """Elements of one kind.

    Attributes
    ----------
    cell : str
        "tri3", "tri6", "quad4", "quad8", "tet4", "tet10", "hex8" or "hex20".
    connectivity : (n_elements, n_nodes_per_element) int
        Node indices, counter-clockwise (2D), mid-side nodes last.
    first : int
        Global index of the first element of the block.
    """

    cell: str
    connectivity: np.ndarray
    first: int = 0

    @property
    def kind(self) -> Cell:
        return cell_type(self.cell)

    @property
    def n_elements(self) -> int:
        return len(self.connectivity)

    def jacobian_ratios(self, nodes_before: np.ndarray, nodes_after: np.ndarray, n_nodes: int) -> np.ndarray:
        """det dX/dxi with other nodes over that before, at integration points and the first `n_nodes` nodes of every
        element  # (n_elements, n_points)"""
        points = np.concatenate([self.kind.quadrature_rule()[0], self.kind.reference_nodes[:n_nodes]])
        slopes = self.kind.shape_gradients(points)
        new_volume, old_volume = (np.linalg.det(np.einsum("eai,qaj->eqij", x[self.connectivity], slopes))
                                  for x in (nodes_after, nodes_before))
        return new_volume / old_volume


@dataclass(frozen=True)
class Mesh:
    """A finite-element mesh.

    Attributes
    ----------
    nodes : (n_nodes, 2 or 3) mm
    blocks : tuple of Block
        Elements are numbered globally, block after block.
    node_sets : {name: (n,) node indices}
    element_sets : {name: (n,) global element indices}
    edge_sets : {name: (n, 2) [global element index, local edge (2D) or face (3D)]}
    node_labels, element_labels : (n,) int
        Numbers as in the file, used in messages; None: 1, 2, 3, ...
    """

    nodes: np.ndarray
    blocks: tuple[Block, ...]
    node_sets: Mapping[str, np.ndarray] = field(default_factory=dict)
    element_sets: Mapping[str, np.ndarray] = field(default_factory=dict)
    edge_sets: Mapping[str, np.ndarray] = field(default_factory=dict)
    node_labels: np.ndarray | None = None
    element_labels: np.ndarray | None = None

    def __post_init__(self):
        first = 0
        for block in self.blocks:
            if block.first != first:
                raise ValueError(f"block {block.cell} starts at element {block.first}, expected {first}")
            first += block.n_elements
        if self.node_labels is None:
            object.__setattr__(self, "node_labels", np.arange(1, len(self.nodes) + 1))
        if self.element_labels is None:
            object.__setattr__(self, "element_labels", np.arange(1, first + 1))

    @property
    def n_dim(self) -> int:
        return self.nodes.shape[1]

    @property
    def n_nodes(self) -> int:
        return len(self.nodes)

    @property
    def n_elements(self) -> int:
        return sum(block.n_elements for block in self.blocks)

    @property
    def size(self) -> float:
        """Largest extent along an axis."""
        return float(np.ptp(self.nodes, axis=0).max())

    def labels_of(self, elements: np.ndarray) -> tuple[int, ...]:
        """Labels of elements in the mesh file."""
        return tuple(int(label) for label in self.element_labels[elements])

    def block_of(self, element_index: int) -> Block:
        """The block that holds a global element index."""
        for block in self.blocks:
            if block.first <= element_index < block.first + block.n_elements:
                return block
        raise IndexError(f"element index {element_index} of {self.n_elements}")

    def face_nodes(self, face: tuple[int, int]) -> np.ndarray:
        """Node indices of one [element, local face], corners first, outward orientation."""
        block = self.block_of(int(face[0]))
        local = block.kind.faces[int(face[1])]
        return block.connectivity[int(face[0]) - block.first, list(local)]

    def check_elements(self) -> None:
        """Raise InputError, naming labels, if an element is inverted, degenerate or refers to a missing node."""
        for block in self.blocks:
            if block.connectivity.size and (block.connectivity.min() < 0 or block.connectivity.max() >= self.n_nodes):
                raise InputError(f"a {block.cell} element refers to a node that does not exist",
                                 expected=f"node indices 0 to {self.n_nodes - 1}", found=f"{block.connectivity.max()}",
                                 remedy="check the element table of the mesh file")
            cell = block.kind
            if cell.dim != self.n_dim:
                continue
            points = np.concatenate([cell.quadrature_rule()[0], cell.reference_nodes[:cell.n_corners]])
            jac = np.einsum("eai,qaj->eqij", self.nodes[block.connectivity], cell.shape_gradients(points))
            with np.errstate(over="ignore", invalid="ignore"):  # coordinates of 1e300 have no area to be written
                det = np.linalg.det(jac)
            size = np.abs(det).max(axis=1)
            bad = np.flatnonzero(~(det.min(axis=1) > 1e-9 * np.maximum(size, 1e-300)))
            if len(bad):
                labels = self.element_labels[block.first + bad]
                raise InputError(f"{len(bad)} {block.cell} element(s) are inverted or have no area",
                                 expected="corner nodes counter-clockwise (2D) or bottom face, then top (3D), "
                                 "no angle of 180 degrees or more",
                                 found="elements " + ", ".join(map(str, labels[:10])) + " ..." * (len(bad) > 10),
                                 remedy="reverse their node order, or repair the mesh")

    def boundary_faces(self, blocks: tuple[Block, ...] | None = None) -> np.ndarray:
        """Faces (edges in 2D) that belong to one element only  # (n, 2) [global element index, local face]"""
        owners = defaultdict(list)
        for block in self.blocks if blocks is None else blocks:
            cell = block.kind
            if cell.dim != self.n_dim:
                continue
            for k, local in enumerate(cell.faces):
                keys = np.sort(block.connectivity[:, list(local[:cell.n_face_corners])], axis=1)
                for e, key in enumerate(map(tuple, keys)):
                    owners[key].append((block.first + e, k))
        faces = [sides[0] for sides in owners.values() if len(sides) == 1]
        return np.array(sorted(faces), dtype=np.int64).reshape(-1, 2)

    def boundary_edges(self) -> list[np.ndarray]:
        """Closed boundary loops of a 2D mesh: the outer one first, then the holes.

        Returns
        -------
        list of (n, 2) [global element index, local edge], in walking order (material on the left). The outer loop is
        the one of the largest enclosed area; a body in several pieces has several, each a counter-clockwise one.
        """
        if self.n_dim != 2:
            raise ValueError("boundary_edges is for 2D meshes; use boundary_faces for solids")
        faces = self.boundary_faces()
        ends = np.array([self.face_nodes(f)[:2] for f in faces]).reshape(-1, 2)
        outgoing = defaultdict(list)
        for k, start in enumerate(ends[:, 0]):
            outgoing[start].append(k)
        loops = []
        while outgoing:
            start = next(iter(outgoing))
            node, loop = start, []
            while node in outgoing:
                k = outgoing[node].pop()
                if not outgoing[node]:
                    del outgoing[node]
                loop.append(k)
                node = ends[k, 1]
                if node == start:
                    break
            loops.append(faces[loop])
        return sorted(loops, key=lambda loop: -_enclosed_area(self, loop))

    def boundary_paths(self) -> list[list[int]]:
        """Nodes of the closed boundary loops of a plane mesh in walking order, as `boundary_edges` has them."""
        # an edge names its middle last; its end is the start of the next one
        return [[int(node) for face in loop for nodes in [self.face_nodes(face)] for node in (nodes[0], *nodes[2:])]
                for loop in self.boundary_edges()]

    def face_set_nodes(self, faces: np.ndarray) -> np.ndarray:
        """Sorted node indices of a set of faces (n, 2)."""
        if len(faces) == 0:
            return np.zeros(0, dtype=np.int64)
        return np.unique(np.concatenate([self.face_nodes(f) for f in faces]))

    def surface_cells(self, surface_set: str | None = None) -> list[Block]:
        """What the camera sees: the 2D blocks themselves, or the faces of a solid as plane cells into its 3D nodes.

        Parameters
        ----------
        surface_set : str, optional
            Solid: name of the face set that faces the camera; needed there. Plane-strain sections seen from above have
            an edge set: the caller treats that case.

        Raises
        ------
        InputError
            If a solid's face set is missing or unknown.
        """
        if self.n_dim == 2:
            return [block for block in self.blocks if block.kind.dim == 2]
        if surface_set is None or surface_set not in self.edge_sets:
            raise InputError("a solid needs the face set that the camera sees", key="experiment.surface",
                             expected="one of: " + (", ".join(self.edge_sets) or "(the mesh has no face sets)"),
                             found=str(surface_set), remedy="name a face set of the mesh file in `surface`")
        faces = np.asarray(self.edge_sets[surface_set])
        if len(faces) == 0:
            raise InputError(f"face set {surface_set} is empty", key="experiment.surface",
                             remedy="choose a face set with faces in it")
        return self.face_cells(faces)

    def face_cells(self, faces: np.ndarray) -> list[Block]:
        """Faces (n, 2) of a solid as plane cells into its nodes, numbered kind by kind."""
        kinds = np.array([self.block_of(int(e)).kind.face_cell for e in faces[:, 0]])
        blocks, first = [], 0
        for kind in dict.fromkeys(kinds.tolist()):
            nodes = np.array([self.face_nodes(f) for f in faces[kinds == kind]], dtype=np.int64)
            blocks.append(Block(kind, nodes, first))
            first += blocks[-1].n_elements
        return blocks

    @property
    def smallest_angle(self) -> float:
        """The smallest corner angle of all elements, in degrees."""
        angles = []
        for block in self.blocks:
            corners = self.nodes[block.connectivity[:, : block.kind.n_corners]]
            ahead, back = np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners
            cosine = (ahead * back).sum(axis=-1) / (np.linalg.norm(ahead, axis=-1) * np.linalg.norm(back, axis=-1))
            angles.append(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))).min())
        return float(min(angles))

    @property
    def can_raise_order(self) -> bool:
        """Whether every element has a quadratic counterpart (tri3, quad4, tet4, hex8)."""
        return all(block.cell in QUADRATIC for block in self.blocks)

    @property
    def is_raised_by_default(self) -> bool:
        """Whether every element is of a kind that is computed as its quadratic counterpart unless another order is
        asked for."""
        return all(block.cell in RAISED_BY_DEFAULT for block in self.blocks)

    @property
    def can_halve(self) -> bool:
        """Whether every element can be divided (all but tetrahedra)."""
        return all(block.cell in HALVED_AS for block in self.blocks)

    def jacobian_ratios(self, nodes: np.ndarray) -> np.ndarray:
        """det dX/dxi with other nodes over that of the mesh, at integration points and corners of every element

        Returns
        -------
        (n,)
        """
        return np.concatenate([block.jacobian_ratios(self.nodes, nodes, block.kind.n_corners).ravel()
                               for block in self.blocks])


def make_mesh(nodes: np.ndarray, cells: list[tuple[str, np.ndarray]], **sets) -> Mesh:
    """A Mesh from ``[(cell name, connectivity), ...]``: numbers the blocks; `sets` as in :class:`Mesh`."""
    blocks, first = [], 0
    for name, connectivity in cells:
        connectivity = np.ascontiguousarray(connectivity, dtype=np.int64)
        blocks.append(Block(name, connectivity, first))
        first += len(connectivity)
    return Mesh(np.ascontiguousarray(nodes, dtype=float), tuple(blocks), **sets)


def _enclosed_area(mesh: Mesh, loop: np.ndarray) -> float:
    a, b = np.array([mesh.nodes[mesh.face_nodes(f)[:2]] for f in loop]).transpose(1, 0, 2)
    return float(np.sum(a[:, 0] * b[:, 1] - b[:, 0] * a[:, 1]) / 2)  # negative for holes


class PerMesh:
    """Results that belong to one mesh object, kept as long as it lives; meshes are never changed in place."""

    def __init__(self):
        self._known: dict[int, tuple[weakref.ref, dict[Hashable, Any]]] = {}

    def once(self, mesh: Mesh, key: Hashable, make: Callable[[], Found]) -> Found:
        """What `make` returns the first time for this mesh and key; nothing is remembered where it raises."""
        number = id(mesh)
        if number not in self._known or self._known[number][0]() is not mesh:
            registry = self._known
            self._known[number] = weakref.ref(mesh, lambda _: registry.pop(number, None)), {}
        by_key = self._known[number][1]
        if key not in by_key:
            by_key[key] = make()
        return by_key[key]
