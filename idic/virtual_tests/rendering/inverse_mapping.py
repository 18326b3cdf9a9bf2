"""Inverse isoparametric mapping of plane cells, compiled, for the virtual camera only.

It is separate from the pixel map of the correlation, so that a virtual test checks that map.
"""

from __future__ import annotations

import numba
import numpy as np

CODES = {"tri3": 0, "tri6": 1, "quad4": 2, "quad8": 3}
OUTLINES = {  # nodes around a cell
    "tri3": (0, 1, 2), "tri6": (0, 3, 1, 4, 2, 5), "quad4": (0, 1, 2, 3), "quad8": (0, 4, 1, 5, 2, 6, 3, 7)}
PLACES = {  # local coordinates of the nodes
    "tri3": ((0, 0), (1, 0), (0, 1)),
    "tri6": ((0, 0), (1, 0), (0, 1), (0.5, 0), (0.5, 0.5), (0, 0.5)),
    "quad4": ((-1, -1), (1, -1), (1, 1), (-1, 1)),
    "quad8": ((-1, -1), (1, -1), (1, 1), (-1, 1), (0, -1), (1, 0), (0, 1), (-1, 0))}
POWERS = ((0, 0), (1, 0), (0, 1), (1, 1), (2, 0), (0, 2), (2, 1), (1, 2))  # of a and b, of which all mappings are sums
SUMS = {"tri3": (0, 1, 2), "tri6": (0, 1, 2, 3, 4, 5), "quad4": (0, 1, 2, 3), "quad8": tuple(range(8))}
MAX_NODES = 8
MAX_NEWTON_STEPS = 12
MIN_SQUARED_STEP = 1e-12  # squared step of the local coordinates; quadratic convergence leaves about 1e-12 behind it
REACH_MARGIN = 0.03  # of the extent of an element
EDGE_TOLERANCE = 1e-9  # a sample on a shared edge belongs to the first of its elements


def locate(
    cell: str,
    plane: np.ndarray,
    conn: np.ndarray,
    boxes: np.ndarray,
    outlines: np.ndarray,
    targets: np.ndarray,
    width: int,
    occupied: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Element and local coordinates of every target point.

    Parameters
    ----------
    plane : (n_nodes, 2)
        Deformed nodes in the plane of the targets.
    conn : (nel, nn) int64
    boxes : (nel, 4) int64
        Range of the target grid to try for each element: column from, to, row from, to.
    outlines : (nel, nn, 2)
        Nodes on the target grid (column, row): nothing that is clearly outside of their polygon is tried.
    targets : (n_rows * width, 2)
    occupied : (n_targets,) bool
        Targets that already belong to another block.

    Returns
    -------
    element : (n_targets,) int64, -1 outside
    xi : (n_targets, 2)
    """
    element = np.full(len(targets), -1, dtype=np.int64)
    xi = np.zeros((len(targets), 2))
    around = np.ascontiguousarray(outlines[:, list(OUTLINES[cell])])
    _locate(CODES[cell], _polynomials(cell, plane[conn]), boxes, around, _reach(cell, outlines), targets, width,
            np.ascontiguousarray(occupied), element, xi)
    return element, xi


def _polynomials(cell: str, corners: np.ndarray) -> np.ndarray:
    """Mappings of elements with these nodes (nel, nn, 2) as sums of `POWERS`  # (nel, 8, 2)"""
    a, b = np.array(PLACES[cell], dtype=float).T
    values = np.stack([a**p * b**q for p, q in (POWERS[k] for k in SUMS[cell])], axis=1)  # (nn, nn)
    out = np.zeros((len(corners), len(POWERS), 2))
    out[:, :len(SUMS[cell])] = np.linalg.inv(values) @ corners
    return out


def _reach(cell: str, outlines: np.ndarray) -> np.ndarray:
    """How far beyond the polygon of its nodes an element may lie, with room to spare  # (nel,)

    An edge of three nodes leaves their polygon by a quarter of its bend; the rest is for lenses.
    """
    extent = (outlines.max(axis=1) - outlines.min(axis=1)).max(axis=1)
    bend = np.zeros(len(outlines))
    if CODES[cell] % 2:  # mid-side nodes
        n = len(OUTLINES[cell]) // 2
        middles = 0.5 * (outlines[:, :n] + np.roll(outlines[:, :n], -1, axis=1))
        bend = np.sqrt(((outlines[:, n:] - middles) ** 2).sum(axis=2)).max(axis=1)
    return 1.0 + 0.5 * bend + REACH_MARGIN * extent


def carry(cell: str, fields: np.ndarray, conn: np.ndarray, element: np.ndarray, xi: np.ndarray) -> np.ndarray:
    """Nodal fields (n_nodes, m) at local coordinates xi (n, 2) of elements (n,) of conn (nel, nn)  # (n, m)"""
    out = np.empty((len(xi), fields.shape[1]))
    _carry(CODES[cell], np.ascontiguousarray(fields, dtype=np.float64), conn, element, np.ascontiguousarray(xi), out)
    return out


@numba.njit(cache=True, nogil=True)
def shape_functions(code, a, b, N, Na, Nb):
    """Shape functions and their derivatives (Abaqus/VTK node order: corners, then mid-sides counter-clockwise)."""
    if code == 0:
        N[0], N[1], N[2] = 1.0 - a - b, a, b
        Na[0], Na[1], Na[2] = -1.0, 1.0, 0.0
        Nb[0], Nb[1], Nb[2] = -1.0, 0.0, 1.0
    elif code == 1:
        c = 1.0 - a - b
        N[0], N[1], N[2] = c * (2 * c - 1), a * (2 * a - 1), b * (2 * b - 1)
        N[3], N[4], N[5] = 4 * c * a, 4 * a * b, 4 * b * c
        Na[0], Na[1], Na[2] = 1 - 4 * c, 4 * a - 1, 0.0
        Nb[0], Nb[1], Nb[2] = 1 - 4 * c, 0.0, 4 * b - 1
        Na[3], Na[4], Na[5] = 4 * (c - a), 4 * b, -4 * b
        Nb[3], Nb[4], Nb[5] = -4 * a, 4 * a, 4 * (c - b)
    else:
        for k in range(4):
            sa = 1.0 if k == 1 or k == 2 else -1.0
            sb = 1.0 if k >= 2 else -1.0
            p, q = 1.0 + sa * a, 1.0 + sb * b
            if code == 2:
                N[k], Na[k], Nb[k] = 0.25 * p * q, 0.25 * sa * q, 0.25 * sb * p
            else:
                e = sa * a + sb * b - 1.0
                N[k] = 0.25 * p * q * e
                Na[k] = 0.25 * sa * q * (e + p)
                Nb[k] = 0.25 * sb * p * (e + q)
        if code == 3:
            for k in range(2):  # mid-sides at b = -1 (node 4) and b = +1 (node 6); at a = +1 (5) and a = -1 (7)
                s = 2.0 * k - 1.0
                N[4 + 2 * k] = 0.5 * (1 - a * a) * (1 + s * b)
                Na[4 + 2 * k] = -a * (1 + s * b)
                Nb[4 + 2 * k] = 0.5 * (1 - a * a) * s
                N[5 + 2 * k] = 0.5 * (1 - b * b) * (1 - s * a)
                Na[5 + 2 * k] = -0.5 * (1 - b * b) * s
                Nb[5 + 2 * k] = -b * (1 - s * a)


@numba.njit(cache=True, nogil=True)
def _invert(c, tx, ty, a, b):
    """Newton for c(a, b) = t from the start (a, b): local coordinates and whether it converged.

    c (8, 2) : factors of `POWERS`
    """
    for _ in range(MAX_NEWTON_STEPS):
        rx = tx - (c[0, 0] + a * (c[1, 0] + a * c[4, 0]) + b * (c[2, 0] + b * c[5, 0])
                   + a * b * (c[3, 0] + a * c[6, 0] + b * c[7, 0]))
        ry = ty - (c[0, 1] + a * (c[1, 1] + a * c[4, 1]) + b * (c[2, 1] + b * c[5, 1])
                   + a * b * (c[3, 1] + a * c[6, 1] + b * c[7, 1]))
        xa = c[1, 0] + 2.0 * a * c[4, 0] + b * (c[3, 0] + 2.0 * a * c[6, 0] + b * c[7, 0])
        ya = c[1, 1] + 2.0 * a * c[4, 1] + b * (c[3, 1] + 2.0 * a * c[6, 1] + b * c[7, 1])
        xb = c[2, 0] + 2.0 * b * c[5, 0] + a * (c[3, 0] + a * c[6, 0] + 2.0 * b * c[7, 0])
        yb = c[2, 1] + 2.0 * b * c[5, 1] + a * (c[3, 1] + a * c[6, 1] + 2.0 * b * c[7, 1])
        det = xa * yb - xb * ya
        if det == 0.0:
            return a, b, False
        da = (yb * rx - xb * ry) / det
        db = (xa * ry - ya * rx) / det
        a += da
        b += db
        if not abs(a) + abs(b) < 20.0:
            return a, b, False
        if da * da + db * db < MIN_SQUARED_STEP:
            return a, b, True
    return a, b, False


@numba.njit(cache=True, nogil=True)
def _owns(code, a, b):
    if code < 2:
        return a >= -EDGE_TOLERANCE and b >= -EDGE_TOLERANCE and a + b <= 1.0 + EDGE_TOLERANCE
    return abs(a) <= 1.0 + EDGE_TOLERANCE and abs(b) <= 1.0 + EDGE_TOLERANCE


@numba.njit(cache=True, nogil=True)
def _span(around, reach, row):
    """Columns between which the polygon, widened by `reach`, meets a row."""
    low, high = np.inf, -np.inf
    x0, y0 = around[-1, 0], around[-1, 1]
    for k in range(around.shape[0]):
        x1, y1 = around[k, 0], around[k, 1]
        if min(y0, y1) <= row + reach and max(y0, y1) >= row - reach:
            slope = (x1 - x0) / (y1 - y0) if y1 != y0 else 0.0
            for y, x in ((y0, x0), (y1, x1)):
                if y > row + reach:
                    x += slope * (row + reach - y)
                elif y < row - reach:
                    x += slope * (row - reach - y)
                low, high = min(low, x), max(high, x)
        x0, y0 = x1, y1
    return low - reach, high + reach


@numba.njit(cache=True, nogil=True)
def _locate(code, mappings, boxes, around, reach, targets, width, occupied, element, xi):
    a0 = 1.0 / 3.0 if code < 2 else 0.0
    for e in range(mappings.shape[0]):
        if boxes[e, 0] >= boxes[e, 1] or boxes[e, 2] >= boxes[e, 3]:
            continue
        c = mappings[e]
        for row in range(boxes[e, 2], boxes[e, 3]):
            low, high = _span(around[e], reach[e], row)
            if not low <= high:
                continue
            a, b = a0, a0
            for column in range(max(boxes[e, 0], int(np.floor(low))), min(boxes[e, 1], int(np.ceil(high)) + 1)):
                t = row * width + column
                if occupied[t] or element[t] >= 0:
                    continue
                a, b, ok = _invert(c, targets[t, 0], targets[t, 1], a, b)
                if not ok:  # a start too far away on a curved element: once more from the centre
                    a, b, ok = _invert(c, targets[t, 0], targets[t, 1], a0, a0)
                if ok and _owns(code, a, b):
                    element[t] = e
                    xi[t, 0], xi[t, 1] = a, b
                elif not ok:
                    a, b = a0, a0


@numba.njit(cache=True, nogil=True)
def _carry(code, fields, conn, element, xi, out):
    N, Na, Nb = np.empty(MAX_NODES), np.empty(MAX_NODES), np.empty(MAX_NODES)
    for p in range(xi.shape[0]):
        shape_functions(code, xi[p, 0], xi[p, 1], N, Na, Nb)
        for m in range(fields.shape[1]):
            total = 0.0
            for k in range(conn.shape[1]):
                total += N[k] * fields[conn[element[p], k], m]
            out[p, m] = total
