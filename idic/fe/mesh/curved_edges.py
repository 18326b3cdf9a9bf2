"""Boundary edges of quadratic elements on the arcs that the corners of a mesh follow: round holes, notches, fillets.

A mesh of linear elements gives a hole as a polygon. With middle nodes on the chords the hole stays one: of 22 edges and
a radius of 3 mm they lie 0.03 mm inside the circle, and the body is stiffer by that rim.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from idic.fe.mesh.mesh import Mesh, PerMesh, make_mesh
from idic.fe.mesh.morph import fit_circle, nearest_on_circle, walls_about_a_centre

MAX_TURN = np.radians(31.0)  # between neighbouring edges of an arc: twelve around a circle; an octagon stays one
MIN_TURN = 1e-4  # flatter arcs are straight lines
MAX_OFF_ARC = 0.25  # of the height of an arc over its chord: how far the corners that define an arc may lie off it
CORNERS_OF_AN_ARC = 5  # in a row, on one circle: four may belong to a chamfer of one element between straight edges
MIN_JACOBIAN = 0.25  # of its value with straight edges, at nodes too: an element that keeps less keeps them
MIN_SHIFT = 1e-9  # of the size of the body: a smaller one is rounding
THIN_HEIGHTS = 20.0  # of an arc over its chord, between two arcs: a layer whose thickness a polygon changes by a tenth

_CURVED = PerMesh()  # a diagnosis loads an experiment for every variant, on one mesh


def curved(mesh: Mesh) -> Mesh:
    """The mesh of quadratic elements with straight edges, its middle nodes put on the arcs of the boundary.

    In the plane any row of five corners of a boundary on one circle counts as an arc; of a solid, round walls along z.
    Boundaries are those of the body and those of its element sets, so that a thin layer between two of them keeps its
    thickness. Elements that this would flatten keep straight edges. The same object where no edge is curved.
    """
    curved_mesh = _CURVED.once(mesh, (), lambda: _curved(mesh))
    return mesh if curved_mesh is None else curved_mesh


def _curved(mesh: Mesh) -> Mesh | None:
    if any(len(block.kind.reference_nodes) == block.kind.n_corners
           for block in mesh.blocks):
        raise ValueError("linear elements have no middle nodes")
    arcs = _arcs_in_plane(mesh) if mesh.n_dim == 2 else list(_round_walls(mesh))
    nodes = mesh.nodes.copy()
    for arc in arcs:
        nodes[arc.middles] = arc.places
    while len(flat := _flattened(mesh, nodes)):
        straight = _straightened_middles(mesh, nodes, arcs, flat)
        nodes[straight] = mesh.nodes[straight]
    return replace(mesh, nodes=nodes) if (nodes != mesh.nodes).any() else None


@dataclass(frozen=True, eq=False)
class _Arc:
    """Middle nodes that hang together (n,), their places (n, dim) mm, and the largest height of an arc over its chord,
    mm."""

    middles: np.ndarray
    places: np.ndarray
    height: float


def _parts(mesh: Mesh) -> Iterator[Mesh]:
    """The body, and every element set of it, on the same nodes."""
    yield mesh
    for elements in mesh.element_sets.values():
        if 0 < len(elements) < mesh.n_elements:
            yield make_mesh(mesh.nodes,
                            [(block.cell, block.connectivity[block_elements - block.first]) for block in mesh.blocks
                                         if len(block_elements := elements[(elements >= block.first) & (
                                             elements < block.first + block.n_elements)])])


def _arcs_in_plane(mesh: Mesh) -> list[_Arc]:
    places: dict[int, list[np.ndarray]] = {}
    ends: dict[int, np.ndarray] = {}
    for part in _parts(mesh):
        for loop in part.boundary_edges():
            edges = np.array([part.face_nodes(edge)[:3] for edge in loop])  # corner, corner, middle, in walking order
            ends |= {int(middle): edges[k, :2] for k, middle in enumerate(edges[:, 2])}
            for middle, place in _on_arcs(mesh.nodes, edges):
                places.setdefault(middle, []).append(place)
    if not places:
        return []
    middles = np.array(sorted(places))
    at = np.array([np.mean(places[middle], axis=0) for middle in middles])
    shift = np.hypot(*(at - mesh.nodes[middles]).T)
    middles, at, shift = (array[shift > MIN_SHIFT * np.ptp(mesh.nodes, axis=0).max()] for array in (middles, at, shift))
    label = _hanging_together(np.array([ends[middle] for middle in middles]).reshape(-1, 2), mesh.n_nodes)
    return [_Arc(middles[label == k], at[label == k], float(shift[label == k].max())) for k in np.unique(label)]


def _hanging_together(edges: np.ndarray, n_nodes: int) -> np.ndarray:
    """Label of every edge (n, 2): edges that share a corner have the same one  # (n,)"""
    graph = sparse.coo_array((np.ones(len(edges)), edges.T), shape=(n_nodes, n_nodes))
    return connected_components(graph, directed=False)[1][edges[:, 0]]


def _on_arcs(nodes: np.ndarray, edges: np.ndarray) -> Iterator[tuple[int, np.ndarray]]:
    """Middle nodes of a closed loop of edges (n, 3) and their places on arcs."""
    n = len(edges)
    for first in range(n if n >= CORNERS_OF_AN_ARC else 0):
        run = (first + np.arange(CORNERS_OF_AN_ARC)) % n
        arc = _arc(nodes[edges[run, 0]])
        for edge in run[:-1] if arc is not None else ():
            middle = int(edges[edge, 2])
            yield middle, nearest_on_circle(nodes[middle], *arc)


def _arc(corners: np.ndarray) -> tuple[np.ndarray, float] | None:
    """Centre and radius of the circle through corners in a row; None where they are no arc."""
    along = np.diff(corners, axis=0)
    incoming, outgoing = along[:-1], along[1:]
    turn = np.arctan2(incoming[:, 0] * outgoing[:, 1] - incoming[:, 1] * outgoing[:, 0],
                      np.einsum("ni,ni->n", incoming, outgoing))
    size = np.abs(turn)
    if not ((turn > 0).all() or (turn < 0).all()) or size.min() < MIN_TURN or size.max() > MAX_TURN:
        return None
    centre, radius = fit_circle(corners)
    off = np.abs(np.hypot(*(corners - centre).T) - radius).max()
    shortest = np.hypot(*along.T).min()
    return (centre, radius) if off <= MAX_OFF_ARC * _height(shortest, radius) else None


def _height(chord: float, radius: float) -> float:
    """Of an arc over its chord."""
    return radius - float(np.sqrt(max(radius**2 - 0.25 * chord**2, 0.0)))


def _round_walls(mesh: Mesh) -> Iterator[_Arc]:
    """Holes and outsides along z whose corners lie on a circle."""
    is_open = np.ones(mesh.n_nodes, dtype=bool)  # a middle node that no wall has taken
    for block in mesh.blocks:
        is_open[block.connectivity[:, :block.kind.n_corners]] = False
    for part in _parts(mesh):
        for wall in walls_about_a_centre(part):
            height = wall.hole.radius * float(1.0 - np.cos(0.5 * np.median(wall.turns)))
            middles = wall.hole.rim[is_open[wall.hole.rim]]
            if wall.turns.max() > MAX_TURN or wall.off > MAX_OFF_ARC * height or not len(middles):
                continue
            is_open[middles] = False
            places = mesh.nodes[middles].copy()
            places[:, :2] = nearest_on_circle(places[:, :2], wall.hole.centre, wall.hole.radius)
            shift = np.hypot(*(places - mesh.nodes[middles])[:, :2].T)
            moves = shift > MIN_SHIFT * np.ptp(mesh.nodes, axis=0).max()  # others stand in the corners' lines along z
            yield _Arc(middles[moves], places[moves], height)


def _flattened(mesh: Mesh, nodes: np.ndarray) -> np.ndarray:
    """Nodes of elements that keep too little of their Jacobian with other nodes."""
    flat = [block.connectivity[block.jacobian_ratios(mesh.nodes, nodes, len(
              block.kind.reference_nodes)).min(axis=1) < MIN_JACOBIAN].ravel() for block in mesh.blocks]
    return np.unique(np.concatenate(flat))


def _straightened_middles(mesh: Mesh, nodes: np.ndarray, arcs: Sequence[_Arc], flat: np.ndarray) -> np.ndarray:
    """Middle nodes that go back to their chords for the sake of flattened elements.

    Those of the elements alone; beside another arc, as near as thin layers have it, that arc and its own as a whole:
    with one side of a thin layer round and the other one not, it would be wrong by more than with two polygons.
    """
    from scipy.spatial import cKDTree  # here: no identification of a sound mesh loads it

    curved_arcs = [arc for arc in arcs if (nodes[arc.middles] != mesh.nodes[arc.middles]).any()]
    flattening_arcs = [arc for arc in curved_arcs if np.isin(arc.middles, flat).any()]
    straight = [flat]
    for arc in flattening_arcs:
        tree = cKDTree(mesh.nodes[arc.middles])
        neighbours = [other_arc for other_arc in curved_arcs
                      if other_arc is not arc and tree.query(mesh.nodes[other_arc.middles])[0].min()
                      < THIN_HEIGHTS * max(arc.height, other_arc.height)]
        straight += [straight_arc.middles for straight_arc in (arc, *neighbours)] if neighbours else []
    return np.unique(np.concatenate(straight))
