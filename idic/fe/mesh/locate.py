"""Where points lie in a mesh of plane cells or bricks: the element that holds each, and the shape functions there."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import sparse

from idic.fe.mesh.element import cell_type
from idic.fe.mesh.mesh import Block

_NEWTON_STEPS = 12
_EDGE_TOLERANCE = 1e-6  # of the local coordinates: a point on an edge, or on the chord of a curved one, is inside


def interpolation(nodes: np.ndarray, blocks: Sequence[Block],
                  points: np.ndarray) -> tuple[sparse.csr_array, np.ndarray]:
    """Weights that carry nodal values to points.

    Parameters
    ----------
    nodes : (n_nodes, d)
    blocks : plane cells or bricks into them
    points : (n, d), in the unit of the nodes

    Returns
    -------
    weights : (n, n_nodes), rows of zeros outside
    inside : (n,) bool
    """
    points = np.asarray(points, dtype=float).reshape(-1, nodes.shape[1])
    inside = np.zeros(len(points), dtype=bool)
    rows, columns, values = [], [], []
    for block in blocks:
        numbers, conn, shapes = _in_block(nodes, block, points, np.flatnonzero(~inside))
        inside[numbers] = True
        rows.append(np.repeat(numbers, conn.shape[1]))
        columns.append(conn.ravel())
        values.append(shapes.ravel())
    weights = sparse.csr_array((np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))),
                               shape=(len(points), len(nodes)))
    return weights, inside


def _in_block(nodes: np.ndarray, block: Block, points: np.ndarray,
              candidates: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Numbers of the candidates that lie in a block, nodes of their elements, and shape functions there."""
    corners = nodes[block.connectivity]
    low, high = corners.min(axis=1), corners.max(axis=1)
    slack = 0.02 * (high - low).max()  # a curved edge bulges beyond its nodes
    numbers, elements, places = [], [], []
    for number in candidates:
        x = points[number]
        nearby_elements = np.flatnonzero(((x >= low - slack) & (x <= high + slack)).all(axis=1))
        if not len(nearby_elements):
            continue
        xi = _local(block.cell, corners[nearby_elements], x)
        excess = _outside(block.cell, xi)
        best = int(np.argmin(excess))
        if excess[best] <= _EDGE_TOLERANCE:
            numbers.append(number)
            elements.append(nearby_elements[best])
            places.append(xi[best])
    if not numbers:
        n = block.connectivity.shape[1]
        return np.zeros(0, dtype=int), np.zeros((0, n), dtype=int), np.zeros((0, n))
    return np.array(numbers), block.connectivity[elements], block.kind.shape_functions(np.array(places))


def _local(cell: str, corners: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Local coordinates of one point in each of some elements, by Newton's method  # (n, nn, d) -> (n, d)"""
    n_corners = cell_type(cell).n_corners
    xi = np.tile(cell_type(cell).reference_nodes[:n_corners].mean(axis=0), (len(corners), 1))
    for _ in range(_NEWTON_STEPS):
        shapes, slopes = cell_type(cell).shape_functions(xi), cell_type(cell).shape_gradients(xi)
        gap = x - np.einsum("ea,eak->ek", shapes, corners)
        jacobian = np.einsum("eak,eai->eki", corners, slopes)
        step = np.linalg.solve(jacobian, gap[:, :, None])[:, :, 0]
        xi = np.clip(xi + step, -3.0, 3.0)  # far outside an element its map folds back
        if np.abs(step).max() < 1e-12:
            break
    shapes = cell_type(cell).shape_functions(xi)
    distance = np.linalg.norm(x - np.einsum("ea,eak->ek", shapes, corners), axis=1)
    size = np.ptp(corners, axis=1).max(axis=1)
    return np.where((distance < 1e-6 * size)[:, None], xi, np.inf)


def _outside(cell: str, xi: np.ndarray) -> np.ndarray:
    """How far local coordinates lie beyond the element, negative inside  # (n,)"""
    if cell.startswith("tri"):
        return np.maximum(np.maximum(-xi[:, 0], -xi[:, 1]), xi.sum(axis=1) - 1.0)
    return np.abs(xi).max(axis=1) - 1.0
