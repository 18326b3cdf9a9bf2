"""The mesh of a file, and its conversion to `idic.fe.mesh.mesh.Mesh`: one dimension, used nodes, internal units."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from idic.errors import InputError
from idic.fe import CELL_TYPES, Mesh, cell_type, make_mesh
from idic.readers.mesh_files.element_orientation import oriented

SUPPORTED = ("tri3", "tri6", "quad4", "quad8", "tet4", "tet10", "hex8", "hex20")
DIMENSION = {"point": 0, "line2": 1, "line3": 1, "tri3": 2, "tri6": 2, "quad4": 2, "quad8": 2, "quad9": 2, "hex8": 3,
             "hex20": 3, "hex27": 3, "tet4": 3, "tet10": 3, "wedge6": 3, "wedge15": 3, "wedge18": 3,
             "pyramid5": 3, "pyramid13": 3, "pyramid14": 3}


@dataclass
class RawMesh:
    """Cells of any dimension; sets of nodes, of cells, and of faces given by their corner nodes.

    Attributes
    ----------
    nodes : array (n, 3), unit of the file
    cells : list of (kind, connectivity (n, nn) node indices, labels (n,))
    element_sets : {name: global cell indices, counted over `cells` in order}
    face_sets : {name: list of corner-node tuples}
    notes : what of the file was left out
    files : all files that were read, where the mesh is in several
    stated_kinds : {element type: the kind of model that it is written for}, where the file says so
    """

    file: Path
    nodes: np.ndarray
    node_labels: np.ndarray
    cells: list[tuple[str, np.ndarray, np.ndarray]] = field(default_factory=list)
    node_sets: dict[str, np.ndarray] = field(default_factory=dict)
    element_sets: dict[str, np.ndarray] = field(default_factory=dict)
    face_sets: dict[str, list[tuple[int, ...]]] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    files: tuple[Path, ...] = ()
    stated_kinds: dict[str, str] = field(default_factory=dict)

    def to_mesh(self, n_dim: int, factor: float) -> tuple[Mesh, list[str]]:
        """The cells of dimension `n_dim` as a Mesh, and notes on omitted parts.

        Cells of dimension ``n_dim - 1`` become edge (face) sets, cells of lower dimension node sets. Unused nodes are
        dropped, and so is z in two dimensions.

        Parameters
        ----------
        factor : float
            mm per unit of the file.

        Raises
        ------
        InputError
            There is no cell of that dimension, a cell type is unsupported, a coordinate is NaN, or a 2D mesh is not
            plane.
        """
        raw = _without_middles(self)
        _check_content(raw, n_dim)
        notes = list(raw.notes)
        start, new_index, parts_by_kind = 0, {}, defaultdict(list)
        for kind, connectivity, labels in raw.cells:
            if DIMENSION[kind] == n_dim:
                parts_by_kind[kind].append((start, connectivity, labels))
            start += len(connectivity)
        cells, element_labels, n = [], [], 0
        for kind, parts in parts_by_kind.items():
            cells.append((kind, np.concatenate([c for _, c, _ in parts])))
            for first, connectivity, labels in parts:
                count = len(connectivity)
                new_index.update(zip(range(first, first + count), range(n, n + count), strict=True))
                element_labels.append(labels)
                n += count
        _check_doubles(raw.file, cells, np.concatenate(element_labels))
        used = np.unique(np.concatenate([c.ravel() for _, c in cells]))
        if len(used) < len(raw.nodes):
            notes.append(f"{raw.file.name}: {len(raw.nodes) - len(used)} nodes belong to no element and are left out")
        renumber = np.full(len(raw.nodes), -1)
        renumber[used] = np.arange(len(used))
        nodes = _in_plane(raw, used, n_dim) * factor
        cells = oriented(nodes, [(kind, renumber[c]) for kind, c in cells], np.concatenate(element_labels), raw.file,
                         notes)
        node_sets, face_sets = _lower_sets(raw, n_dim, _middles(cells, used))
        element_sets = {name: np.array(sorted(new_index[i] for i in ids if i in new_index), dtype=np.int64) for name,
                        ids in raw.element_sets.items()}
        mesh = make_mesh(nodes, cells, node_labels=np.asarray(raw.node_labels)[used],
                         element_labels=np.concatenate(element_labels),
                         node_sets=_clean({name: renumber[ids] for name, ids in node_sets.items()}),
                         element_sets={name: ids for name, ids in element_sets.items() if len(ids)})
        edge_sets = _faces(mesh, {name: [tuple(renumber[list(face)]) for face in faces] for name,
                                  faces in face_sets.items()})
        notes += _corner_sets(mesh, raw.file)
        return Mesh(mesh.nodes, mesh.blocks, mesh.node_sets, mesh.element_sets, edge_sets, mesh.node_labels,
                    mesh.element_labels), notes


def _without_middles(raw: RawMesh) -> RawMesh:
    """The mesh with quad8 in the place of quad9, which has the same edges and a node in the middle."""
    n = sum(len(connectivity) for kind, connectivity, _ in raw.cells if kind == "quad9")
    if not n:
        return raw
    cells = [("quad8", connectivity[:, :8], labels) if kind == "quad9" else (kind, connectivity, labels)
             for kind, connectivity, labels in raw.cells]
    note = f"{raw.file.name}: {n} quad9 elements are read as quad8, without the nodes in their middles"
    return replace(raw, cells=cells, notes=[*raw.notes, note])


def _check_content(raw: RawMesh, n_dim: int) -> None:
    kinds = {kind for kind, c, _ in raw.cells if len(c)}
    top = max((DIMENSION[kind] for kind in kinds), default=0)
    kind_key = "solid" if n_dim == 3 else "plane_stress or plane_strain"
    if top != n_dim:
        raise InputError(f"the dimension of the mesh does not fit kind = {kind_key}", file=raw.file, key="mesh",
                         found=", ".join(sorted(kinds)) or "no elements",
                         expected="quadrilaterals or triangles" if n_dim == 2
                         else "tetrahedra or hexahedra (hex8, hex20)",
                         remedy="correct kind in [experiment], or mesh the specimen with such elements")
    wrong = sorted(kind for kind in kinds if DIMENSION[kind] == n_dim and kind not in SUPPORTED)
    if wrong:
        raise InputError("an element type that idic does not have", file=raw.file, key="mesh",
                         expected=", ".join(SUPPORTED), found=", ".join(wrong),
                         remedy="mesh the specimen with one of these types")
    bad = np.flatnonzero(~np.isfinite(raw.nodes).all(axis=1))
    if len(bad):
        raise InputError("a node without coordinates", file=raw.file, key=f"node {raw.node_labels[bad[0]]}",
                         expected="finite numbers", found=str(raw.nodes[bad[0]]),
                         remedy="correct the mesh file")


def _check_doubles(file: Path, cells: list[tuple[str, np.ndarray]], labels: np.ndarray) -> None:
    """InputError if two elements share all nodes; they would double the stiffness there without notice."""
    first = 0
    for _, connectivity in cells:
        _, first_places, number, count = np.unique(np.sort(connectivity, axis=1), axis=0, return_index=True,
                                                   return_inverse=True, return_counts=True)
        number = number.ravel()
        second = np.flatnonzero((count > 1)[number] & (np.arange(len(connectivity)) != first_places[number]))
        if len(second):
            k = int(second[0])
            raise InputError("two elements on the same nodes", file=file, key="mesh", expected="every element once",
                             found=f"elements {labels[first + first_places[number[k]]]} and {labels[first + k]}"
                             + (f", and {len(second) - 1} more pairs" if len(second) > 1 else ""),
                             remedy="delete one of them in the mesh generator")
        first += len(connectivity)


def _in_plane(raw: RawMesh, used: np.ndarray, n_dim: int) -> np.ndarray:
    nodes = raw.nodes[used]
    size = np.ptp(nodes[:, :2], axis=0).max()
    if n_dim == 2 and np.ptp(nodes[:, 2]) > 1e-6 * size:  # 1e-6: coordinates with seven digits
        raise InputError("the mesh does not lie in a plane z = constant", file=raw.file, key="mesh",
                         expected="one z for all nodes",
                         found=f"z from {nodes[:, 2].min():g} to {nodes[:, 2].max():g}",
                         remedy="rotate the mesh into the x-y plane")
    return nodes[:, :n_dim]


def _lower_sets(raw: RawMesh, n_dim: int, middles: Mapping[tuple[int, int], int]):
    """Edge and node sets from the lower-dimensional cells of the file."""
    node_sets, face_sets = dict(raw.node_sets), {name: list(faces) for name, faces in raw.face_sets.items()}
    table, start = [], 0
    for kind, connectivity, _ in raw.cells:
        table.append((start, start + len(connectivity), kind, connectivity))
        start += len(connectivity)
    for name, ids in raw.element_sets.items():
        points: list[int] = []
        for first, end, kind, connectivity in table:
            inside = connectivity[ids[(ids >= first) & (ids < end)] - first]
            if len(inside) == 0 or DIMENSION[kind] >= n_dim:
                continue
            points.extend(inside.ravel())
            points.extend(_middles_of(kind, inside, middles))
            if DIMENSION[kind] == n_dim - 1:
                corners = cell_type(kind).n_corners if kind in CELL_TYPES else len(inside[0])
                face_sets.setdefault(name, []).extend(tuple(row[:corners]) for row in inside)
        if points and name not in node_sets:
            node_sets[name] = np.unique(points)
    return node_sets, face_sets


def _middles(cells: list[tuple[str, np.ndarray]], used: np.ndarray) -> dict[tuple[int, int], int]:
    """{corners of an edge, the lower one first: its mid-side node} of quadratic elements, numbered as in the file."""
    middles: dict[tuple[int, int], int] = {}
    for kind, connectivity in cells:
        corners = cell_type(kind).n_corners
        for k, edge in enumerate(cell_type(kind).edges if cell_type(kind).n_nodes > corners else ()):
            ends = np.sort(used[connectivity[:, list(edge)]], axis=1)
            middles.update(zip(map(tuple, ends.tolist()), used[connectivity[:, corners + k]].tolist(), strict=True))
    return middles


def _middles_of(kind: str, cells: np.ndarray, middles: Mapping[tuple[int, int], int]) -> list[int]:
    """The mid-side nodes on the edges of linear cells that lie on quadratic elements: gmsh writes such lines for
    Nastran, and the set of their nodes is that of the edge."""
    if not middles or kind not in ("line2", "tri3", "quad4"):
        return []
    edges = ((0, 1),) if kind == "line2" else cell_type(kind).edges
    pairs = {pair for edge in edges for pair in map(tuple, np.sort(cells[:, list(edge)], axis=1).tolist())}
    return [middles[pair] for pair in sorted(pairs) if pair in middles]


def _corner_sets(mesh: Mesh, file: Path) -> list[str]:
    """Notes on node sets that hold the ends of edges of quadratic elements and none of the nodes between them."""
    edges = np.array([[*ends, middle] for ends, middle in _middles(
        [(block.cell, block.connectivity) for block in mesh.blocks], np.arange(mesh.n_nodes)).items()], dtype=np.int64)
    notes = []
    for name, ids in mesh.node_sets.items() if len(edges) else ():
        inside = np.zeros(mesh.n_nodes, dtype=bool)
        inside[ids] = True
        number = int(inside[edges[:, :2]].all(axis=1).sum())
        if number and not inside[edges[:, 2]].any():
            notes.append(f"{file.name}: node set {name} holds the ends of {number} edges without the nodes between "
                         "them: a motion prescribed on it holds only the corners; add the mid-side nodes, or name a "
                         "set of edges")
    return notes


def _clean(sets: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The sets without dropped nodes; empty sets are removed."""
    cleaned = {name: np.unique(ids[ids >= 0]) for name, ids in sets.items()}
    return {name: ids for name, ids in cleaned.items() if len(ids)}


def _faces(mesh: Mesh, face_sets: dict[str, list[tuple[int, ...]]]) -> dict[str, np.ndarray]:
    """The faces with these corner nodes as [element, local face]."""
    if not face_sets:
        return {}
    faces_by_nodes = {}
    for block in mesh.blocks:
        cell = block.kind
        corners = block.kind.n_face_corners
        for k, local in enumerate(cell.faces):
            for e, nodes in enumerate(np.sort(block.connectivity[:, list(local[:corners])], axis=1)):
                faces_by_nodes.setdefault(tuple(int(n) for n in nodes), (block.first + e, k))
    edge_sets = {}
    for name, faces in face_sets.items():
        set_faces = [faces_by_nodes[key] for face in faces
                     if (key := tuple(sorted(int(n) for n in face))) in faces_by_nodes]
        if set_faces:
            edge_sets[name] = np.array(sorted(set(set_faces)), dtype=np.int64)
    return edge_sets
