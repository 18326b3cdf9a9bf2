"""Shape functions of the visible cells in one monomial basis, so that one pixel kernel serves all of them.

    N_i(a, b) = sum_k T[k, i] m_k(a, b),    m = (1, a, b, ab, a^2, b^2, a^2 b, a b^2)

with the first 3 monomials for tri3, 4 for quad4, 6 for tri6 and 8 for quad8. (a, b) are the cell's own coordinates:
0..1 with a + b <= 1 for triangles, -1..1 for quadrilaterals; corners counter-clockwise, mid-side nodes last.
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
    zero, one = np.zeros_like(a), np.ones_like(a)
    by_a = np.stack([zero, one, zero, b, 2 * a, zero, 2 * a * b, b * b], axis=-1)
    by_b = np.stack([zero, zero, one, a, zero, 2 * b, a * a, 2 * a * b], axis=-1)
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


@njit(cache=True, nogil=True)
def inverse_gradients(motion, centre, inverse_jacobian, inverse, det):
    """Inverse and determinant of F = I + du/d(a, b) d(a, b)/dx at the centre of every element.

    motion (n_elements, 2, 8) monomial coefficients of u; centre (n_elements, 2); inverse_jacobian (n_elements, 2, 2);
    results inverse (n_elements, 2, 2), det (n_elements,). A flattened element (det 0) gets inverse 0: it has no say.
    """
    for e in range(motion.shape[0]):
        a, b = centre[e]
        f = np.eye(2)
        for c in range(2):
            m = motion[e, c]
            by_a = m[1] + b * m[3] + 2.0 * a * m[4] + 2.0 * a * b * m[6] + b * b * m[7]
            by_b = m[2] + a * m[3] + 2.0 * b * m[5] + a * a * m[6] + 2.0 * a * b * m[7]
            for d in range(2):
                f[c, d] += by_a * inverse_jacobian[e, 0, d] + by_b * inverse_jacobian[e, 1, d]
        det[e] = f[0, 0] * f[1, 1] - f[0, 1] * f[1, 0]
        scale = 1.0 / det[e] if det[e] != 0.0 else 0.0
        inverse[e, 0, 0], inverse[e, 0, 1] = scale * f[1, 1], -scale * f[0, 1]
        inverse[e, 1, 0], inverse[e, 1, 1] = -scale * f[1, 0], scale * f[0, 0]
