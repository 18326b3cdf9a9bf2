"""Edges that are measured: second differences along them, and on a solid which nodes of a set the cameras see."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import combinations, pairwise

import numpy as np
import scipy

from idic.fe.mesh.mesh import Mesh

MIN_NORMAL_ALONG_AXIS = 0.99  # cosine: a surface that looks along an axis
MAX_EXTRAPOLATED = 2.0  # noise of a hidden node by the slope, over that of a seen one
CORNER_COSINE = 0.8  # an edge that turns by more than 37 degrees has a corner there, where motion may bend sharply


def seen_first(mesh: Mesh, surface: str, nodes: np.ndarray) -> np.ndarray:
    """For every node of a set, the nearest node of the set on the surface: itself where it lies there.

    nodes : (n,) indices. Returns (n,) indices into `nodes`, empty where none of them lies on the surface.
    """
    on_surface = np.flatnonzero(np.isin(nodes, mesh.face_set_nodes(mesh.edge_sets[surface])))
    if not len(on_surface):
        return np.empty(0, dtype=np.int64)
    _, nearest = scipy.spatial.cKDTree(mesh.nodes[nodes[on_surface]]).query(mesh.nodes[nodes])
    leaders = on_surface[nearest]
    leaders[on_surface] = on_surface
    return leaders


def followed(points: np.ndarray, leaders: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Motion of the hidden nodes of a set from that of the visible ones.

        u(hidden) = u(nearest seen) + G d,      G = sum_k g_k v_k^T over the directions v_k with s_k > max |d . v_k| / 2

    d is the way from the nearest seen node, s_k and v_k are singular values and directions of the places of the seen
    nodes about their middle, and g_k is the slope of their motion along v_k by least squares, with noise 1/s_k of that
    of a node: no extrapolation has more than twice the noise of a measured node. Every linear motion is carried exactly
    to the side of a tube; on a flat surface, whose nodes tell no slope across, cross-sections stay straight through the
    thickness.

    Parameters
    ----------
    points : (n, 3) mm
    leaders : (n,)
        Of `seen_first`.

    Returns
    -------
    weights : (n, m)
        Of the m seen nodes, in the order of ``np.unique(leaders)``.
    left : (3, q)
        Orthonormal directions along which hidden nodes lie away from the seen ones, and no slope is known.
    """
    visible = np.unique(leaders)
    weights = (leaders[:, None] == visible).astype(float)
    away = points - points[leaders]
    u, sizes, directions = np.linalg.svd(points[visible] - points[visible].mean(axis=0), full_matrices=False)
    reach = np.abs(away @ directions.T).max(axis=0)
    resolved = MAX_EXTRAPOLATED * sizes > reach
    for k in np.flatnonzero(resolved):
        weights += np.outer(away @ directions[k], u[:, k] / sizes[k])
    unresolved = away - away @ directions[resolved].T @ directions[resolved]
    _, size, along = np.linalg.svd(unresolved, full_matrices=False)
    return weights, along[size > 1e-6 * np.abs(points).max()].T


def normal_axis(mesh: Mesh, surface: str) -> int | None:
    """The axis (0, 1, 2) of the normal of a flat surface; None where it is curved or its normal is along no axis."""
    normals = np.concatenate([_normals(mesh.nodes[block.connectivity]) for block in
                              mesh.face_cells(np.asarray(mesh.edge_sets[surface]))])
    along = np.abs(normals) > MIN_NORMAL_ALONG_AXIS
    axes = np.flatnonzero(along.all(axis=0))
    return int(axes[0]) if len(axes) else None


def second_differences(mesh: Mesh, nodes: np.ndarray, surface: str | None = None) -> np.ndarray:
    """Second differences of nodal values along edges within a set  # (n_rows, n)

    One row per node whose neighbours on both sides belong to the set too, corners excepted, scaled to the mean of the
    two spacings. Of a plane mesh along its boundary, of a solid along the rim of a surface, or without one along every
    element edge.

    nodes : (n,) indices of the set
    """
    place = {int(node): i for i, node in enumerate(nodes)}
    triples = (_along_boundary(mesh) if mesh.n_dim == 2 else _along_rim(mesh, surface, place) if surface is not None
               else _along_edges(mesh, nodes))
    rows = [row for triple in triples if set(triple) <= place.keys()
            and (row := _second_difference(mesh.nodes, place, *triple)) is not None]
    return np.array(rows).reshape(-1, len(nodes))


def _along_boundary(mesh: Mesh) -> Iterator[tuple[int, int, int]]:
    """Every node of the boundary of a plane mesh between its neighbours."""
    for path in mesh.boundary_paths():
        yield from zip(path, path[1:] + path[:1], path[2:] + path[:2], strict=True)


def _along_rim(mesh: Mesh, surface: str, place: Mapping[int, int]) -> Iterator[tuple[int, int, int]]:
    """Every node of the set between its two neighbours on the rim of a surface in space."""
    count: dict[tuple[int, int], int] = {}
    for block in mesh.face_cells(np.asarray(mesh.edge_sets[surface])):
        for face in block.connectivity.tolist():
            for a, b in _segments(face):
                key = (min(a, b), max(a, b))
                count[key] = count.get(key, 0) + 1
    neighbours: dict[int, list[int]] = {}
    for (a, b), times in count.items():
        if times == 1:
            neighbours.setdefault(a, []).append(b)
            neighbours.setdefault(b, []).append(a)
    for node in place:
        around = neighbours.get(node, [])
        if len(around) == 2:
            yield around[0], node, around[1]


def _along_edges(mesh: Mesh, nodes: np.ndarray) -> Iterator[tuple[int, int, int]]:
    """Every node of a set of a solid between each pair of its neighbours in the set along element edges."""
    neighbours: dict[int, set[int]] = {int(node): set() for node in nodes}
    for block in mesh.blocks:
        n_corners = block.kind.n_corners
        for k, (a, b) in enumerate(block.kind.edges):
            path = (a, n_corners + k, b) if block.connectivity.shape[1] > n_corners else (a, b)
            for first, second in pairwise(path):
                ends = block.connectivity[:, [first, second]]
                for i, j in ends[np.isin(ends, nodes).all(axis=1)].tolist():
                    neighbours[i].add(j)
                    neighbours[j].add(i)
    for node, around in neighbours.items():
        yield from ((previous, node, following) for previous, following in combinations(sorted(around), 2))


def _second_difference(points: np.ndarray, place: Mapping[int, int], previous: int, node: int,
                       following: int) -> np.ndarray | None:
    """Second difference of nodal values at a node of an edge, scaled to the mean of the two spacings; None at a corner.

    points : (n_nodes, 2|3); place : position of a node among the values. Returns (len(place),)
    """
    first, second = points[node] - points[previous], points[following] - points[node]
    h, k = np.linalg.norm(first), np.linalg.norm(second)
    if first @ second < CORNER_COSINE * h * k:
        return None
    row = np.zeros(len(place))
    row[[place[previous], place[node], place[following]]] = 0.5 * (h + k) * np.array([1 / h, -1 / h - 1 / k, 1 / k])
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
