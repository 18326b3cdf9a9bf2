"""A region between closed boundary edges: is it valid, what lies inside, how large its elements may be."""

from __future__ import annotations

import numpy as np
import scipy
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from idic.errors import InputError
from idic.fe.mesh.outline import Boundary, Segments, cut, halved

GROWTH = 0.35  # of the element size per distance from a short edge
MAX_NEIGHBOUR_RATIO = 1.5  # of an edge to the size that a shorter one asks for at its place
CLEARANCE = 1.3  # half lengths from the middle of an edge to the next part of the boundary
MAX_ROUNDS, MAX_EDGES, CHUNK = 40, 40_000, 4_000_000


def graded_boundary(segments: Segments, size: float) -> Boundary:
    """The cut outline, halved where shorter edges or other parts of the boundary are close.

    Raises
    ------
    InputError
        The lines cross, a hole is not inside, or the boundary nearly touches itself.
    """
    boundary = cut(segments, size)
    check_crossings(boundary, segments)
    _check_nesting(boundary, segments)
    for _ in range(MAX_ROUNDS):
        target_sizes = size_at(boundary, boundary.middles, np.inf)
        chosen = (boundary.lengths > MAX_NEIGHBOUR_RATIO * target_sizes) | _encroached(boundary, segments)
        if not chosen.any():
            return boundary
        if len(boundary.edges) > MAX_EDGES:
            break
        boundary = halved(boundary, segments, chosen)
    raise InputError("the outline cannot be meshed",
                     expected="corners of 15 degrees or more, and gaps that elements can fill",
                     found=_narrowest(boundary),
                     remedy="draw the sharp corner or the narrow gap wider, or leave it out")


def _narrowest(boundary: Boundary) -> str:
    x, y = boundary.middles[np.argmin(boundary.lengths)]
    return f"a corner or gap near ({x:.6g}, {y:.6g}) that no edge length resolves"


def size_at(boundary: Boundary, points: np.ndarray, size: float) -> np.ndarray:
    """The element size at points: `size`, less near short edges  # (n,)"""
    lengths, middles = boundary.lengths, boundary.middles
    short = lengths < 0.95 * size
    sizes = np.full(len(points), float(size))
    if not short.any():
        return sizes
    step = max(CHUNK // int(short.sum()), 1)
    for first in range(0, len(points), step):
        part = points[first : first + step]
        distance = np.hypot(part[:, None, 0] - middles[short, 0], part[:, None, 1] - middles[short, 1])
        grown = lengths[short] + GROWTH * np.maximum(distance - lengths[short] / 2, 0.0)
        sizes[first : first + step] = np.minimum(size, grown.min(axis=1))
    return sizes


def near_edges(boundary: Boundary, points: np.ndarray, reach: float) -> np.ndarray:
    """Which points lie within `reach` half lengths of the middle of a boundary edge  # (n,) bool"""
    half = boundary.lengths / 2 * reach
    tree = scipy.spatial.cKDTree(points) if len(points) else None
    is_near = np.zeros(len(points), dtype=bool)
    if tree is None:
        return is_near
    for neighbours in tree.query_ball_point(boundary.middles, half * (1 - 1e-9)):
        is_near[neighbours] = True
    return is_near


def _encroached(boundary: Boundary, segments: Segments) -> np.ndarray:
    """Edges that a boundary point of a segment not next to theirs comes close to  # (n,) bool

    A point in the diametral circle of an edge may break it in a Delaunay triangulation, and elements of its size do not
    fit in the gap. Segments that meet at a sharp corner come as close as they like.
    """
    close_points = scipy.spatial.cKDTree(boundary.points).query_ball_point(boundary.middles,
                                                                           boundary.lengths / 2 * CLEARANCE)
    of_point = [set() for _ in boundary.points]
    for segment, ends in zip(boundary.segment.tolist(), boundary.edges.tolist(), strict=True):
        for end in ends:
            of_point[end].add(segment)
    neighbours = _neighbours(segments)
    return np.array([any(of_point[k].isdisjoint(neighbours[segment]) for k in numbers)
                     for numbers, segment in zip(close_points, boundary.segment.tolist(), strict=True)])


def _neighbours(segments: Segments) -> list[set[int]]:
    """Of every segment: itself, the one before it and the one after it."""
    neighbours = []
    for k, loop in enumerate(segments.loop):
        loop_segments = np.flatnonzero(segments.loop == loop).tolist()
        place = loop_segments.index(k)
        neighbours.append({k, loop_segments[place - 1], loop_segments[(place + 1) % len(loop_segments)]})
    return neighbours


def inside(boundary: Boundary, points: np.ndarray) -> np.ndarray:
    """Which points lie in the region, by the number of crossings of a ray along x  # (n,) bool"""
    a, b = boundary.ends[:, 0], boundary.ends[:, 1]
    result = np.zeros(len(points), dtype=bool)
    step = max(CHUNK // len(a), 1)
    for first in range(0, len(points), step):
        x, y = points[first : first + step, :1], points[first : first + step, 1:]
        spans = (a[:, 1] > y) != (b[:, 1] > y)
        with np.errstate(divide="ignore", invalid="ignore"):
            at = a[:, 0] + (y - a[:, 1]) * (b[:, 0] - a[:, 0]) / (b[:, 1] - a[:, 1])
        result[first : first + step] = (spans & (x < at)).sum(axis=1) % 2 == 1
    return result


def triangles_inside(boundary: Boundary, points: np.ndarray) -> tuple[scipy.spatial.Delaunay, np.ndarray]:
    """A Delaunay triangulation of points, the boundary points first, and which of its triangles are in the region.

    The triangles between boundary edges are one part; one test decides on all of them.
    """
    mesh = scipy.spatial.Delaunay(points + _jitter(len(points), boundary.lengths.min()))
    corners = mesh.simplices
    n = len(points)
    walls = set(_keys(boundary.edges, n).tolist())
    rows, columns = [], []
    for k in range(3):  # neighbour k is opposite to corner k
        across = mesh.neighbors[:, k]
        key = _keys(corners[:, [(k + 1) % 3, (k + 2) % 3]], n)
        passable = (across >= 0) & np.fromiter((value not in walls for value in key.tolist()), bool, len(key))
        rows.append(np.flatnonzero(passable))
        columns.append(across[passable])
    row, column = np.concatenate(rows), np.concatenate(columns)
    graph = sparse.coo_matrix((np.ones(len(row)), (row, column)), shape=(len(corners),) * 2)
    _, part = connected_components(graph, directed=False)
    area = np.abs(areas(points, corners))
    order = np.argsort(area, kind="stable")
    largest = np.zeros(part.max() + 1, dtype=int)
    largest[part[order]] = order  # the last entry wins: the largest triangle of each part
    is_inside = inside(boundary, points[corners[largest]].mean(axis=1))
    return mesh, is_inside[part] & (area > 1e-9 * area.max())


def _keys(pairs: np.ndarray, n: int) -> np.ndarray:
    pairs = np.sort(pairs, axis=1).astype(np.int64)
    return pairs[:, 0] * n + pairs[:, 1]


def missing_edges(boundary: Boundary, triangles: np.ndarray, n_points: int) -> np.ndarray:
    """Boundary edges that are no edge of a triangle  # (n,) bool"""
    pairs = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    return ~np.isin(_keys(boundary.edges, n_points), _keys(pairs, n_points))


def areas(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Signed areas  # (n,)"""
    a, b, c = (points[triangles[:, k]] for k in range(3))
    return ((b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])) / 2


def _jitter(n: int, length: float) -> np.ndarray:
    """Displacements that leave no four points on a circle: a lattice has many Delaunay triangulations  # (n, 2)"""
    k = np.arange(1, n + 1, dtype=float)[:, None]
    return 1e-7 * length * np.sin(k * [12.9898, 78.233] + [0.5, 1.5])


def check_crossings(boundary: Boundary, segments: Segments) -> None:
    """InputError where edges of different segments cross."""
    ends, n = boundary.ends, len(boundary.edges)
    a, d = ends[:, 0], ends[:, 1] - ends[:, 0]
    for k in range(n):
        later_edges = np.arange(k + 1, n)
        touches = np.isin(boundary.edges[later_edges], boundary.edges[k]).any(axis=1)
        later_edges = later_edges[~touches & (boundary.segment[later_edges] != boundary.segment[k])]
        gap = a[later_edges] - a[k]
        twice = d[k, 0] * d[later_edges, 1] - d[k, 1] * d[later_edges, 0]
        with np.errstate(divide="ignore", invalid="ignore"):
            t = (gap[:, 0] * d[later_edges, 1] - gap[:, 1] * d[later_edges, 0]) / twice
            s = (gap[:, 0] * d[k, 1] - gap[:, 1] * d[k, 0]) / twice
        hit = (t >= 0) & (t <= 1) & (s >= 0) & (s <= 1)
        if hit.any():
            x, y = a[k] + t[hit][0] * d[k]
            loops = segments.loop[boundary.segment[[k, later_edges[hit][0]]]]
            names = " and ".join("the outline" if loop == 0 else f"hole {loop}"
                                 for loop in dict.fromkeys(loops.tolist()))
            raise InputError("lines of the drawing cross", expected="lines that meet at their ends only",
                             found=f"a crossing of {names} at ({x:.6g}, {y:.6g})", remedy="move the points apart")


def _check_nesting(boundary: Boundary, segments: Segments) -> None:
    loop = segments.loop[boundary.segment]
    for k in range(1, int(loop.max()) + 1):
        of_hole, of_outline = loop == k, loop == 0
        outer = Boundary(boundary.points, boundary.edges[of_outline], boundary.segment[of_outline],
                         boundary.share[of_outline])
        in_another = [j for j in range(1, int(loop.max()) + 1) if j != k and inside(
            Boundary(boundary.points, boundary.edges[loop == j], boundary.segment[loop == j],
                     boundary.share[loop == j]),
            boundary.points[boundary.edges[of_hole][:1, 0]])[0]]
        if not inside(outer, boundary.points[boundary.edges[of_hole][:, 0]]).all() or in_another:
            location = f"inside hole {in_another[0]}" if in_another else "outside the outline"
            raise InputError("a hole is not in the material", expected="holes inside the outline, none in another one",
                             found=f"hole {k} is {location}", remedy="move the hole, or leave it out")
