"""Closed outlines of straight lines and circular arcs: the plane region of a drawn mesh.

An outline is a list of entries: ``[x, y]``, a straight line to this point; ``[xm, ym, x, y]``, an arc through (xm, ym)
to (x, y). Segment k runs from point k to point k + 1, the last one back to the first point. ``[xc, yc, r]`` in the
place of a list is a circle.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from idic.errors import InputError
from idic.fe.mesh.mesh import Mesh

MAX_ARC_ANGLE = np.pi / 4 + 1e-9  # of one edge: eight edges around a circle; their chord area is 90 % of it
MIN_ARC_HEIGHT = 1e-6  # of the chord: flatter arcs are straight lines


@dataclass(frozen=True)
class Segments:
    """Straight lines (sweep 0) and arcs, counted over all closed loops of a region.

    Attributes
    ----------
    start, end : (n, 2)
    centre : (n, 2), radius : (n,), angle : (n,) rad
        Of arcs: the point at the share t of the segment lies at the angle ``angle + t sweep``.
    sweep : (n,) rad
        Counter-clockwise positive; 0: a straight line.
    loop : (n,) int
        0: the outline, 1, 2, …: the holes.
    """

    start: np.ndarray
    end: np.ndarray
    centre: np.ndarray
    radius: np.ndarray
    angle: np.ndarray
    sweep: np.ndarray
    loop: np.ndarray

    @property
    def curved(self) -> np.ndarray:
        return self.sweep != 0

    @property
    def length(self) -> np.ndarray:
        """(n,)"""
        return np.where(self.curved, self.radius * np.abs(self.sweep), np.hypot(*(self.end - self.start).T))

    def at(self, segment: np.ndarray, share: np.ndarray) -> np.ndarray:
        """The points at shares t of segments  # (m,), (m,) -> (m, 2)"""
        t = np.asarray(share, dtype=float)[:, None]
        straight = self.start[segment] + t * (self.end[segment] - self.start[segment])
        phi = self.angle[segment] + np.asarray(share) * self.sweep[segment]
        arc = self.centre[segment] + self.radius[segment, None] * np.column_stack([np.cos(phi), np.sin(phi)])
        inner = (np.asarray(share) > 0) & (np.asarray(share) < 1) & self.curved[segment]
        return np.where(inner[:, None] | self._circle[segment, None], arc, straight)

    @property
    def _circle(self) -> np.ndarray:
        return np.abs(self.sweep) > 2 * np.pi - 1e-9

    def box(self) -> np.ndarray:
        """Least and largest coordinates of the outline without its holes, arcs by 64 points  # (2, 2)"""
        outer_segments, shares = np.flatnonzero(self.loop == 0), np.linspace(0, 1, 65)
        points = self.at(np.repeat(outer_segments, len(shares)), np.tile(shares, len(outer_segments)))
        return np.array([points.min(axis=0), points.max(axis=0)])

    def area(self) -> float:
        """The area enclosed by the outline less that of the holes, exact for arcs."""
        cross = self.start[:, 0] * self.end[:, 1] - self.start[:, 1] * self.end[:, 0]
        sector = self.radius**2 * (self.sweep - np.sin(self.sweep))
        loop_areas = [abs(float((cross + sector)[self.loop == k].sum()) / 2) for k in range(int(self.loop.max()) + 1)]
        return loop_areas[0] - sum(loop_areas[1:])

    @classmethod
    def of(cls, outline: Sequence, holes: Sequence = ()) -> Segments:
        """The segments of an outline and its holes.

        Parameters
        ----------
        outline : sequence of entries, or (n, 2) array, or [xc, yc, r]
        holes : sequence of the same

        Raises
        ------
        InputError
            Fewer than three points (two with an arc), a repeated point, an arc without a circle, values that are not
            numbers.
        """
        parts = [_loop(entries, "outline" if k == 0 else f"hole {k}") for k, entries in enumerate((outline, *holes))]
        loop = np.repeat(np.arange(len(parts)), [len(part[0]) for part in parts])
        start, end, centre, radius, angle, sweep = (np.concatenate(columns) for columns in zip(*parts, strict=True))
        return cls(start, end, centre, radius, angle, sweep, loop)

    @staticmethod
    def is_circle(entries: Sequence) -> bool:
        """Whether a loop is given as [xc, yc, r]."""
        return len(entries) == 3 and all(np.ndim(entry) == 0 for entry in entries)

    def on_arcs(self, mesh: Mesh) -> Mesh:
        """A mesh of quadratic elements with the mid-side nodes of the boundary on the arcs of the drawing.

        mesh : of this drawing after `raise_order`, in the unit of the drawing
        """
        curved = np.flatnonzero(self.curved)
        faces = mesh.boundary_faces()
        if not len(curved) or not len(faces):
            return mesh
        ends = np.array([mesh.face_nodes(face) for face in faces])  # (n, 3): corner, corner, middle
        a, b, middle = (mesh.nodes[ends[:, k]] for k in range(3))
        nodes = mesh.nodes.copy()
        for k in curved:
            centre, radius = self.centre[k], self.radius[k]
            on = [np.abs(np.hypot(*(x - centre).T) - radius) < 1e-6 * radius for x in (a, b)]
            on_arc = on[0] & on[1]
            offset = middle - centre
            distance = np.hypot(*offset.T)
            turned = (np.arctan2(offset[:, 1], offset[:, 0]) - self.angle[k]) * np.sign(self.sweep[k]) % (2 * np.pi)
            on_arc &= (turned < abs(self.sweep[k])) & (distance > 0.5 * radius)
            nodes[ends[on_arc, 2]] = centre + offset[on_arc] * (radius / distance[on_arc])[:, None]
        return replace(mesh, nodes=nodes)


def _loop(entries: Sequence, name: str):
    if Segments.is_circle(entries):
        return _circle(np.asarray(entries, dtype=float), name)
    rows = [np.asarray(entry, dtype=float).ravel() for entry in entries]
    if any(len(row) not in (2, 4) or not np.isfinite(row).all() for row in rows):
        bad = next(row for row in rows if len(row) not in (2, 4) or not np.isfinite(row).all())
        raise _refused(f"not a point of the {name}", "[x, y], or [xm, ym, x, y] for an arc through (xm, ym)",
                       str(bad.tolist()), "correct this entry")
    if len(rows) < 3 and not (len(rows) == 2 and any(len(row) == 4 for row in rows)):
        raise _refused(f"the {name} encloses nothing", "three points or more", str(len(rows)), "add points")
    end = np.array([row[-2:] for row in rows[1:] + rows[:1]])
    start = np.array([row[-2:] for row in rows])
    chord = np.hypot(*(end - start).T)
    if (chord < 1e-9 * np.ptp(start, axis=0).max()).any():
        k = int(np.argmin(chord))
        raise _refused(f"two points of the {name} are the same", "different points", str(start[k].tolist()),
                       "leave one of them out")
    n = len(rows)
    centre, radius, angle, sweep = np.zeros((n, 2)), np.zeros(n), np.zeros(n), np.zeros(n)
    for k, row in enumerate(rows[1:] + rows[:1]):
        if len(row) == 4:
            centre[k], radius[k], angle[k], sweep[k] = _arc(start[k], row[:2], end[k])
    return start, end, centre, radius, angle, sweep


def _circle(numbers: np.ndarray, name: str):
    x, y, radius = numbers
    if not (np.isfinite(numbers).all() and radius > 0):
        raise _refused(f"not a circle: {name}", "[x, y, radius] with a positive radius", str(numbers.tolist()),
                       "correct it")
    start = np.array([[x + radius, y]])
    return start, start, np.array([[x, y]]), np.array([radius]), np.zeros(1), np.array([2 * np.pi])


def _arc(a: np.ndarray, through: np.ndarray, b: np.ndarray):
    """Centre, radius, first angle and sweep of the circle through three points; nothing curved where they are in
    line."""
    chord, middle = b - a, through - a
    twice = chord[0] * middle[1] - chord[1] * middle[0]  # twice the area of the triangle
    if abs(twice) < MIN_ARC_HEIGHT * (chord @ chord):
        return np.zeros(2), 0.0, 0.0, 0.0
    normal = np.array([-chord[1], chord[0]])
    offset = (middle @ middle - middle @ chord) / (2 * twice)
    centre = a + chord / 2 + offset * normal
    first, last_angle = np.arctan2(*(a - centre)[::-1]), np.arctan2(*(b - centre)[::-1])
    sweep = (last_angle - first) % (2 * np.pi) if twice < 0 else -((first - last_angle) % (2 * np.pi))
    return centre, float(np.hypot(*(a - centre))), float(first), float(sweep)


def _refused(message: str, expected: str, finding: str, remedy: str) -> InputError:
    return InputError(message, expected=expected, found=finding, remedy=remedy)


@dataclass(frozen=True)
class Boundary:
    """The loops cut into straight edges.

    Attributes
    ----------
    points : (n, 2)
    edges : (n, 2) int, indices of points
    segment : (n,) int, of each edge
    share : (n, 2), where the ends of each edge lie on its segment, 0 to 1
    """

    points: np.ndarray
    edges: np.ndarray
    segment: np.ndarray
    share: np.ndarray

    @property
    def ends(self) -> np.ndarray:
        """(n, 2 ends, 2)"""
        return self.points[self.edges]

    @property
    def lengths(self) -> np.ndarray:
        """(n,)"""
        return np.hypot(*(self.ends[:, 1] - self.ends[:, 0]).T)

    @property
    def middles(self) -> np.ndarray:
        """Of the chords  # (n, 2)"""
        return self.ends.mean(axis=1)


def cut(segments: Segments, size: float) -> Boundary:
    """Every segment in equal edges, not longer than about `size`, on arcs not more than 45 degrees each."""
    counts = np.maximum(np.round(segments.length / size), np.ceil(np.abs(segments.sweep) / MAX_ARC_ANGLE))
    counts = np.maximum(counts, 1).astype(int)
    segment = np.repeat(np.arange(len(counts)), counts)
    first = np.concatenate([[0], np.cumsum(counts)[:-1]])
    k = np.arange(len(segment)) - first[segment]
    points = segments.at(segment, k / counts[segment])
    following = np.arange(len(segment)) + 1
    for loop in range(int(segments.loop.max()) + 1):
        loop_edges = np.flatnonzero(segments.loop[segment] == loop)
        following[loop_edges[-1]] = loop_edges[0]
    share = np.column_stack([k, k + 1]) / counts[segment, None]
    return Boundary(points, np.column_stack([np.arange(len(segment)), following]), segment, share)


def halved(boundary: Boundary, segments: Segments, chosen: np.ndarray) -> Boundary:
    """The boundary with the edges `chosen` (bool) cut in two, at the middle of their line or arc."""
    middle_share = boundary.share[chosen].mean(axis=1)
    middle = segments.at(boundary.segment[chosen], middle_share)
    middle_numbers = len(boundary.points) + np.arange(len(middle))
    uncut, cut_edges = ~chosen, boundary.edges[chosen]
    edges = np.concatenate([boundary.edges[uncut], np.column_stack([cut_edges[:, 0], middle_numbers]),
                            np.column_stack([middle_numbers, cut_edges[:, 1]])])
    share = np.concatenate([boundary.share[uncut], np.column_stack([boundary.share[chosen, 0], middle_share]),
                            np.column_stack([middle_share, boundary.share[chosen, 1]])])
    segment = np.concatenate([boundary.segment[uncut], np.tile(boundary.segment[chosen], 2)])
    return Boundary(np.concatenate([boundary.points, middle]), edges, segment, share)
