"""Shape functions of the visible cells in one monomial basis, so that one pixel kernel serves all of them.

    N_i(a, b) = sum_k T[k, i] m_k(a, b),    m = (1, a, b, ab, a^2, b^2, a^2 b, a b^2)

(docs/method.md, equation 3.6) with the first 3 monomials for tri3, 4 for quad4, 6 for tri6 and 8 for quad8. (a, b) are
the cell's own coordinates: 0..1 with a + b <= 1 for triangles, -1..1 for quadrilaterals; corners counter-clockwise,
mid-side nodes last.
"""

from __future__ import annotations

import numpy as np
from numba import njit

N_MONOMIALS = 8
CELLS = ("tri3", "quad4", "tri6", "quad8")
N_NODES = np.array([3, 4, 6, 8])
_TRIANGLE = [(0, 0), (1, 0), (0, 1), (0.5, 0), (0.5, 0.5), (0, 0.5)]
_SQUARE = [(-1, -1), (1, -1), (1, 1), (-1, 1), (0, -1), (1, 0), (0, 1), (-1, 0)]
NODE_POINTS = tuple(np.array(points, dtype=float) for points in (_TRIANGLE[:3], _SQUARE[:4], _TRIANGLE, _SQUARE))
# corners of each edge, by number of corners; the edge's mid-side node is number n_corners + edge
EDGES = {3: ((0, 1), (1, 2), (2, 0)), 4: ((0, 1), (1, 2), (2, 3), (3, 0))}


def monomials(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The eight monomials  # a, b (...,) -> (..., 8)"""
    return np.stack([np.ones_like(a), a, b, a * b, a * a, b * b, a * a * b, a * b * b], axis=-1)


def monomial_slopes(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Their derivatives by a and b  # a, b (...,) -> (..., 8, 2)"""
    zeros, ones = np.zeros_like(a), np.ones_like(a)
    by_a = np.stack([zeros, ones, zeros, b, 2 * a, zeros, 2 * a * b, b * b], axis=-1)
    by_b = np.stack([zeros, zeros, ones, a, zeros, 2 * b, a * a, 2 * a * b], axis=-1)
    return np.stack([by_a, by_b], axis=-1)


def _transforms():
    table = np.zeros((len(CELLS), N_MONOMIALS, N_MONOMIALS))
    for kind, points in enumerate(NODE_POINTS):
        n = len(points)
        table[kind, :n, :n] = np.linalg.inv(monomials(points[:, 0], points[:, 1])[:, :n])
    return table


TRANSFORMS = _transforms()  # (4 kinds, 8 monomials, 8 nodes), zero beyond the cell's own


@njit(cache=True, nogil=True)
def to_monomials(values, conn, kind, transforms, n_nodes, out):
    """Monomial coefficients of a nodal field in every element.

    values (n_nodes, n_comp), conn (n_elements, 8), kind (n_elements,), out (n_elements, n_comp, 8).
    """
    for e in range(conn.shape[0]):
        n = n_nodes[kind[e]]
        t = transforms[kind[e]]
        for c in range(values.shape[1]):
            for k in range(8):
                total = 0.0
                if k < n:
                    for i in range(n):
                        total += t[k, i] * values[conn[e, i], c]
                out[e, c, k] = total


# for the pixel map: the cell of each pixel, and the place of the pixel in it ------------------
@njit(cache=True, nogil=True)
def find_owners(geometry, triangle, boxes, mask, column0, row0, tolerance):
    """Owner and (a, b) of every pixel of the window: Newton on x(a, b), started from the pixel before."""
    ny, nx = mask.shape
    owner = np.full((ny, nx), -1, dtype=np.int64)
    excess = np.full((ny, nx), tolerance)
    a, b = np.zeros((ny, nx)), np.zeros((ny, nx))
    for e in range(geometry.shape[0]):
        middle = 1.0 / 3.0 if triangle[e] else 0.0
        for row in range(boxes[e, 2], boxes[e, 3] + 1):
            pa, pb = middle, middle
            for column in range(boxes[e, 0], boxes[e, 1] + 1):
                i, j = row - row0, column - column0
                if not mask[i, j]:
                    continue
                converged, qa, qb = invert(geometry[e], column, row, pa, pb)
                if not converged:
                    converged, qa, qb = invert(geometry[e], column, row, middle, middle)
                if not converged:
                    pa, pb = middle, middle
                    continue
                pa, pb = qa, qb
                beyond = outside_by(triangle[e], qa, qb)
                if beyond < excess[i, j]:
                    excess[i, j] = beyond
                    owner[i, j], a[i, j], b[i, j] = e, qa, qb
    return owner, a, b


@njit(cache=True, nogil=True)
def outside_by(triangle, a, b):
    """How far a place is beyond the edges of its cell, in its own coordinates; negative: inside."""
    return max(-a, -b, a + b - 1.0) if triangle else max(abs(a), abs(b)) - 1.0


@njit(cache=True, nogil=True)
def newton_step(a, b, xa, xb, ya, yb, rx, ry):
    """(whether to go on, whether it is found, new a, new b) of J (da, db) = r with J = (xa, xb; ya, yb).

    It ends without a place where J is singular or the place wanders off.
    """
    det = xa * yb - xb * ya
    if det == 0.0:
        return False, False, a, b
    da, db = (yb * rx - xb * ry) / det, (xa * ry - ya * rx) / det
    a, b = a + da, b + db
    if not (abs(a) < 10.0 and abs(b) < 10.0):
        return False, False, a, b
    converged = abs(da) + abs(db) < 1e-8  # quadratic convergence: the next step would be 1e-16
    return not converged, converged, a, b


@njit(cache=True, nogil=True)
def invert(g, x, y, a, b):
    """Newton for x(a, b) = (x, y); not found: singular, wandering off, or folded."""
    for _ in range(20):
        aa, bb, ab = a * a, b * b, a * b
        aab, abb = aa * b, a * bb
        rx = x - g[0, 0] - a * g[0, 1] - b * g[0, 2] - ab * g[0, 3] - aa * g[0, 4] - bb * g[0, 5]
        ry = y - g[1, 0] - a * g[1, 1] - b * g[1, 2] - ab * g[1, 3] - aa * g[1, 4] - bb * g[1, 5]
        rx -= aab * g[0, 6] + abb * g[0, 7]
        ry -= aab * g[1, 6] + abb * g[1, 7]
        xa = g[0, 1] + b * g[0, 3] + 2.0 * a * g[0, 4] + 2.0 * ab * g[0, 6] + bb * g[0, 7]
        xb = g[0, 2] + a * g[0, 3] + 2.0 * b * g[0, 5] + aa * g[0, 6] + 2.0 * ab * g[0, 7]
        ya = g[1, 1] + b * g[1, 3] + 2.0 * a * g[1, 4] + 2.0 * ab * g[1, 6] + bb * g[1, 7]
        yb = g[1, 2] + a * g[1, 3] + 2.0 * b * g[1, 5] + aa * g[1, 6] + 2.0 * ab * g[1, 7]
        going_on, converged, a, b = newton_step(a, b, xa, xb, ya, yb, rx, ry)
        if not going_on:
            return converged, a, b
    return False, a, b


@njit(cache=True, nogil=True)
def sort_by_owner(owner, n_elements):
    """Counting sort, row by row within an element; elements without a pixel drop out."""
    count = np.zeros(n_elements, dtype=np.int64)
    for o in owner.ravel():
        if o >= 0:
            count[o] += 1
    n_visible = 0
    for e in range(n_elements):
        n_visible += 1 if count[e] else 0
    visible, start = np.empty(n_visible, dtype=np.int64), np.empty(n_visible + 1, dtype=np.int64)
    place = np.empty(n_elements, dtype=np.int64)
    start[0] = k = 0
    for e in range(n_elements):  # loops: an array put into a slice takes three seconds to compile
        place[e] = start[k]
        if count[e]:
            visible[k], start[k + 1] = e, start[k] + count[e]
            k += 1
    iy, ix = np.empty(start[-1], dtype=np.int64), np.empty(start[-1], dtype=np.int64)
    for i in range(owner.shape[0]):
        for j in range(owner.shape[1]):
            o = owner[i, j]
            if o >= 0:
                iy[place[o]], ix[place[o]] = i, j
                place[o] += 1
    return visible, start, iy, ix
