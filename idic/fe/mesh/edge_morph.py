"""Edges of a plane mesh that lie further out: V = dX/dlam for `idic.fe.mesh.morph.Morph`, lam in mm.

The edges move by one distance along their outward normals. Corners keep to the lines of both edges, flat ones go half
way with each; what does not move slides along itself, so that its shape stays; inside V is harmonic.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from idic.fe.mesh.mesh import Mesh
from idic.fe.mesh.morph import laplacian

OUTLINE = "geometry.outline"  # stem of the degrees of freedom that move free edges
# prior of the distance, over that of measured points: half a facet, and within a distance a grid shows an edge
EDGE_STD_SHARE = 1.0
MIN_CORNER_SINE = 0.5  # of the angle between two edges (30 degrees): the corner of flatter ones goes half way with each


def free_edges(mesh: Mesh, held_sets: Mapping[str, np.ndarray]) -> np.ndarray:
    """Boundary edges whose nodes are not all in one of these sets  # (n, 2) [global element index, local edge]

    held_sets : {name: (n,) node indices}
    """
    faces = mesh.boundary_faces()
    driven = np.array([any(np.isin(mesh.face_nodes(face), nodes).all() for nodes in held_sets.values())
                       for face in faces],
                      dtype=bool)
    return faces[~driven]


def outward_velocity(mesh: Mesh, faces: np.ndarray) -> np.ndarray:
    """V of these boundary edges, 1 along their outward normals  # (n_nodes, 2), 1

    faces : (n, 2) [global element index, local edge], of `Mesh.boundary_faces`
    """
    moved = {tuple(face) for face in faces.tolist()}
    walls = mesh.boundary_faces()
    target = np.array([tuple(face) in moved for face in walls.tolist()], dtype=float)
    nodes = [mesh.face_nodes(face) for face in walls]
    along = np.array([mesh.nodes[n[1]] - mesh.nodes[n[0]] for n in nodes])
    normals = np.column_stack([along[:, 1], -along[:, 0]]) / np.hypot(*along.T)[:, None]
    around: dict[int, list[int]] = {}
    for k, members in enumerate(nodes):
        for node in members.tolist():
            around.setdefault(node, []).append(k)
    node_velocities = {node: _velocity(normals[at], target[at]) for node, at in around.items()
                       if target[at].any() or _is_corner(normals[at])}
    velocity = np.zeros((mesh.n_nodes, 2))
    velocity[list(node_velocities)] = list(node_velocities.values())
    sliding = np.array([node for node in around if node not in node_velocities], dtype=int)
    _solve(velocity, _along_walls(mesh, nodes), sliding)
    for node in sliding:
        velocity[node] = _tangential(velocity[node], normals[around[node]].mean(axis=0))
    inside, used = laplacian(mesh)
    _solve(velocity, inside, np.setdiff1d(used, list(around)))
    return _with_straight_edges(mesh, velocity, set(around))


def _with_straight_edges(mesh: Mesh, velocity: np.ndarray, walls: set[int]) -> np.ndarray:
    """Nodes in the middle of edges inside the body move with its ends: quadratic elements keep straight edges."""
    straightened = velocity.copy()
    for block in mesh.blocks:
        for a, b, *middle in block.kind.faces:
            for at in middle:
                nodes = block.connectivity[~np.isin(block.connectivity[:, at], list(walls))]
                straightened[nodes[:, at]] = 0.5 * (velocity[nodes[:, a]] + velocity[nodes[:, b]])
    return straightened


def _is_corner(normals: np.ndarray) -> bool:
    return len(normals) == 2 and abs(np.linalg.det(normals)) > MIN_CORNER_SINE


def _velocity(normals: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Motion with these components along the normals of the edges around a node  # (2,)"""
    if _is_corner(normals):
        return np.linalg.solve(normals, target)
    mean = normals.mean(axis=0)
    return target.mean() * mean / (mean @ mean)


def _tangential(velocity: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """The part across a normal of any length  # (2,)"""
    return velocity - (velocity @ normal) / (normal @ normal) * normal


def _along_walls(mesh: Mesh, walls: list[np.ndarray]) -> sparse.csr_array:
    """Laplacian of the boundary: neighbours on an edge by the inverse of their distance  # (n_nodes, n_nodes)"""
    pairs = np.concatenate([[(n[0], n[2]), (n[2], n[1])] if len(n) == 3 else [(n[0], n[1])] for n in walls])
    weight = 1.0 / np.hypot(*(mesh.nodes[pairs[:, 1]] - mesh.nodes[pairs[:, 0]]).T)
    a, b = pairs.T
    triplet = (np.concatenate([weight, weight, -weight, -weight]),
               (np.concatenate([a, b, a, b]), np.concatenate([a, b, b, a])))
    return sparse.csr_array(sparse.coo_array(triplet, shape=(mesh.n_nodes,) * 2))


def _solve(velocity: np.ndarray, matrix: sparse.csr_array, free_nodes: np.ndarray) -> None:
    """Harmonic values at free nodes, in place; loops that hold no given node stay."""
    if len(free_nodes):
        stiffness = matrix[free_nodes][:, free_nodes] + 1e-12 * sparse.diags_array(matrix.diagonal()[free_nodes])
        velocity[free_nodes] = splu(stiffness.tocsc()).solve(-(matrix[free_nodes] @ velocity))


def edges_by_name(mesh: Mesh, open_faces: np.ndarray) -> dict[str, np.ndarray]:
    """Sets EDGE1, EDGE2, … and HOLE1, HOLE2, … of a drawn outline whose faces are all open  # {name: (n, 2)}

    open_faces : (n, 2), of `free_edges`
    """
    open_keys = {tuple(face) for face in open_faces.tolist()}
    return {name: faces for name, faces in mesh.edge_sets.items()
            if re.fullmatch(r"(EDGE|HOLE)\d+", name) and all(tuple(face) in open_keys for face in faces.tolist())}
