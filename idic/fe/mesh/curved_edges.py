"""Boundary edges of quadratic elements on the arcs that the corners of a mesh follow: round holes, notches, fillets.

A mesh of linear elements gives a hole as a polygon. With middle nodes on the chords the hole stays one: of 22 edges and
a radius of 3 mm they lie 0.03 mm inside the circle, and the body is stiffer by that rim.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np

from idic.fe.mesh import element
from idic.fe.mesh.mesh import Mesh, PerMesh, boundary_edges
from idic.fe.mesh.morph import Hole, find_holes, fit_circle, jacobian_ratios, on_circle

MAX_TURN = np.radians(31.0)  # between neighbouring edges of an arc: twelve around a circle; an octagon stays one
MIN_TURN = 1e-4  # flatter arcs are straight lines
MAX_OFF_ARC = 0.25  # of the height of an arc over its chord: how far the corners that define an arc may lie off it
CORNERS_OF_AN_ARC = 5  # in a row, on one circle: four may belong to a chamfer of one element between straight edges
MIN_JACOBIAN = 0.25  # of its value with straight edges, at corners too: an element that keeps less keeps them

_CURVED = PerMesh()  # a diagnosis loads an experiment for every variant, on one mesh


def curved(mesh: Mesh) -> Mesh:
    """The mesh of quadratic elements with straight edges, its middle nodes put on the arcs of the boundary.

    In the plane any row of five corners of a boundary on one circle counts as an arc; of a solid, round holes along z.
    Elements that this would flatten keep straight edges. The same object where no edge is curved.
    """
    return _CURVED.once(mesh, (), lambda: _curved(mesh))


def _curved(mesh: Mesh) -> Mesh:
    if any(len(element.cell(block.cell).reference_nodes) == element.cell(block.cell).n_corners
           for block in mesh.blocks):
        raise ValueError("linear elements have no middle nodes")
    if mesh.n_dim == 2:
        nodes = mesh.nodes.copy()
        for middle, place in _on_arcs(mesh):
            nodes[middle] = place
    else:
        nodes = on_circle(mesh, _round_holes(mesh)).nodes
    moved = np.flatnonzero((nodes != mesh.nodes).any(axis=1))
    for block, flat in _flattened(mesh, nodes):
        kept = np.intersect1d(block.connectivity[flat], moved)
        nodes[kept] = mesh.nodes[kept]
    return replace(mesh, nodes=nodes) if (nodes != mesh.nodes).any() else mesh


def _on_arcs(mesh: Mesh) -> Iterator[tuple[int, np.ndarray]]:
    """Middle nodes of the boundary and their places on arcs."""
    for loop in boundary_edges(mesh):
        ends = np.array([mesh.face_nodes(edge)[:3] for edge in loop])  # corner, corner, middle, in walking order
        n = len(loop)
        if n < CORNERS_OF_AN_ARC:
            continue
        corners = mesh.nodes[ends[:, 0]]
        places: dict[int, list[np.ndarray]] = {}
        for first in range(n):
            edges = (first + np.arange(CORNERS_OF_AN_ARC - 1)) % n
            arc = _arc(corners[(first + np.arange(CORNERS_OF_AN_ARC)) % n])
            for edge in edges if arc is not None else ():
                middle = int(ends[edge, 2])
                offset = mesh.nodes[middle] - arc[0]
                places.setdefault(middle, []).append(arc[0] + offset * (arc[1] / np.hypot(*offset)))
        for middle, found in places.items():
            yield middle, np.mean(found, axis=0)


def _arc(corners: np.ndarray) -> tuple[np.ndarray, float] | None:
    """Centre and radius of the circle through corners in a row; None where they are no arc."""
    along = np.diff(corners, axis=0)
    before, after = along[:-1], along[1:]
    turn = np.arctan2(before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0], np.einsum("ni,ni->n", before, after))
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


def _round_holes(mesh: Mesh) -> Iterable[Hole]:
    """Holes along z whose corners lie on a circle."""
    for hole in find_holes(mesh):
        corners = np.intersect1d(hole.rim, np.concatenate(
            [block.connectivity[:, :element.cell(block.cell).n_corners].ravel() for block in mesh.blocks]))
        offset = mesh.nodes[corners, :2] - hole.centre
        around = np.unique(np.round(np.arctan2(offset[:, 1], offset[:, 0]), 6))
        turn = np.diff(np.append(around, around[0] + 2.0 * np.pi))
        off = np.abs(np.hypot(*offset.T) - hole.radius).max()
        if turn.max() <= MAX_TURN and off <= MAX_OFF_ARC * hole.radius * (1.0 - np.cos(0.5 * np.median(turn))):
            yield hole


def _flattened(mesh: Mesh, nodes: np.ndarray) -> Iterator[tuple]:
    """Blocks, and which of their elements keep too little of their Jacobian with other nodes  # (n_elements,) bool"""
    ratios, start = jacobian_ratios(mesh, nodes), 0
    for block in mesh.blocks:
        per_element = len(element.quadrature(block.cell)[0]) + element.cell(block.cell).n_corners
        n = block.n_elements * per_element
        yield block, ratios[start:start + n].reshape(-1, per_element).min(axis=1) < MIN_JACOBIAN
        start += n
