"""Edges that are measured: second differences along them, and on a solid which nodes of a set the cameras see."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.spatial import cKDTree

from idic.fe.mesh.mesh import Mesh, face_cells, face_set_nodes

MIN_NORMAL_ALONG_AXIS = 0.99  # cosine: a surface that looks along an axis
CORNER_COSINE = 0.8  # an edge that turns by more than 37 degrees has a corner there, where motion may bend sharply


def seen_first(mesh: Mesh, surface: str, nodes: np.ndarray) -> np.ndarray:
    """For every node of a set, the node of the set on the surface that it moves with: itself where it lies there.

    nodes : (n,) indices. Returns (n,) indices into `nodes`, empty where none of them lies on the surface. A hidden node
    follows the nearest seen one, as a cross-section that stays straight through the thickness.
    """
    on_surface = np.flatnonzero(np.isin(nodes, face_set_nodes(mesh, mesh.edge_sets[surface])))
    if not len(on_surface):
        return np.empty(0, dtype=np.int64)
    _, near = cKDTree(mesh.nodes[nodes[on_surface]]).query(mesh.nodes[nodes])
    leaders = on_surface[near]
    leaders[on_surface] = on_surface
    return leaders


def normal_axis(mesh: Mesh, surface: str) -> int | None:
    """The axis (0, 1, 2) along which a flat surface looks; None where it is curved or looks between the axes."""
    normals = np.concatenate([_normals(mesh.nodes[block.connectivity]) for block in
                              face_cells(mesh, np.asarray(mesh.edge_sets[surface]))])
    along = np.abs(normals) > MIN_NORMAL_ALONG_AXIS
    axes = np.flatnonzero(along.all(axis=0))
    return int(axes[0]) if len(axes) else None


def rim_second_differences(mesh: Mesh, surface: str, nodes: np.ndarray) -> np.ndarray:
    """Second differences of nodal values along the rim of a surface in space  # (n_rows, n)

    nodes : (n,) indices of a set. One row per node whose two neighbours on the rim belong to the set too, corners
    excepted; scaled to the mean of the two spacings.
    """
    count: dict[tuple[int, int], int] = {}
    for block in face_cells(mesh, np.asarray(mesh.edge_sets[surface])):
        for face in block.connectivity.tolist():
            for a, b in _segments(face):
                key = (min(a, b), max(a, b))
                count[key] = count.get(key, 0) + 1
    neighbours: dict[int, list[int]] = {}
    for (a, b), times in count.items():
        if times == 1:
            neighbours.setdefault(a, []).append(b)
            neighbours.setdefault(b, []).append(a)
    place, rows = {int(node): i for i, node in enumerate(nodes)}, []
    for here in place:
        around = neighbours.get(here, [])
        if len(around) != 2 or not set(around) <= place.keys():
            continue
        row = second_difference(mesh.nodes, place, around[0], here, around[1])
        if row is not None:
            rows.append(row)
    return np.array(rows).reshape(-1, len(nodes))


def second_difference(points: np.ndarray, place: Mapping[int, int], before: int, here: int,
                      after: int) -> np.ndarray | None:
    """Second difference of nodal values at a node of an edge, scaled to the mean of the two spacings; None at a corner.

    points : (n_nodes, 2|3); place : position of a node among the values. Returns (len(place),)
    """
    first, second = points[here] - points[before], points[after] - points[here]
    h, k = np.linalg.norm(first), np.linalg.norm(second)
    if first @ second < CORNER_COSINE * h * k:
        return None
    row = np.zeros(len(place))
    row[[place[before], place[here], place[after]]] = 0.5 * (h + k) * np.array([1 / h, -1 / h - 1 / k, 1 / k])
    return row


def _segments(face: list[int]) -> list[tuple[int, int]]:
    """Pairs of neighbouring nodes around a face, corners first and middles after them in the connectivity."""
    n = {3: 3, 6: 3, 4: 4, 8: 4}[len(face)]
    corners = face[:n]
    if len(face) == n:
        return [(corners[i], corners[(i + 1) % n]) for i in range(n)]
    middles = face[n:]
    return [pair for i in range(n) for pair in ((corners[i], middles[i]), (middles[i], corners[(i + 1) % n]))]


def _normals(x: np.ndarray) -> np.ndarray:
    """Unit normals of faces by their first three corners  # (n, nn, 3) -> (n, 3)"""
    normal = np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])
    return normal / np.linalg.norm(normal, axis=1, keepdims=True)
