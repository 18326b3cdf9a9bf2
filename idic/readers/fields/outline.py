"""The outline of measured points: a polygon with holes around them, wider than they are by a margin.

Neighbouring points are triangulated; gaps of a few points are closed, larger ones are holes (alpha shape, Edelsbrunner,
Kirkpatrick and Seidel 1983, doi:10.1109/TIT.1983.1056714). The steps of a grid along an inclined edge are replaced by
the straight line through them, and a round hole by a circle.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from idic.errors import InputError

MAX_CIRCUMRADIUS = 1.6  # distances of neighbours: larger triangles are gaps; one missing point of a square grid has 1.0
MAX_STEP = 0.75  # distances of neighbours: of the boundary from its straight lines; steps at 45 degrees have 0.71
MAX_OUT_OF_ROUND = 0.5  # distances of neighbours, rms: of the boundary of a hole from a circle
MIN_CORNER_ANGLE = np.radians(4.0)  # between two lines; less is one line
MIN_HOLE = 8  # points around a hole
MAX_CHAMFER = 3.0  # distances of neighbours: length of a line that cuts a corner, and how far the corner is from it
FIRST_CORNER = (0.377, 1.0)  # the corner lowest along this direction is the first: no axis of symmetry
SWEEPS = 20  # of a line: weights are the inverse distances from the one before
ROUNDED = 1e-6  # distances of neighbours: the same points in axes of another origin have the same corners
MIN_CLEARANCE = 0.1  # distances of neighbours, between lines that do not meet: less cannot be meshed
MIN_SPIKE_ANGLE = np.radians(10.0)  # between the two lines of a corner
MAX_MITRE = 4.0  # margins: a corner that would reach further out is a sliver


@dataclass(frozen=True, eq=False)
class PointOutline:
    """outline : (n, 2) corners, counter-clockwise; holes : ``[x, y, r]`` or (m, 2) corners; filled : part of the
    rectangle around the outline that it takes, holes left out; gaps : (k, 3) middle and width of gaps of the points
    that are taken as points that are missing"""

    outline: np.ndarray
    holes: tuple[np.ndarray, ...]
    filled: float
    gaps: np.ndarray

    @classmethod
    def around(cls, points: np.ndarray, pitch: float, margin: float) -> PointOutline:
        """The outline of points (n, 2) whose neighbours are `pitch` apart, wider by `margin` on all sides.

        Raises
        ------
        InputError
            No points are connected.
        """
        points = np.round(points / (ROUNDED * pitch)) * (ROUNDED * pitch)
        loops = sorted(loops_of(points, pitch), key=lambda loop: -abs(_area(loop)))
        if not loops:
            raise InputError("the points have no outline", expected="points next to each other",
                             found=f"{len(points)} points, none with two neighbours within {MAX_CIRCUMRADIUS:g} "
                             "distances",
                             remedy="draw the outline yourself: mesh = { outline_mm = … }")
        outer = _from_below(_sound(_turned(loops[0], True), pitch, margin))
        inner = [(loop, _hole(loop, pitch, margin) if len(loop) >= MIN_HOLE else None) for loop in loops[1:]]
        holes = [hole for _, hole in inner if hole is not None]
        gaps = [[*np.mean([loop.min(axis=0), loop.max(axis=0)], axis=0), np.ptp(loop, axis=0).max()]
                for loop, hole in inner if hole is None]
        area = abs(_area(outer)) - sum(np.pi * h[2]**2 if h.ndim == 1 else abs(_area(h)) for h in holes)
        return cls(outer, tuple(holes), float(area / np.prod(np.ptp(outer, axis=0))),
                   np.array(gaps, dtype=float).reshape(-1, 3))

    @property
    def ends(self) -> dict[str, list[int]]:
        """Segments (from 1) of the outline that are its LEFT, RIGHT, BOTTOM and TOP ends."""
        return sides_of_any(self.outline)


def sides_of_any(outline: np.ndarray) -> dict[str, list[int]]:
    """Segments (from 1) of an outline of either sense that are its LEFT, RIGHT, BOTTOM and TOP ends."""
    if _area(outline) > 0.0:
        return _sides(outline)
    n = len(outline)  # segment k of the reversed outline is n - k, the last one stays
    return {name: sorted((n - k - 1) % n + 1 for k in numbers) for name, numbers in _sides(outline[::-1]).items()}


def _sides(outline: np.ndarray) -> dict[str, list[int]]:
    """Segments (from 1) of a counter-clockwise outline that are its LEFT, RIGHT, BOTTOM and TOP ends."""
    following = np.roll(outline, -1, axis=0)
    along, middle = following - outline, 0.5 * (outline + following)
    outward = np.column_stack([along[:, 1], -along[:, 0]]) / np.hypot(*along.T)[:, None]
    low, high = outline.min(axis=0), outline.max(axis=0)
    segments = {}
    for name, axis, sign in (("LEFT", 0, -1), ("RIGHT", 0, 1), ("BOTTOM", 1, -1), ("TOP", 1, 1)):
        end = (high if sign > 0 else low)[axis]
        on_end = (sign * outward[:, axis] > np.cos(np.radians(20.0))) & (np.abs(middle[:, axis] - end) < 0.1
                                                                         * (high - low)[axis])
        if on_end.any():
            segments[name] = (np.flatnonzero(on_end) + 1).tolist()
    return segments


def _area(loop: np.ndarray) -> float:
    following = np.roll(loop, -1, axis=0)
    return 0.5 * float(np.sum(loop[:, 0] * following[:, 1] - following[:, 0] * loop[:, 1]))


def _from_below(corners: np.ndarray) -> np.ndarray:
    """The same corners, the lower left one first: edges have the same numbers whatever is rounded."""
    return np.roll(corners, -int(np.argmin(corners @ FIRST_CORNER)), axis=0)


def _turned(loop: np.ndarray, counter_clockwise: bool) -> np.ndarray:
    return loop if (_area(loop) > 0) == counter_clockwise else loop[::-1]


def loops_of(points: np.ndarray, pitch: float) -> list[np.ndarray]:
    """Boundary loops of the largest group of neighbouring points, in walking order; none of points on a line."""
    try:
        mesh = scipy.spatial.Delaunay(points)
    except (scipy.spatial.QhullError, ValueError):
        return []
    corners = mesh.simplices
    a, b, c = (points[corners[:, k]] for k in range(3))
    sides_ = [np.hypot(*(p - q).T) for p, q in ((b, c), (c, a), (a, b))]
    twice = np.abs((b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0]))
    radius = np.prod(sides_, axis=0) / np.maximum(2.0 * twice, 1e-300)
    is_small = radius < MAX_CIRCUMRADIUS * pitch
    if not is_small.any():
        return []
    across = np.where(mesh.neighbors >= 0, is_small[mesh.neighbors], False) & is_small[:, None]
    row, side = np.nonzero(across)
    graph = sparse.coo_array((np.ones(len(row)), (row, mesh.neighbors[row, side])), shape=(len(corners),) * 2)
    part = connected_components(graph, directed=False)[1]
    largest = np.argmax(np.bincount(part, is_small * twice))
    in_largest = is_small & (part == largest)
    row, side = np.nonzero(in_largest[:, None] & ~across)
    edges = np.column_stack([corners[row, (side + 1) % 3], corners[row, (side + 2) % 3]])
    return [points[loop] for loop in _walks(edges) if len(loop) > 2]


def _walks(edges: np.ndarray) -> list[np.ndarray]:
    """Closed walks along edges; one that meets itself in a point is cut there."""
    neighbours: dict[int, list[int]] = {}
    for first, second in edges.tolist():
        neighbours.setdefault(first, []).append(second)
        neighbours.setdefault(second, []).append(first)
    walks = []
    while neighbours:
        walk = [next(iter(neighbours))]
        place = {walk[0]: 0}
        while neighbours.get(walk[-1]):
            tail = walk[-1]
            head = neighbours[tail].pop()
            neighbours[head].remove(tail)
            if head in place:
                walks.append(np.array(walk[place[head]:]))
                for dropped in walk[place[head] + 1:]:
                    del place[dropped]
                walk = walk[:place[head] + 1]
            else:
                place[head] = len(walk)
                walk.append(head)
        neighbours = {node: nodes for node, nodes in neighbours.items() if nodes}
    return walks


def _straightened(loop: np.ndarray, pitch: float) -> np.ndarray:
    """The corners of the straight lines through the points of a loop  # (n, 2)"""
    start = int(np.argmax(np.hypot(*(loop - loop.mean(axis=0)).T)))
    loop = np.roll(loop, -start, axis=0)
    closed = np.vstack([loop, loop[:1]])
    opposite = int(np.argmax(np.hypot(*(loop - loop[0]).T)))
    corner_places = [0, *_chosen(closed, 0, opposite, MAX_STEP * pitch), opposite,
                     *_chosen(closed, opposite, len(loop), MAX_STEP * pitch)]
    lines = [_line(closed[first:end + 1])
             for first, end in zip(corner_places, [*corner_places[1:], len(loop)], strict=True)]
    merged = [lines[0]]
    for line in lines[1:]:
        if abs(_turn(merged[-1][1], line[1])) < MIN_CORNER_ANGLE:
            merged[-1] = _line(np.vstack([merged[-1][2], line[2]]))
        else:
            merged.append(line)
    if len(merged) > 3 and abs(_turn(merged[-1][1], merged[0][1])) < MIN_CORNER_ANGLE:
        merged[0] = _line(np.vstack([merged.pop()[2], merged[0][2]]))
    merged = _without_chamfers(merged, pitch)
    if len(merged) < 3:
        return closed[corner_places]
    return np.array([_crossing(previous, line)
                     for previous, line in zip([merged[-1], *merged[:-1]], merged, strict=True)])


def _chosen(points: np.ndarray, first: int, end: int, tolerance: float) -> list[int]:
    """Corners between two points by the farthest one (Douglas and Peucker 1973, doi:10.3138/FM57-6770-U75U-7727)."""
    if end - first < 2:
        return []
    chord = points[end] - points[first]
    off = points[first + 1:end] - points[first]
    length = float(np.hypot(*chord))
    distance = np.abs(chord[0] * off[:, 1] - chord[1] * off[:, 0]) / length if length > 0 else np.hypot(*off.T)
    at = int(np.argmax(distance))
    if distance[at] <= tolerance:
        return []
    middle = first + 1 + at
    return [*_chosen(points, first, middle, tolerance), middle, *_chosen(points, middle, end, tolerance)]


def _line(points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A point of the best line, its direction in walking order, and the points.

    Best is the least sum of distances: the few points of a curve at its end do not turn it. The ends are shared with
    the next line and do not count.
    """
    inner = points[1:-1] if len(points) > 4 else points
    weights = np.ones(len(inner))
    for _ in range(SWEEPS):
        centre = weights @ inner / weights.sum()
        direction = np.linalg.svd(np.sqrt(weights)[:, None] * (inner - centre), full_matrices=False)[2][0]
        off = np.abs((inner - centre) @ [-direction[1], direction[0]])
        weights = 1.0 / np.maximum(off, 1e-3 * max(float(off.max()), 1e-12))
    along = points[-1] - points[0]
    return centre, direction if direction @ along >= 0 else -direction, points


def _without_chamfers(lines: list, pitch: float) -> list:
    """Lines without the short ones that cut a corner of their neighbours, as a grid does with a corner askew to it."""
    k = 0
    while len(lines) > 3 and k < len(lines):
        previous, (centre, _, points), following = lines[k - 1], lines[k], lines[(k + 1) % len(lines)]
        short = np.hypot(*(points[-1] - points[0])) < MAX_CHAMFER * pitch
        if short and abs(np.sin(_turn(previous[1], following[1]))) > 0.5 and (
                np.hypot(*(_crossing(previous, following) - centre)) < MAX_CHAMFER * pitch):
            lines = lines[:k] + lines[k + 1:]
        else:
            k += 1
    return lines


def _turn(first: np.ndarray, second: np.ndarray) -> float:
    return float(np.arctan2(first[0] * second[1] - first[1] * second[0], first @ second))


def _crossing(first, second) -> np.ndarray:
    (p, d, _), (q, e, _) = first, second
    t = np.linalg.solve(np.column_stack([d, -e]), q - p)[0]
    return p + t * d


def _grown(corners: np.ndarray, margin: float) -> np.ndarray:
    """A counter-clockwise polygon wider by `margin` on all sides  # (n, 2)"""
    along = np.roll(corners, -1, axis=0) - corners
    along = along / np.hypot(*along.T)[:, None]
    outward = np.column_stack([along[:, 1], -along[:, 0]])
    previous_outward = np.roll(outward, 1, axis=0)
    cosine = np.maximum(1.0 + np.sum(previous_outward * outward, axis=1), 2.0 / MAX_MITRE**2)
    return corners + margin * (previous_outward + outward) / cosine[:, None]


def _sound(loop: np.ndarray, pitch: float, margin: float) -> np.ndarray:
    """The straight lines through a counter-clockwise loop, wider by a margin; where these cross or come too near to
    each other, corners that are closer to the points, and in the end the points themselves  # (n, 2)"""
    corners = _grown(_straightened(loop, pitch), margin)
    for tolerance, width in ((MAX_STEP, margin), (0.5 * MAX_STEP, margin), (0.0, margin), (0.0, 0.0)):
        if _can_be_meshed(corners, pitch):
            break
        corners = _grown(_corners(loop, tolerance * pitch), width)
    return corners


def _corners(loop: np.ndarray, tolerance: float) -> np.ndarray:
    """The points of a loop that the others lie within `tolerance` of lines between."""
    loop = np.roll(loop, -int(np.argmax(np.hypot(*(loop - loop.mean(axis=0)).T))), axis=0)
    closed, opposite = np.vstack([loop, loop[:1]]), int(np.argmax(np.hypot(*(loop - loop[0]).T)))
    return closed[[0, *_chosen(closed, 0, opposite, tolerance), opposite,
                   *_chosen(closed, opposite, len(loop), tolerance)]]


def _can_be_meshed(corners: np.ndarray, pitch: float) -> bool:
    """Whether the lines of a polygon meet at their corners only, and under an angle."""
    n, following = len(corners), np.roll(corners, -1, axis=0)
    along, back = following - corners, np.roll(corners, 1, axis=0) - corners
    turn = np.abs(np.arctan2(along[:, 0] * back[:, 1] - along[:, 1] * back[:, 0], np.sum(along * back, axis=1)))
    if turn.min() < MIN_SPIKE_ANGLE or np.hypot(*along.T).min() < MIN_CLEARANCE * pitch or _area(corners) <= 0.0:
        return False
    first, second = np.triu_indices(n, 2)
    is_separate = (first > 0) | (second < n - 1)
    first, second = first[is_separate], second[is_separate]
    if not len(first):
        return True
    ends = [(corners[first], following[first]), (corners[second], following[second])]
    off = [[_beside(p, a, b) for p in pair] for (a, b), pair in ((ends[0], ends[1]), (ends[1], ends[0]))]
    least = (ROUNDED * pitch) ** 2  # lines that touch have no clearance
    if np.any((off[0][0] * off[0][1] < -least) & (off[1][0] * off[1][1] < -least)):
        return False
    nearest = min(float(_distance(p, *line).min()) for points, line in ((ends[0], ends[1]), (ends[1], ends[0]))
                  for p in points)
    return nearest >= MIN_CLEARANCE * pitch


def _beside(points: np.ndarray, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """How far points lie to the left of the lines through two others, row by row  # (n, 2) each -> (n,)"""
    along, off = end - start, points - start
    return (along[:, 0] * off[:, 1] - along[:, 1] * off[:, 0]) / np.hypot(*along.T)


def _distance(points: np.ndarray, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Of points from the line between two others, row by row  # (n, 2) each -> (n,)"""
    along = end - start
    share = np.clip(np.sum((points - start) * along, axis=1) / np.sum(along**2, axis=1), 0.0, 1.0)
    return np.hypot(*(points - start - share[:, None] * along).T)


def _hole(loop: np.ndarray, pitch: float, margin: float) -> np.ndarray | None:
    """A hole narrower by the margin: ``[x, y, r]`` of a round one, else corners; None where nothing is left."""
    matrix = np.column_stack([2.0 * loop, np.ones(len(loop))])
    x, y, constant = np.linalg.lstsq(matrix, np.sum(loop**2, axis=1), rcond=None)[0]
    radius = np.hypot(*(loop - (x, y)).T)
    mean = float(np.sqrt(max(constant + x * x + y * y, 0.0)))
    if np.sqrt(np.mean((radius - mean) ** 2)) < MAX_OUT_OF_ROUND * pitch:
        return np.array([x, y, mean - margin]) if mean > margin else None
    corners = _sound(_turned(loop, True), pitch, -margin)
    return corners if _area(corners) > pitch**2 else None
