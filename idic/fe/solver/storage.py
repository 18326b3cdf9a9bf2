"""Element matrices in the stored values of the global matrix: the place of each entry, and the sum.

Serial and ``nogil``; the slow NumPy versions are in ``tests/fe/test_kernels.py``.
"""

from __future__ import annotations

from idic.fe.solver.compilation import kernel


@kernel
def scatter(Ke, positions, values):
    """Add element matrices into the stored values of the global matrix."""
    for e in range(Ke.shape[0]):
        for i in range(Ke.shape[1]):
            for j in range(Ke.shape[2]):
                place = positions[e, i, j]
                if place >= 0:
                    values[place] += Ke[e, i, j]


@kernel
def places_in_columns(equations, indptr, indices, places):
    """Place of each element matrix entry among compressed columns with sorted rows, -1 where prescribed."""
    for e in range(equations.shape[0]):
        for i in range(equations.shape[1]):
            for j in range(equations.shape[1]):
                row, col = equations[e, i], equations[e, j]
                places[e, i, j] = -1
                if row >= 0 and col >= 0:
                    low, high = indptr[col], indptr[col + 1] - 1
                    while low < high:
                        middle = (low + high) // 2
                        if indices[middle] < row:
                            low = middle + 1
                        else:
                            high = middle
                    places[e, i, j] = low
