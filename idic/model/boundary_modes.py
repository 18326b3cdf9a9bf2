"""Shapes along an edge and courses in time, of which a virtual boundary is made.

    u(node, frame) = sum_ij  a_ij  shape_i(node)  course_j(frame),      a_ij: degrees of freedom in mm

An edge is parametrised by the arc length along the boundary of the mesh. A set may hold several pieces, turn corners or
close on itself: B-splines are continuous around a corner and free to bend there, smooth elsewhere, periodic on a closed
smooth edge. Courses vanish at the reference frame and before it.

Source: virtual boundaries, Neggers et al. 2015, section 2.3; B-splines: de Boor, A Practical Guide to Splines, 1978.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.polynomial import legendre

from idic.errors import InputError
from idic.fe import CORNER_COSINE, Mesh

MODE_DEGREE = 3


@dataclass(frozen=True)
class Piece:
    """A connected part of an edge.

    places : positions of its nodes in the set, in walking order; along : (n,) mm, arc length; length : mm, of the whole
    piece, the way back to the first node of a closed one included; corners : arc lengths at which it turns.
    """

    places: np.ndarray
    along: np.ndarray
    length: float
    closed: bool
    corners: tuple[float, ...]


def edge_shapes(mesh: Mesh, nodes: np.ndarray, kind: str, modes: int, name: str = "") -> np.ndarray:
    """Shape functions of a set of nodes  # (n, modes)

    Parameters
    ----------
    nodes : (n,) node indices
    kind : "bspline" (partition of unity: an amplitude is about the motion in mm there) | "polynomial" (Legendre)
    name : what the set is called in messages

    Raises
    ------
    InputError
        Fewer modes than straight parts, or a polynomial around a corner.
    """
    pieces = edge_pieces(mesh, nodes)
    if not pieces:  # inside the body, or in a solid: along the main direction of the set
        pieces = [_straight(mesh.nodes[nodes])]
    if kind == "polynomial":
        if len(pieces) > 1 or pieces[0].corners or pieces[0].closed:
            raise InputError("polynomial modes on an edge with corners", file="experiment.toml", key=name,
                             expected="one edge without corners", found=_described(pieces),
                             remedy='use virtual = "bspline", or one set per side')
        shapes = np.zeros((len(nodes), modes))
        x = 2.0 * pieces[0].along / max(pieces[0].length, 1e-300) - 1.0
        shapes[pieces[0].places] = legendre.legvander(x, modes - 1)
        return shapes
    return _splines(pieces, len(nodes), modes, name)


def time_courses(times: np.ndarray, reference: int, kind: str, modes: int) -> np.ndarray:
    """Courses in time, zero up to the reference frame  # times (n_frames,) s -> (n_frames, modes)

    "bspline": clamped B-splines without the first one, knots even in frames (a camera is faster where more happens), so
    that as many modes as frames follow any course; "polynomial": t P_j(2 t - 1), t in 0 ... 1.
    """
    if kind == "polynomial":
        span = times[-1] - times[reference]
        t = np.clip((times - times[reference]) / (span or 1.0), 0.0, 1.0)
        return t[:, None] * legendre.legvander(2.0 * t - 1.0, modes - 1)
    later = len(times) - 1 - reference
    t = np.clip((np.arange(len(times)) - reference) / max(later, 1), 0.0, 1.0)
    degree = min(MODE_DEGREE, modes)
    knots = np.concatenate([np.zeros(degree), np.linspace(0.0, 1.0, modes + 2 - degree), np.ones(degree)])
    return scipy.interpolate.BSpline.design_matrix(t, knots, degree).toarray()[:, 1:]


def edge_pieces(mesh: Mesh, nodes: np.ndarray) -> list[Piece]:
    """The connected parts of the edge that a set of nodes covers; none where a node is not on the edge of a plane mesh.
    """
    if mesh.n_dim != 2:
        return []
    place = {int(node): i for i, node in enumerate(nodes)}
    pieces, n_covered = [], 0
    for path in mesh.boundary_paths():
        inside = np.array([node in place for node in path])
        n_covered += int(inside.sum())
        if inside.all():
            pieces.append(_closed_piece(mesh, place, path))
            continue
        breaks = np.flatnonzero(inside & ~np.roll(inside, 1))  # where a run of nodes of the set begins
        for first in breaks:
            run = []
            while inside[(first + len(run)) % len(path)]:
                run.append(path[(first + len(run)) % len(path)])
            pieces.append(_open_piece(mesh, place, run))
    return pieces if n_covered == len(nodes) else []


def _open_piece(mesh: Mesh, place, run: list[int]) -> Piece:
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(mesh.nodes[run], axis=0), axis=1))])
    turns = _turns(mesh.nodes[run])
    return Piece(np.array([place[node] for node in run]), along, float(along[-1]), False,
                 tuple(float(s) for s in along[1:-1][turns]))


def _closed_piece(mesh: Mesh, place, path: list[int]) -> Piece:
    """A whole loop; it begins at a corner where it has one."""
    around = mesh.nodes[[path[-1], *path, path[0]]]
    corners = np.flatnonzero(_turns(around))
    path = path[corners[0]:] + path[:corners[0]] if len(corners) else path
    steps = np.linalg.norm(np.diff(mesh.nodes[[*path, path[0]]], axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    at = corners - corners[0] if len(corners) else corners
    return Piece(np.array([place[node] for node in path]), along[:-1], float(along[-1]), True,
                 tuple(float(along[k]) for k in at))


def _turns(points: np.ndarray) -> np.ndarray:
    """Whether the path has a corner at each of its inner points  # (n, 2) -> (n - 2,) bool"""
    steps = np.diff(points, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    return np.einsum("ij,ij->i", steps[:-1], steps[1:]) < CORNER_COSINE * lengths[:-1] * lengths[1:]


def _straight(points: np.ndarray) -> Piece:
    """Any set of nodes as one piece, by its main direction."""
    places = np.arange(len(points))
    if len(points) < 2:
        return Piece(places, np.zeros(len(points)), 0.0, False, ())
    centred = points - points.mean(axis=0)
    along = centred @ np.linalg.svd(centred, full_matrices=False)[2][0]
    return Piece(places, along - along.min(), float(np.ptp(along)), False, ())


def _splines(pieces: list[Piece], n: int, modes: int, name: str) -> np.ndarray:
    """B-splines over all pieces, `modes` in total, more of them where the edge is longer  # (n, modes)"""
    ends = [_ends(piece) for piece in pieces]  # of the smooth parts of each piece
    parts = [len(e) - 1 for e in ends]
    joined = [piece.closed and bool(piece.corners) for piece in pieces]

    def count(degree: int, intervals: int) -> int:
        """Functions of all pieces with so many knot intervals in total."""
        periodic = sum(piece.closed and not piece.corners for piece in pieces)
        return intervals + (degree - 1) * sum(parts) + len(pieces) - sum(joined) - degree * periodic

    lowest = [degree for degree in range(MODE_DEGREE, -1, -1) if count(degree, sum(parts)) <= modes
              and (degree or modes == len(pieces))]
    if not lowest:
        raise InputError("too few modes for this edge", file="experiment.toml", key=name,
                         expected=f"{count(1, sum(parts))} modes or more for {_described(pieces)}", found=str(modes),
                         remedy="give more modes, or narrow the set to one side")
    degree = lowest[0]
    share = [[1] * p for p in parts]
    for _ in range(modes - count(degree, sum(parts))):
        widest = max(((e[k + 1] - e[k]) / s[k], -i, -k) for i, (e, s) in enumerate(zip(ends, share, strict=True))
                     for k in range(len(s)))
        share[-widest[1]][-widest[2]] += 1
    columns = []
    for piece, e, s in zip(pieces, ends, share, strict=True):
        block = _piece_splines(piece, e, s, degree)
        columns.append(np.zeros((n, block.shape[1])))
        columns[-1][piece.places] = block
    return np.hstack(columns)


def _ends(piece: Piece) -> list[float]:
    inner = [c for c in piece.corners if 0.0 < c < piece.length]
    return [0.0, *inner, piece.length]


def _piece_splines(piece: Piece, ends: list[float], share: list[int], degree: int) -> np.ndarray:
    """B-splines of one piece: knots even between corners, of full multiplicity at them  # (n_piece, n_functions)"""
    if degree == 0 or piece.length <= 0.0:  # a constant; a single node has no use for more
        return np.eye(1, sum(share) + degree).repeat(len(piece.places), axis=0)
    inner = np.concatenate([np.linspace(a, b, m + 1)[:-1] for a, b, m in zip(ends[:-1], ends[1:], share, strict=True)])
    along = np.clip(piece.along, 0.0, piece.length)
    if piece.closed and not piece.corners:
        return _periodic(along, piece.length, inner, degree)
    repeats = np.where(np.isin(inner, ends), degree, 1)
    knots = np.concatenate([[0.0], np.repeat(inner, repeats), np.full(degree + 1, piece.length)])
    splines = scipy.interpolate.BSpline.design_matrix(along, knots, degree).toarray()
    if piece.closed:  # the last function is the first one, seen from the other side of the corner
        splines[:, 0] += splines[:, -1]
        splines = splines[:, :-1]
    return splines


def _periodic(along: np.ndarray, length: float, inner: np.ndarray, degree: int) -> np.ndarray:
    """Periodic B-splines with knots `inner`  # (n, len(inner))"""
    m = len(inner)
    turns = np.arange(-degree - 1, degree + 2)
    knots = np.sort((inner[None, :] + length * turns[:, None]).ravel())
    first = np.searchsorted(knots, -1e-12 * length)
    knots = knots[first - degree:first + m + degree + 1]
    splines = scipy.interpolate.BSpline.design_matrix(along, knots, degree).toarray()  # (n, m + degree)
    wrapped = splines[:, :m].copy()
    for k in range(m, splines.shape[1]):
        wrapped[:, k % m] += splines[:, k]
    return wrapped


def _described(pieces: list[Piece]) -> str:
    corners = sum(len(piece.corners) for piece in pieces)
    closed = "closed " if any(piece.closed for piece in pieces) else ""
    text = f"a {closed}edge" if len(pieces) == 1 else f"{len(pieces)} separate edges"
    return f"{text} with {corners} corners" if corners else text
