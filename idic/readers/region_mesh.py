"""Meshes a rectangle of the image with quadrilaterals; at round holes also triangles, with nodes on the circle."""

from __future__ import annotations

import numpy as np

from idic.errors import InputError
from idic.fe import Block, Mesh, make_mesh

MAX_ELEMENTS = 500_000  # of a mesh that idic makes, in half a minute: 3 million equations, ten times what was measured
_MIN_ELEMENT_SIZE_KEPT = 0.25  # relative to the original size, after a node moves onto a hole


def roi_mesh(roi, element_size: float, holes=(), *, down: bool, file=None, key="experiment.mesh") -> Mesh:
    """A quad4 mesh of the rectangle `roi`, with tri3 where the staircase along a hole is cut.

    Node sets and edge sets: LEFT, RIGHT (smallest, largest x), TOP, BOTTOM (as seen: `down` says that y counts
    downwards), OUTER (the four together), HOLE1, HOLE2, ...; one element set ALL.

    Parameters
    ----------
    roi : (x0, y0, x1, y1)
        Corners, px or mm.
    element_size : float
        Target edge length; the rectangle is divided evenly.
    holes : sequence of (x, y, radius)

    Raises
    ------
    InputError
        The corners are in the wrong order, the element size does not fit, or the holes cover the ROI.
    """
    x0, y0, x1, y1 = (float(value) for value in roi)
    if not (x0 < x1 and y0 < y1):
        raise InputError("the corners of the ROI are in the wrong order", file=file, key=key,
                         expected="[x0, y0, x1, y1] with x0 < x1, y0 < y1",
                         found=str(list(roi)), remedy="exchange the corners")
    nx, ny = (max(int(round(length / element_size)), 1) for length in (x1 - x0, y1 - y0))
    if element_size > min(x1 - x0, y1 - y0) or nx * ny > MAX_ELEMENTS:
        raise InputError("the element size does not suit the ROI", file=file, key=key,
                         expected=f"less than {min(x1 - x0, y1 - y0):g}, "
                         f"not more than {MAX_ELEMENTS:g} elements",
                         found=f"{element_size:g}: {(x1 - x0) * (y1 - y0) / element_size**2:.2g} elements",
                         remedy="choose another element size")
    x, y = np.linspace(x0, x1, nx + 1), np.linspace(y0, y1, ny + 1)
    nodes = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)  # row after row
    corner = (np.arange(ny)[:, None] * (nx + 1) + np.arange(nx)[None, :]).ravel()
    quads = np.stack([corner, corner + 1, corner + nx + 2, corner + nx + 1], axis=1)
    centre = nodes[quads].mean(axis=1)
    keep = np.ones(len(quads), dtype=bool)
    away = [np.hypot(*(centre - (cx, cy)).T) for cx, cy, _ in holes]
    for (_, _, radius), distance in zip(holes, away, strict=True):
        keep &= distance >= radius
    for hole, distance in zip(holes, away, strict=True):
        if distance.min() >= hole[2]:
            raise _no_hole(hole, float(distance.min()), (x0, y0, x1, y1), element_size, file, key)
    if not keep.any():
        raise InputError("the holes cover the whole ROI", file=file, key=key, expected="holes inside the ROI",
                         found=str([list(h) for h in holes]),
                         remedy="correct the holes: [column, row, radius]")
    quads, triangles = _cut_corners(nodes, quads[keep], (x0, y0, x1, y1))
    used = np.unique(np.concatenate([quads.ravel(), triangles.ravel()]))
    cells = [(name, np.searchsorted(used, cells)) for name, cells in (("quad4", quads), ("tri3", triangles))
             if len(cells)]
    mesh = make_mesh(nodes[used], cells)
    mesh = make_mesh(_follow_holes(mesh, holes, (x0, y0, x1, y1), max((x1 - x0) / nx, (y1 - y0) / ny)), cells)
    return _with_sets(mesh, (x0, y0, x1, y1), holes, element_size, down)


def _no_hole(hole, nearest: float, roi, element_size: float, file, key) -> InputError:
    """A hole that holds the middle of no element would leave the mesh whole.

    nearest : distance from its centre to the nearest middle
    """
    (cx, cy, radius), (x0, y0, x1, y1) = hole, roi
    if max(x0 - cx, cx - x1, y0 - cy, cy - y1) > 0.0:
        return InputError("a hole outside the ROI", file=file, key=key, expected=f"a centre within {list(roi)}",
                          found=str(list(hole)), remedy="correct the hole: [column, row, radius]")
    return InputError("a hole is smaller than an element: the mesh would not have it", file=file, key=key,
                      expected=f"a radius above {nearest:.3g}, or elements of {radius:.2g} or less",
                      found=f"radius {radius:g}, elements of {element_size:g}",
                      remedy="choose smaller elements, or draw the outline (outline_mm, outline_px), "
                             "which has small elements at small holes; or leave the hole out")


def _cut_corners(nodes: np.ndarray, quads: np.ndarray, roi) -> tuple[np.ndarray, np.ndarray]:
    """Replace quads with an exposed corner at a hole by triangles: the staircase becomes a slope.

    Returns
    -------
    quads (n, 4), triangles (m, 3)
    """
    while True:
        exposed = _exposed_edges(nodes, quads, roi)  # (n, 4) bool
        if not (exposed.sum(axis=1) > 2).any():
            break
        quads = quads[exposed.sum(axis=1) <= 2]
    corner = exposed & np.roll(exposed, 1, axis=1)  # corner k lies between the edges k - 1 and k
    cut = corner.any(axis=1)
    first = np.argmax(corner, axis=1)[cut]
    triangles = quads[cut][np.arange(cut.sum())[:, None], (first[:, None] + (1, 2, 3)) % 4]
    return quads[~cut], triangles


def _exposed_edges(nodes: np.ndarray, quads: np.ndarray, roi) -> np.ndarray:
    """True for the quad edges that belong to one element and do not lie on the rectangle  # (n, 4) bool"""
    ends = np.stack([quads, np.roll(quads, -1, axis=1)], axis=2)  # (n, 4, 2)
    _, index, count = np.unique(np.sort(ends.reshape(-1, 2), axis=1), axis=0, return_inverse=True, return_counts=True)
    middle = nodes[ends].mean(axis=2)
    return (count[index.ravel()] == 1).reshape(quads.shape) & ~_on_rectangle(middle, roi)


def _on_rectangle(points: np.ndarray, roi) -> np.ndarray:
    tolerance = 1e-9 * max(roi[2] - roi[0], roi[3] - roi[1])  # rounding of coordinates
    x, y = points[..., 0], points[..., 1]
    return ((np.abs(x - roi[0]) < tolerance) | (np.abs(x - roi[2]) < tolerance)
            | (np.abs(y - roi[1]) < tolerance) | (np.abs(y - roi[3]) < tolerance))


def _follow_holes(mesh: Mesh, holes, roi, size: float) -> np.ndarray:
    """The nodes with those of the hole edges on the circles, except where an element would degenerate."""
    nodes, moved = mesh.nodes, mesh.nodes.copy()
    candidates = np.unique(np.concatenate([mesh.face_set_nodes(loop) for loop in mesh.boundary_edges()]))
    candidates = candidates[~_on_rectangle(nodes[candidates], roi)]
    for cx, cy, radius in holes:
        offset = nodes[candidates] - (cx, cy)
        distance = np.hypot(*offset.T)
        near_rim = (np.abs(distance - radius) < 1.5 * size) & (distance
                                                               > 0)  # distance of the corners of removed elements
        moved[candidates[near_rim]] = (cx, cy) + offset[near_rim] * (radius / distance[near_rim])[:, None]
    for _ in range(10):
        back = [b.connectivity[_smallest_jacobian(moved, b)
                               < _MIN_ELEMENT_SIZE_KEPT * _smallest_jacobian(nodes, b)].ravel() for b in mesh.blocks]
        back = np.unique(np.concatenate(back))
        if len(back) == 0:
            break
        moved[back] = nodes[back]
    return moved


def _smallest_jacobian(nodes: np.ndarray, block: Block) -> np.ndarray:
    gradients = block.kind.shape_gradients(block.kind.reference_nodes)
    return np.linalg.det(np.einsum("eai,qaj->eqij", nodes[block.connectivity], gradients)).min(axis=1)


def _with_sets(mesh: Mesh, roi, holes, size: float, down: bool) -> Mesh:
    faces = np.concatenate(mesh.boundary_edges())
    ends = np.array([mesh.nodes[mesh.face_nodes(face)] for face in faces])  # (n, 2, 2)
    tolerance = 1e-9 * max(roi[2] - roi[0], roi[3] - roi[1])
    sides = {"LEFT": (0, roi[0]), "RIGHT": (0, roi[2]), "TOP": (1, roi[1] if down else roi[3]),
             "BOTTOM": (1, roi[3] if down else roi[1])}
    on = {name: (np.abs(ends[:, :, axis] - value) < tolerance).all(axis=1) for name, (axis, value) in sides.items()}
    on["OUTER"] = np.logical_or.reduce(list(on.values()))
    middle = ends.mean(axis=1)
    for number, (cx, cy, radius) in enumerate(holes, 1):
        on[f"HOLE{number}"] = ~on["OUTER"] & (np.abs(np.hypot(*(middle - (cx, cy)).T) - radius) < 1.5 * size)
    edge_sets = {name: faces[inside] for name, inside in on.items() if inside.any()}
    node_sets = {name: mesh.face_set_nodes(inside) for name, inside in edge_sets.items()}
    return Mesh(mesh.nodes, mesh.blocks, node_sets, {"ALL": np.arange(mesh.n_elements)}, edge_sets, mesh.node_labels,
                mesh.element_labels)
