"""Sets by name: of the mesh file and of [sets]; conversion between node, edge and element sets."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from idic.errors import InputError
from idic.experiment_file.schema.boundary import SetTable
from idic.fe import Mesh
from idic.readers import points_where

ALL = "ALL"  # a material of this name fills the whole mesh


def with_sets(mesh: Mesh, tables: Mapping[str, SetTable], factor: float, file) -> Mesh:
    """The mesh with the sets of [sets] added.

    A set by position holds the nodes that satisfy the expression, the boundary edges (faces) whose nodes all do, and
    the elements whose centre does: it can be used as any of the three. ``boundary`` gives the outer edge or the holes.

    Parameters
    ----------
    factor : float
        mm per mesh unit: expressions are written in the mesh unit.

    Raises
    ------
    InputError
        The mesh has a set of this name already, or the set is empty.
    """
    for name, table in tables.items():
        key = f"sets.{name}"
        if name in mesh.node_sets or name in mesh.element_sets or name in mesh.edge_sets:
            raise InputError("the mesh has a set of this name already", file=file, key=key,
                             expected="a new name", found=name,
                             remedy="choose another name, or leave the entry out")
        if table.where is not None:
            mesh = _by_position(mesh, name, table.where, factor, file, key)
        else:
            mesh = _by_boundary(mesh, name, table.boundary, file, key)
    return mesh


def _by_position(mesh: Mesh, name: str, expression: str, factor: float, file, key) -> Mesh:
    points = mesh.nodes / factor
    inside = points_where(expression, points, file=file, key=f"{key}.where")
    if not inside.any():
        extent = ", ".join(f"{axis} from {low:g} to {high:g}" for axis, low,
                           high in zip("xyz", points.min(axis=0), points.max(axis=0), strict=False))
        raise InputError("an empty set", file=file, key=f"{key}.where", expected=f"nodes with {expression}",
                         found=f"none; the mesh has {extent}",
                         remedy="correct the expression; coordinates are in the unit of the mesh")
    faces = mesh.boundary_faces()
    faces = np.array([face for face in faces if inside[mesh.face_nodes(face)].all()], dtype=np.int64).reshape(-1, 2)
    centres = np.concatenate([points[block.connectivity].mean(axis=1) for block in mesh.blocks])
    elements = np.flatnonzero(points_where(expression, centres, file=file, key=key))
    return _added(mesh, name, np.flatnonzero(inside), faces, elements)


def _by_boundary(mesh: Mesh, name: str, loop_kind: str, file, key) -> Mesh:
    if mesh.n_dim != 2:
        raise InputError("boundary sets exist for plane meshes only", file=file, key=f"{key}.boundary",
                         expected="kind = plane_stress or plane_strain",
                         found="a solid", remedy="define the set by position: where = …")
    outer, holes = _split_loops(mesh)
    loops = {"outer": outer, "holes": holes, "all": outer + holes}[loop_kind]
    if not loops:
        raise InputError("an empty set", file=file, key=f"{key}.boundary", expected="a mesh with holes",
                         found="a mesh without holes", remedy="leave the entry out")
    faces = np.concatenate(loops)
    return _added(mesh, name, mesh.face_set_nodes(faces), faces, np.zeros(0, dtype=np.int64))


def _split_loops(mesh: Mesh) -> tuple[list[np.ndarray], list[np.ndarray]]:
    outer, holes = [], []
    for loop in mesh.boundary_edges():
        a, b = np.array([mesh.nodes[mesh.face_nodes(face)[:2]] for face in loop]).transpose(1, 0, 2)
        area = (a[:, 0] * b[:, 1] - b[:, 0] * a[:, 1]).sum()
        (outer if area > 0 else holes).append(loop)
    return outer, holes


def _added(mesh: Mesh, name: str, nodes, faces, elements) -> Mesh:
    node_sets, edge_sets, element_sets = dict(mesh.node_sets), dict(mesh.edge_sets), dict(mesh.element_sets)
    node_sets[name] = nodes
    if len(faces):
        edge_sets[name] = faces
    if len(elements):
        element_sets[name] = elements
    return replace(mesh, node_sets=node_sets, edge_sets=edge_sets, element_sets=element_sets)


def known_name(name: str, names: Iterable[str]) -> str | None:
    """`name` in the spelling of the mesh: an exact match, else a unique match that ignores case (as in inp files)."""
    names = list(names)
    if name in names:
        return name
    matches = [candidate for candidate in names if candidate.upper() == name.upper()]
    return matches[0] if len(matches) == 1 else None


def with_node_set(mesh: Mesh, name: str, file, key) -> Mesh:
    """The mesh with a node set `name`: its own, else the nodes of the edge or element set of that name."""
    if name in mesh.node_sets:
        return mesh
    node_sets = dict(mesh.node_sets)
    if (spelling := known_name(name, mesh.node_sets)) is not None:
        node_sets[name] = mesh.node_sets[spelling]
    elif (spelling := known_name(name, mesh.edge_sets)) is not None:
        node_sets[name] = mesh.face_set_nodes(mesh.edge_sets[spelling])
    elif (spelling := known_name(name, mesh.element_sets)) is not None:
        node_sets[name] = _nodes_of_elements(mesh, mesh.element_sets[spelling])
    else:
        raise _no_set("no such set of nodes", name, {*mesh.node_sets, *mesh.edge_sets, *mesh.element_sets}, file, key)
    return replace(mesh, node_sets=node_sets)


def with_edge_set(mesh: Mesh, name: str, file, key) -> Mesh:
    """The mesh with an edge (face) set `name`: its own, else the boundary edges whose nodes are all in a node set."""
    if name in mesh.edge_sets:
        return mesh
    edge_sets = dict(mesh.edge_sets)
    if (spelling := known_name(name, mesh.edge_sets)) is not None:
        edge_sets[name] = mesh.edge_sets[spelling]
    elif (spelling := known_name(name, mesh.node_sets)) is not None:
        inside = np.zeros(mesh.n_nodes, dtype=bool)
        inside[mesh.node_sets[spelling]] = True
        faces = [face for face in mesh.boundary_faces() if inside[mesh.face_nodes(face)].all()]
        if not faces:
            raise InputError("the node set contains no boundary edge", file=file, key=key,
                             expected="all nodes of one edge or more", found=name,
                             remedy="name a set of edges, or of all nodes along an edge")
        edge_sets[name] = np.array(faces, dtype=np.int64)
    else:
        raise _no_set("no such set of edges", name, {*mesh.edge_sets, *mesh.node_sets}, file, key)
    return replace(mesh, edge_sets=edge_sets)


def with_element_set(mesh: Mesh, name: str, only: bool, file, key,
                     by_position: Iterable[str] = ()) -> tuple[Mesh, str | None]:
    """The mesh with an element set `name`, and a note.

    If the mesh file has no element sets (those of [sets], `by_position`, do not count) and there is one material
    (`only`), its name means all elements; ALL always does, unless the mesh names a set so.
    """
    if name in mesh.element_sets:
        return mesh, None
    element_sets, note = dict(mesh.element_sets), None
    if (spelling := known_name(name, mesh.element_sets)) is not None:
        element_sets[name] = mesh.element_sets[spelling]
    elif name == ALL:
        element_sets[name] = np.arange(mesh.n_elements)
    elif only and set(mesh.element_sets) <= {ALL, *by_position}:
        element_sets[name] = np.arange(mesh.n_elements)
        note = f"the mesh names no element sets: material {name} applies to all elements"
    else:
        raise _no_set("no such set of elements", name, mesh.element_sets, file, key,
                      f"name the sets that it fills:  sets = [\"...\"]  under [material.{name}]; [material.{ALL}] "
                      "fills the whole mesh; ")
    return replace(mesh, element_sets=element_sets), note


def with_joined_sets(mesh: Mesh, name: str, sets: Sequence[str], file, key: str) -> Mesh:
    """The mesh with an element set `name` of all elements of `sets`; ALL are those of the mesh, unless it names a set
    so.

    Raises
    ------
    InputError
        A set that the mesh does not have, or `name` is another set of it.
    """
    known_sets = {ALL: np.arange(mesh.n_elements)} | mesh.element_sets
    spellings = [known_name(entry, known_sets) for entry in sets]
    if None in spellings:
        raise _no_set("no such set of elements", sets[spellings.index(None)], mesh.element_sets, file, key)
    elements = np.unique(np.concatenate([known_sets[spelling] for spelling in spellings]))
    if name in mesh.element_sets and not np.array_equal(np.sort(mesh.element_sets[name]), elements):
        raise InputError("the material has the name of another set", file=file, key=key,
                         expected=f"a new name for {', '.join(sets)}", found=f"{name}, a set of the mesh",
                         remedy=f"give the material another name, or leave out sets: it then fills {name}")
    return replace(mesh, element_sets=mesh.element_sets | {name: elements})


def _nodes_of_elements(mesh: Mesh, elements: np.ndarray) -> np.ndarray:
    parts = []
    for block in mesh.blocks:
        rows = elements[(elements >= block.first) & (elements < block.first + block.n_elements)] - block.first
        parts.append(block.connectivity[rows].ravel())
    return np.unique(np.concatenate(parts))


def _no_set(fault: str, name: str, names: Iterable[str], file, key, other_ways: str = "") -> InputError:
    names = sorted(names)
    matches = difflib.get_close_matches(name, names, n=1, cutoff=0.5)
    several = [candidate for candidate in names if candidate.upper().endswith(f"_{name.upper()}")]
    hint = f"did you mean {matches[0]}? " if matches else ""
    if len(several) > 1:  # see `idic.readers.mesh_files.abaqus_sets`
        hint = f"{name} is another set in each of several parts of the mesh file: write {' or '.join(several)}, "
    by_position = f'define it by position:  [sets]  {name} = {{ where = "y < 0" }}'
    return InputError(fault, file=file, key=key, expected=f"one of {', '.join(names)}" if names
                      else "a set of the mesh (it names none)", found=repr(name),
                      remedy=f"{hint}{other_ways}or {by_position}")
