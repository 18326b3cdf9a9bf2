"""Rigid motions that supports leave to a body or to a part of it: the stiffness would have no inverse.

Elements that share a face (in the plane an edge) move as one part. Parts that only share nodes hang on each other by
joints: two triangles that touch in a corner, two bricks along an edge. The rigid motions of all parts that hang
together must be excluded by the prescribed components and by the joints: a matrix with three columns per part in the
plane and six in space has full rank.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from idic.fe.mesh.mesh import Mesh, PerMesh

MIN_SUPPORT = 1e-8  # singular value of a held rigid motion over the largest: well above rounding, below a real support
MAX_PARTS = 200  # that hang together; more are not examined: a lattice, whose matrix would be large

_PARTS = PerMesh()  # a diagnosis loads an experiment for every variant, on one mesh


@dataclass(frozen=True)
class FreePart:
    """A part that can move as a rigid body.

    Attributes
    ----------
    nodes : (n,) int
    motions : (n_modes, k)
        Independent free motions, in translations along each axis, then turns in the planes of `turns`.
    hangs : whether it hangs on another part by single nodes
    """

    nodes: np.ndarray
    motions: np.ndarray
    hangs: bool


def turns(n_dim: int) -> list[tuple[int, int]]:
    """The planes in which a body turns, in the order of its rigid motions; in space about x, y and z."""
    return [(0, 1)] if n_dim == 2 else [(1, 2), (2, 0), (0, 1)]


def bodies(mesh: Mesh) -> tuple[int, np.ndarray]:
    """(number of bodies, body of every node): elements that share a node; a node of no element is one by itself."""
    ends = [(np.repeat(block.connectivity[:, 0], block.connectivity.shape[1]), block.connectivity.ravel())
            for block in mesh.blocks]
    return _labels(np.concatenate([a for a, _ in ends]), np.concatenate([b for _, b in ends]), mesh.n_nodes)


def free_parts(mesh: Mesh, held_dofs: np.ndarray) -> Iterator[FreePart]:
    """The part of every body that moves most where its rigid motions are not prevented.

    held_dofs : (n,) int, prescribed degrees of freedom
    """
    held_dofs = np.asarray(held_dofs, dtype=np.int64)
    part_of_element = _PARTS.once(mesh, (), lambda: _parts(mesh)).astype(np.int64)
    keys = np.unique(np.concatenate([(part_of_element[block.first:block.first + block.n_elements, None] * mesh.n_nodes
                                      + block.connectivity).ravel() for block in mesh.blocks]))
    pairs = np.column_stack(np.divmod(keys, mesh.n_nodes))  # (part, node)
    body_of_node = bodies(mesh)[1]
    body_of_part = body_of_node[pairs[np.unique(pairs[:, 0], return_index=True)[1], 1]]
    for body in np.unique(body_of_part):
        parts = np.flatnonzero(body_of_part == body)
        body_pairs = pairs[np.isin(pairs[:, 0], parts)]
        if len(parts) > MAX_PARTS:
            body_pairs, parts = np.column_stack([np.zeros(len(body_pairs), dtype=np.int64),
                                                 body_pairs[:, 1]]), np.zeros(1, dtype=np.int64)
        nodes = [body_pairs[body_pairs[:, 0] == part, 1] for part in parts]
        free_part = _free_part(mesh.nodes, nodes, held_dofs[body_of_node[held_dofs // mesh.n_dim] == body])
        if free_part is not None:
            yield free_part


def _free_part(x: np.ndarray, nodes: list[np.ndarray], held_dofs: np.ndarray) -> FreePart | None:
    """Of the parts (n,) of one body; None where supports and joints hold it."""
    d, n_modes = x.shape[1], x.shape[1] + len(turns(x.shape[1]))
    node_numbers, counts = np.unique(np.concatenate(nodes), return_counts=True)
    blocks, remaining_dofs = [], held_dofs
    # a joint's components are prescribed for its first part, and are the others' by it
    for k, part_nodes in enumerate(nodes):
        of_part = np.isin(remaining_dofs // d, part_nodes)
        rows = rigid_modes(x, part_nodes, remaining_dofs[of_part] // d)[np.arange(of_part.sum()),
                                                                         remaining_dofs[of_part] % d]
        if len(rows) > n_modes:  # as many rows with the same singular values
            rows = np.linalg.qr(rows, mode="r")
        blocks.append(_columns(rows, k, len(nodes)))
        remaining_dofs = remaining_dofs[~of_part]
    for node in node_numbers[counts > 1]:
        first, *other_parts = (k for k, part_nodes in enumerate(nodes) if node in part_nodes)
        first_motion = _columns(rigid_modes(x, nodes[first], np.array([node]))[0], first, len(nodes))
        blocks += [first_motion - _columns(rigid_modes(x, nodes[k], np.array([node]))[0], k, len(nodes))
                   for k in other_parts]
    n_unknowns = n_modes * len(nodes)
    _, sizes, directions = np.linalg.svd(np.concatenate([*blocks, np.zeros((n_unknowns, n_unknowns))]),
                                         full_matrices=False)
    free_modes = directions[sizes <= MIN_SUPPORT * max(sizes[0], 1e-300)].T.reshape(len(nodes), n_modes, -1)
    if not free_modes.shape[2]:
        return None
    k = int(np.argmax(np.linalg.norm(free_modes, axis=(1, 2))))
    return FreePart(nodes[k], free_modes[k], len(nodes) > 1)


def rigid_modes(x: np.ndarray, part: np.ndarray, nodes: np.ndarray) -> np.ndarray:
    """Motion of nodes (n,) by each rigid motion of a part, turns in units of half its size  # (n, d, n_modes)"""
    d, centre = x.shape[1], x[part].mean(axis=0)
    away = (x[nodes] - centre) / max(float(np.abs(x[part] - centre).max()), 1e-300)
    modes = np.zeros((len(nodes), d, d + len(turns(d))))
    modes[:, :, :d] = np.eye(d)
    for k, (i, j) in enumerate(turns(d), d):
        modes[:, i, k], modes[:, j, k] = -away[:, j], away[:, i]
    return modes


def _columns(rows: np.ndarray, k: int, n_parts: int) -> np.ndarray:
    """Rows (n, n_modes) of one part among the columns of all parts  # (n, n_parts n_modes)"""
    columns = np.zeros((len(rows), n_parts, rows.shape[1]))
    columns[:, k] = rows
    return columns.reshape(len(rows), n_parts * rows.shape[1])


def _parts(mesh: Mesh) -> np.ndarray:
    """Part of every element: elements that share a face  # (n_elements,)"""
    keys, owners = [], []
    for block in mesh.blocks:
        n = block.kind.n_face_corners
        for face in block.kind.faces:
            corners = np.sort(block.connectivity[:, list(face[:n])], axis=1)[:, :mesh.n_dim]  # three tell a face
            keys.append(corners @ mesh.n_nodes ** np.arange(mesh.n_dim))
            owners.append(block.first + np.arange(block.n_elements))
    face_keys, owner = np.concatenate(keys), np.concatenate(owners)
    order = np.argsort(face_keys, kind="stable")
    shared = face_keys[order][1:] == face_keys[order][:-1]
    return _labels(owner[order][1:][shared], owner[order][:-1][shared], mesh.n_elements)[1]


def _labels(starts: np.ndarray, ends: np.ndarray, n: int) -> tuple[int, np.ndarray]:
    return connected_components(coo_array((np.ones(len(starts)), (starts, ends)), shape=(n, n)), directed=False)
