"""Inverse isoparametric mapping of plane cells, compiled, for the virtual camera only.

Own code on purpose: the correlator's pixel map must not check itself.
"""

from __future__ import annotations

import numba
import numpy as np

CODES = {"tri3": 0, "tri6": 1, "quad4": 2, "quad8": 3}
MAX_NODES = 8
MAX_NEWTON_STEPS = 12
MIN_SQUARED_STEP = 1e-12  # squared step of the local coordinates; quadratic convergence leaves about 1e-12 behind it
EDGE_TOLERANCE = 1e-9  # a sample on a shared edge belongs to the first of its elements


def locate(
    cell: str,
    plane: np.ndarray,
    conn: np.ndarray,
    boxes: np.ndarray,
    targets: np.ndarray,
    width: int,
    taken: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Element and local coordinates of every target point.

    Parameters
    ----------
    plane : (n_nodes, 2)
        Deformed nodes in the plane of the targets.
    conn : (nel, nn) int64
    boxes : (nel, 4) int64
        Range of the target grid to try for each element: column from, to, row from, to.
    targets : (n_rows * width, 2)
    taken : (n_targets,) bool
        Targets that already belong to another block.

    Returns
    -------
    element : (n_targets,) int64, -1 outside
    xi : (n_targets, 2)
    """
    element = np.full(len(targets), -1, dtype=np.int64)
    xi = np.zeros((len(targets), 2))
    plane = np.ascontiguousarray(plane, dtype=np.float64)
    _locate(CODES[cell], plane, conn, boxes, targets, width, np.ascontiguousarray(taken), element, xi)
    return element, xi


def carry(cell: str, fields: np.ndarray, conn: np.ndarray, xi: np.ndarray) -> np.ndarray:
    """Nodal fields (n_nodes, m) at points with local coordinates xi (n, 2) in elements conn (n, nn)  # (n, m)"""
    out = np.empty((len(xi), fields.shape[1]))
    _carry(CODES[cell], np.ascontiguousarray(fields, dtype=np.float64), conn, np.ascontiguousarray(xi), out)
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
def _invert(code, nn, x, y, tx, ty, a, b, N, Na, Nb):
    """Newton for x(a, b) = t from the start (a, b): local coordinates and whether it converged."""
    for _ in range(MAX_NEWTON_STEPS):
        shape_functions(code, a, b, N, Na, Nb)
        rx, ry, xa, xb, ya, yb = tx, ty, 0.0, 0.0, 0.0, 0.0
        for k in range(nn):
            rx -= N[k] * x[k]
            ry -= N[k] * y[k]
            xa += Na[k] * x[k]
            xb += Nb[k] * x[k]
            ya += Na[k] * y[k]
            yb += Nb[k] * y[k]
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
def _locate(code, plane, conn, boxes, targets, width, taken, element, xi):
    nn = conn.shape[1]
    x, y = np.empty(MAX_NODES), np.empty(MAX_NODES)
    N, Na, Nb = np.empty(MAX_NODES), np.empty(MAX_NODES), np.empty(MAX_NODES)
    a0 = 1.0 / 3.0 if code < 2 else 0.0
    for e in range(conn.shape[0]):
        if boxes[e, 0] >= boxes[e, 1] or boxes[e, 2] >= boxes[e, 3]:
            continue
        for k in range(nn):
            x[k], y[k] = plane[conn[e, k], 0], plane[conn[e, k], 1]
        for row in range(boxes[e, 2], boxes[e, 3]):
            a, b = a0, a0
            for column in range(boxes[e, 0], boxes[e, 1]):
                t = row * width + column
                if taken[t] or element[t] >= 0:
                    continue
                a, b, ok = _invert(code, nn, x, y, targets[t, 0], targets[t, 1], a, b, N, Na, Nb)
                if not ok:  # a start too far away on a curved element: once more from the centre
                    a, b, ok = _invert(code, nn, x, y, targets[t, 0], targets[t, 1], a0, a0, N, Na, Nb)
                if ok and _owns(code, a, b):
                    element[t] = e
                    xi[t, 0], xi[t, 1] = a, b
                elif not ok:
                    a, b = a0, a0


@numba.njit(cache=True, nogil=True)
def _carry(code, fields, conn, xi, out):
    N, Na, Nb = np.empty(MAX_NODES), np.empty(MAX_NODES), np.empty(MAX_NODES)
    for p in range(xi.shape[0]):
        shape_functions(code, xi[p, 0], xi[p, 1], N, Na, Nb)
        for m in range(fields.shape[1]):
            total = 0.0
            for k in range(conn.shape[1]):
                total += N[k] * fields[conn[p, k], m]
            out[p, m] = total
