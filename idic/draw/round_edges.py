"""A contour as straight lines and arcs: a round edge of the speckled area is drawn as one, not as a polygon.

The contour is cut where lines and circles, each by least squares, follow it best at a price per piece: the least sum
over all cuts, by dynamic programming (Bellman 1961, doi:10.1145/366573.366611).
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

MAX_POINTS = 360  # of the contour
NOISE_SHARE = 0.4  # of the tolerance: standard deviation of a contour point
LINE_PRICE, ARC_PRICE = 16.0, 24.0  # chi-square that a further piece has to save
MIN_POINTS = 5  # of an arc
MIN_SWEEP, MAX_SWEEP = np.deg2rad(20), np.deg2rad(330)
MAX_CIRCLE_SHARE = 0.45  # of the tolerance: rms distance of a contour that is a circle
NEAR = 4.0  # tolerances: an intersection this near to the end of a piece is its corner
ENDS_LEFT_OUT = 0.15  # of a piece, where it is placed to the pixel: corners are rounded
EDGE_SHARE = 0.5  # of the gradient energy inside: less is background
INSET_PX = 1.0  # a central difference sees the edge one pixel before it
STEP_PX = 0.5


@dataclass(frozen=True)
class Piece:
    """A line (radius 0: `at` a point of it, `normal` outwards) or an arc (`at` its centre) for points first to last."""

    first: int
    last: int
    at: np.ndarray
    normal: np.ndarray
    radius: float

    def moved(self, distance: float, bulges: float) -> Piece:
        """Outwards by a distance; bulges : 1 where outwards is away from the centre, -1 where it is towards it."""
        if self.radius:
            return Piece(self.first, self.last, self.at, self.normal, self.radius + bulges * distance)
        return Piece(self.first, self.last, self.at + distance * self.normal, self.normal, 0.0)

    def foot(self, point: np.ndarray) -> np.ndarray:
        """The point of the line or circle next to a point."""
        if self.radius:
            away = point - self.at
            return self.at + away * (self.radius / max(float(np.hypot(*away)), 1e-9))
        return point - ((point - self.at) @ self.normal) * self.normal


def circle_of(contour: np.ndarray, tolerance: float) -> tuple[float, float, float] | None:
    """The circle of a closed contour; None where the contour leaves it by more than the tolerance.

    Parameters
    ----------
    contour : (n, 2) px
    tolerance : px

    Returns
    -------
    x, y, radius in px, by least squares of x² + y² (Kåsa 1976, doi:10.1109/TIM.1976.6312298)
    """
    if len(contour) < MIN_POINTS:
        return None
    sums = _sums(contour - contour.mean(axis=0))
    centre, radius, _ = _circles(sums[-1:])
    centre = centre[0] + contour.mean(axis=0)
    distance = np.hypot(*(contour - centre).T) - radius[0]
    close = np.abs(distance).max() <= tolerance and np.sqrt((distance**2).mean()) <= MAX_CIRCLE_SHARE * tolerance
    return (float(centre[0]), float(centre[1]), float(radius[0])) if close else None


def lines_and_arcs(contour: np.ndarray, tolerance: float, image: np.ndarray, outwards: float = 1.0) -> list:
    """The contour as corners with straight lines and arcs between them, placed where the pattern of the image ends.

    Parameters
    ----------
    contour : (n, 2) float32, px, closed, in order
    tolerance : px, of the contour
    image : (ny, nx)
    outwards : 1 where the pattern is inside the contour, -1 where the contour is a hole in it

    Returns
    -------
    entries as in `idic.fe.mesh.outline`: [x, y], or [xm, ym, x, y] for an arc through (xm, ym)
    """
    points, cuts = _cut_up(_from_a_corner(contour, tolerance), NOISE_SHARE * tolerance)
    pieces = [_fitted(points, *cut) for cut in cuts]
    if len(pieces) < 2 or (len(pieces) == 2 and not any(piece.radius for piece in pieces)):
        return np.round(cv2.approxPolyDP(contour, tolerance, True)[:, 0]).tolist()
    turns = outwards * np.sign(_area(points))
    pieces = [_placed(piece, points, image, turns, tolerance) for piece in pieces]
    corners = [_corner(previous, piece, points, tolerance)
               for previous, piece in zip(pieces[-1:] + pieces, pieces, strict=False)]
    entries = []
    for k, corner in enumerate(corners):
        previous = pieces[k - 1]
        middle = previous.foot(points[(previous.first + previous.last) // 2 % len(points)]) if previous.radius else ()
        entries.append(np.round([*middle, *corner], 1).tolist())
    return entries


def _from_a_corner(contour: np.ndarray, tolerance: float) -> np.ndarray:
    """At most `MAX_POINTS` points of the contour, the first one at its sharpest corner  # (n, 2)"""
    corners = cv2.approxPolyDP(contour, tolerance, True)[:, 0].astype(float)
    leaving, arriving = np.roll(corners, -1, axis=0) - corners, corners - np.roll(corners, 1, axis=0)
    turn = np.arctan2(arriving[:, 0] * leaving[:, 1] - arriving[:, 1] * leaving[:, 0], (arriving * leaving).sum(axis=1))
    sharpest = corners[int(np.argmax(np.abs(turn)))]
    start = int(np.argmin(np.hypot(*(contour - sharpest).T)))
    return np.roll(contour, -start, axis=0)[:: max(len(contour) // MAX_POINTS, 1)].astype(float)


def _cut_up(points: np.ndarray, std: float) -> tuple[np.ndarray, list]:
    """Points and cuts of the closed contour. The first point is a cut whether it helps or not: the contour is cut once
    more from a free one."""
    cuts = _cuts(points - points.mean(axis=0), std)
    if len(cuts) > 1:
        points = np.roll(points, -cuts[len(cuts) // 2][0], axis=0)
        cuts = _cuts(points - points.mean(axis=0), std)
    return points, cuts


def _sums(points: np.ndarray) -> np.ndarray:
    """Sums over the first k points of 1, x, y, xx, xy, yy, z, zx, zy, zz with z = xx + yy  # (n + 1, 10)"""
    x, y = points.T
    z = x * x + y * y
    terms = np.column_stack([np.ones_like(x), x, y, x * x, x * y, y * y, z, z * x, z * y, z * z])
    return np.concatenate([np.zeros((1, 10)), np.cumsum(terms, axis=0)])


def _cuts(points: np.ndarray, std: float) -> list[tuple[int, int, bool]]:
    """Pieces (first, last, is an arc) of a closed contour that starts at a corner; its end is the first point."""
    closed = np.concatenate([points, points[:1]])
    sums, n = _sums(closed), len(closed)
    length = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(closed, axis=0).T))])
    best, origin, round_ = np.full(n, np.inf), np.zeros(n, dtype=int), np.zeros(n, dtype=bool)
    best[0] = 0.0
    for end in range(1, n):
        first = np.arange(end)
        piece_sums = sums[end + 1] - sums[first]
        line = best[first] + _line_squares(piece_sums) / std**2 + LINE_PRICE
        centre, radius, squares = _circles(piece_sums)
        arc = best[first] + squares / std**2 + ARC_PRICE
        swept = (length[end] - length[first]) / np.maximum(radius, 1e-9)
        arc[(piece_sums[:, 0] < MIN_POINTS) | (swept < MIN_SWEEP) | (swept > MAX_SWEEP)] = np.inf
        cheaper = np.minimum(line, arc)
        origin[end] = int(np.argmin(cheaper))
        best[end], round_[end] = cheaper[origin[end]], arc[origin[end]] < line[origin[end]]
    cuts, end = [], n - 1
    while end > 0:
        cuts.append((int(origin[end]), end, bool(round_[end])))
        end = int(origin[end])
    return cuts[::-1]


def _line_squares(sums: np.ndarray) -> np.ndarray:
    """Sum of the squared distances from the best line: the smaller eigenvalue of the scatter  # (m,)"""
    count, x, y, xx, xy, yy = sums[:, :6].T
    a, b, c = xx - x * x / count, xy - x * y / count, yy - y * y / count
    return np.maximum((a + c) / 2 - np.sqrt(((a - c) / 2) ** 2 + b * b), 0.0)


def _circles(sums: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Centres (m, 2), radii (m,) and sums of squared distances (m,) by least squares of x² + y²."""
    count, x, y, xx, xy, yy, z, zx, zy, zz = sums.T
    matrix = np.stack([np.stack([4 * xx, 4 * xy, 2 * x], -1), np.stack([4 * xy, 4 * yy, 2 * y], -1),
                       np.stack([2 * x, 2 * y, count], -1)], -2)
    right = np.stack([2 * zx, 2 * zy, z], -1)
    scale = np.maximum(xx + yy, 1e-9)
    matrix = matrix + 1e-12 * scale[:, None, None] * np.eye(3)
    p, q, c = np.linalg.solve(matrix, right[..., None])[..., 0].T
    radius = np.sqrt(np.maximum(c + p * p + q * q, 1e-12))
    algebraic = zz - 2 * (2 * p * zx + 2 * q * zy + c * z) + 4 * p * p * xx + 8 * p * q * xy + 4 * q * q * yy \
        + 4 * p * c * x + 4 * q * c * y + c * c * count
    return np.stack([p, q], -1), radius, np.maximum(algebraic, 0.0) / (4 * radius**2)


def _fitted(points: np.ndarray, first: int, end: int, is_arc: bool) -> Piece:
    run = np.take(points, range(first, end + 1), axis=0, mode="wrap")
    middle = run.mean(axis=0)
    if is_arc:
        centre, radius, _ = _circles(_sums(run - middle)[-1:])
        return Piece(first, end, centre[0] + middle, np.zeros(2), float(radius[0]))
    _, _, axes = np.linalg.svd(run - middle, full_matrices=False) if len(run) > 1 else (0, 0, np.eye(2))
    return Piece(first, end, middle, np.array([-axes[0][1], axes[0][0]]), 0.0)


def _area(points: np.ndarray) -> float:
    following = np.roll(points, -1, axis=0)
    return float((points[:, 0] * following[:, 1] - following[:, 0] * points[:, 1]).sum()) / 2


def _placed(piece: Piece, points: np.ndarray, image: np.ndarray, turns: float, tolerance: float) -> Piece:
    """The piece where the pattern ends, within two tolerances; as it is where it is too short to tell."""
    run = np.take(points, range(piece.first, piece.last + 1), axis=0, mode="wrap")
    margin = int(np.ceil(ENDS_LEFT_OUT * len(run)))
    inner = np.array([piece.foot(point) for point in run[margin : len(run) - margin]])
    along = run[-1] - run[0]
    outside = turns * np.array([along[1], -along[0]])  # of the chord
    if piece.radius:
        rays = (inner - piece.at) / piece.radius if len(inner) else inner
        bulges = 1.0 if (run[len(run) // 2] - piece.at) @ _outside_at(run, turns) >= 0 else -1.0
        normals = bulges * rays
    else:
        bulges = 0.0
        normal = piece.normal if piece.normal @ outside >= 0 else -piece.normal
        piece = Piece(piece.first, piece.last, piece.at, normal, 0.0)
        normals = np.tile(normal, (len(inner), 1))
    if len(inner) < MIN_POINTS:
        return piece
    reach = 2 * tolerance
    offsets = np.arange(-3 * reach, reach + STEP_PX, STEP_PX)
    profile = _energy(image, inner[None] + offsets[:, None, None] * normals[None]).mean(axis=1)
    level = EDGE_SHARE * float(np.median(profile[offsets < -reach]))
    textured = np.flatnonzero((offsets >= -reach) & (profile >= level))
    end = float(offsets[textured[-1]]) - INSET_PX if len(textured) else 0.0
    return piece.moved(end, bulges) if abs(end) < reach - STEP_PX else piece


def _outside_at(run: np.ndarray, turns: float) -> np.ndarray:
    """Outwards at the middle of a run of points."""
    k = len(run) // 2
    along = run[min(k + 1, len(run) - 1)] - run[max(k - 1, 0)]
    return turns * np.array([along[1], -along[0]])


def _energy(image: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Squared gradient by central differences at places (…, 2)  # (…)"""
    def grey(dx: float, dy: float) -> np.ndarray:
        x, y = (places[..., k].astype(np.float32) + np.float32(d) for k, d in ((0, dx), (1, dy)))
        return cv2.remap(source, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).astype(np.float32)

    source = image if image.dtype in (np.uint8, np.uint16, np.float32) else image.astype(np.float32)
    fx, fy = grey(1, 0) - grey(-1, 0), grey(0, 1) - grey(0, -1)
    return (fx * fx + fy * fy) / 4


def _corner(incoming: Piece, outgoing: Piece, points: np.ndarray, tolerance: float) -> np.ndarray:
    """Where two pieces meet: their intersection near the cut; where they touch, the middle between both."""
    cut = points[outgoing.first % len(points)]
    crossings = [point for point in _intersections(incoming, outgoing) if np.hypot(*(point - cut)) < NEAR * tolerance]
    if crossings:
        return min(crossings, key=lambda point: float(np.hypot(*(point - cut))))
    return (incoming.foot(cut) + outgoing.foot(cut)) / 2


def _intersections(piece: Piece, neighbour: Piece) -> list[np.ndarray]:
    if not piece.radius and not neighbour.radius:
        matrix = np.array([piece.normal, neighbour.normal])
        if abs(np.linalg.det(matrix)) < 0.05:
            return []
        return [np.linalg.solve(matrix, [piece.normal @ piece.at, neighbour.normal @ neighbour.at])]
    if piece.radius and neighbour.radius:
        between = neighbour.at - piece.at
        distance = float(np.hypot(*between))
        if distance < 1e-9:
            return []
        share = (distance**2 + piece.radius**2 - neighbour.radius**2) / (2 * distance)
        foot, direction = piece.at + share * between / distance, np.array([-between[1], between[0]]) / distance
        half_chord_squared = piece.radius**2 - share**2
    else:
        line, circle = (neighbour, piece) if piece.radius else (piece, neighbour)
        foot, direction = line.foot(circle.at), np.array([-line.normal[1], line.normal[0]])
        half_chord_squared = circle.radius**2 - float((foot - circle.at) @ (foot - circle.at))
    if half_chord_squared < 0:
        return []
    return [foot + np.sqrt(half_chord_squared) * direction, foot - np.sqrt(half_chord_squared) * direction]
