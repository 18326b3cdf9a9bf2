"""The hot element kernel for two dimensions: as in ``kernels.py``, with loops that the compiler can vectorise."""

from __future__ import annotations

import numpy as np

from idic.fe.assembly.kernels import kernel


@kernel
def element_stiffness(grads, weights, A, Ke):
    """As `kernels.element_stiffness`; grads (n_points, nn, 2), A (n_points, 4, 4), Ke (n_el, 2 nn, 2 nn)."""
    n_points, nn, _ = grads.shape
    n_el = Ke.shape[0]
    nq = n_points // n_el
    g, T, block = np.empty((2, nn)), np.empty((4, 2 * nn)), np.empty((2 * nn, 2 * nn))  # columns k nn + b
    for e in range(n_el):
        block[:] = 0.0
        for p in range(e * nq, (e + 1) * nq):
            for b in range(nn):
                g[0, b], g[1, b] = grads[p, b, 0], grads[p, b, 1]
            w = weights[p]
            for ij in range(4):
                for k in range(2):
                    x, y = w * A[p, ij, 2 * k], w * A[p, ij, 2 * k + 1]
                    row = T[ij, k * nn:(k + 1) * nn]
                    for b in range(nn):
                        row[b] = x * g[0, b] + y * g[1, b]
            for i in range(2):
                first, second = T[2 * i], T[2 * i + 1]
                for a in range(nn):
                    x, y = g[0, a], g[1, a]
                    row = block[2 * a + i]
                    for c in range(2 * nn):
                        row[c] += x * first[c] + y * second[c]
        for r in range(2 * nn):
            for k in range(2):
                for b in range(nn):
                    Ke[e, r, 2 * b + k] = block[r, k * nn + b]
