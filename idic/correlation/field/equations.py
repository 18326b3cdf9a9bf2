"""The equations of one frame of a measured field: those of all points, less the points that the frame does not show.

    H = H_all - sum_missing L^T L,      C^T H C = C^T H_all C - sum_missing (L C)^T (L C)

H_all is that of every frame, and so is the influence of the frame-local unknowns of an elastic model: of those columns
the product with H_all is kept from one frame to the next. Columns of the frame alone and kept ones are multiplied
apart, so that the bits do not depend on what was kept.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse

from idic.correlation.frame import FrameGram, NodalEquations


class KeptProduct:
    """H C and C^T H C of the columns C that were asked for last."""

    def __init__(self) -> None:
        self._last: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None

    def of(self, H: sparse.csr_array, C: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """H C (n, m) and C^T H C (m, m); H is the same in all calls."""
        last = self._last  # one look: threads of a worker share it
        if last is None or not np.array_equal(last[0], C):
            product = H @ C
            last = self._last = C.copy(), product, C.T @ product
        return last[1:]


@dataclass(frozen=True, eq=False)
class FieldEquations(NodalEquations):
    """`NodalEquations` of a frame.

    Attributes
    ----------
    all_points : csr_array (2 n_nodes, 2 n_nodes)
        H_all.
    missing : csr_array (n_lost, 2 n_nodes)
        L of the rows that the frame does not show.
    kept : KeptProduct
    """

    all_points: sparse.csr_array
    missing: sparse.csr_array
    kept: KeptProduct

    def gram(self, columns: np.ndarray, alike: int = 0) -> FrameGram:
        """M and b of nodal fields; alike : how many of the last columns most frames share  # columns (2 n_nodes, m)"""
        columns = np.ascontiguousarray(columns, dtype=np.float64)
        m, nb = columns.shape[1], self.n_brightness
        own, others = np.ascontiguousarray(columns[:, :m - alike]), np.ascontiguousarray(columns[:, m - alike:])
        others_product, others_gram = self.kept.of(self.all_points, others)
        product = np.hstack([self.all_points @ own, others_product])
        matrix = np.zeros((m + nb, m + nb))
        matrix[:m - alike, :m] = own.T @ product
        matrix[m - alike:m, :m - alike] = matrix[:m - alike, m - alike:m].T
        matrix[m - alike:m, m - alike:m] = others_gram
        if self.missing.shape[0]:
            gone = self.missing @ columns
            product = product - self.missing.T @ gone
            matrix[:m, :m] -= gone.T @ gone
        if nb:
            matrix[:m, m:] = (self.hb.T @ columns).T
            matrix[m:, :m] = matrix[:m, m:].T
            matrix[m:, m:] = self.bb
        return FrameGram(matrix, np.concatenate([columns.T @ self.q, self.rb]), m, product)
