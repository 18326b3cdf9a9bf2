"""The search behind the pixel map: which element owns a pixel, and where in it the pixel lies."""

from __future__ import annotations

import numpy as np
from numba import njit


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
                found, qa, qb = _invert(geometry[e], column, row, pa, pb)
                if not found:
                    found, qa, qb = _invert(geometry[e], column, row, middle, middle)
                if not found:
                    pa, pb = middle, middle
                    continue
                pa, pb = qa, qb
                beyond = max(-qa, -qb, qa + qb - 1.0) if triangle[e] else max(abs(qa), abs(qb)) - 1.0
                if beyond < excess[i, j]:
                    excess[i, j] = beyond
                    owner[i, j], a[i, j], b[i, j] = e, qa, qb
    return owner, a, b


@njit(cache=True, nogil=True)
def _invert(g, x, y, a, b):
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
        det = xa * yb - xb * ya
        if det == 0.0:
            return False, a, b
        da, db = (yb * rx - xb * ry) / det, (xa * ry - ya * rx) / det
        a, b = a + da, b + db
        if not (abs(a) < 10.0 and abs(b) < 10.0):
            return False, a, b
        if abs(da) + abs(db) < 1e-8:  # quadratic convergence: the next step would be 1e-16
            return True, a, b
    return False, a, b


@njit(cache=True, nogil=True)
def sort_by_owner(owner, n_elements):
    """Counting sort, row by row within an element; elements without a pixel drop out."""
    count = np.zeros(n_elements, dtype=np.int64)
    for o in owner.ravel():
        if o >= 0:
            count[o] += 1
    visible = np.flatnonzero(count)
    start = np.zeros(visible.size + 1, dtype=np.int64)
    start[1:] = np.cumsum(count[visible])
    place = np.zeros(n_elements, dtype=np.int64)
    place[visible] = start[:-1]
    iy, ix = np.empty(start[-1], dtype=np.int64), np.empty(start[-1], dtype=np.int64)
    for i in range(owner.shape[0]):
        for j in range(owner.shape[1]):
            o = owner[i, j]
            if o >= 0:
                iy[place[o]], ix[place[o]] = i, j
                place[o] += 1
    return visible, start, iy, ix
