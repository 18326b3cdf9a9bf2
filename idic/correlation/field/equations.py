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

from idic.correlation.image_equations.frame import FrameGram, NodalEquations
from idic.correlation.views.view import View


class KeptProduct:
    """The columns C that most frames share and C^T H C, of those that were asked for last."""

    def __init__(self) -> None:
        self._last: tuple[np.ndarray, np.ndarray] | None = None
        self._fields: tuple[tuple, np.ndarray, np.ndarray] | None = None

    def columns(self, view: View, nodes: np.ndarray, u: np.ndarray, fields: np.ndarray) -> np.ndarray:
        """`View.columns`, kept from frame to frame where neither fields nor scale change  # (c n_nodes, m)"""
        if not view.is_affine:
            return view.columns(nodes, u, fields)
        entry = self._fields  # one look: threads of a worker share it
        if entry is None or entry[0] != view.camera.key or not (entry[1] is fields or np.array_equal(entry[1], fields)):
            entry = self._fields = view.camera.key, fields, view.columns(nodes, u, fields)
        return entry[2]

    def gram(self, H: sparse.csr_array, C: np.ndarray) -> np.ndarray:
        """C^T H C; H is the same in all calls  # (m, m)"""
        entry = self._last
        if entry is None or not (entry[0] is C or np.array_equal(entry[0], C)):
            entry = self._last = C, C.T @ (H @ C)
        return entry[1]


@dataclass(frozen=True, eq=False)
class FieldEquations(NodalEquations):
    """`NodalEquations` of a frame.

    Attributes
    ----------
    all_points : csr_array (2 n_nodes, 2 n_nodes)
        H_all.
    missing : csr_array (n_lost, 2 n_nodes)
        L of the rows that the frame does not show.
    products : KeptProduct
    """

    all_points: sparse.csr_array
    missing: sparse.csr_array
    products: KeptProduct

    def gram(self, columns: np.ndarray, alike: int = 0) -> FrameGram:
        """M and b of nodal fields; alike : how many of the last columns most frames share  # columns (2 n_nodes, m)"""
        columns = np.ascontiguousarray(columns, dtype=np.float64)
        k = columns.shape[1] - alike
        return self.gram_of(np.ascontiguousarray(columns[:, :k]), np.ascontiguousarray(columns[:, k:]))

    def gram_of(self, distinct: np.ndarray, alike: np.ndarray) -> FrameGram:
        """The same of columns of the frame and of those that most frames share  # (c n_nodes, k), (c n_nodes, m - k)"""
        k, m, nb = distinct.shape[1], distinct.shape[1] + alike.shape[1], self.n_brightness
        product, alike_gram = self.all_points @ distinct, self.products.gram(self.all_points, alike)
        matrix = np.zeros((m + nb, m + nb))
        with_alike = alike.T @ np.column_stack([product, self.q])  # in one pass: it is the largest array
        matrix[:k, :k] = distinct.T @ product
        matrix[k:m, :k] = with_alike[:, :k]
        matrix[:k, k:m] = matrix[k:m, :k].T
        matrix[k:m, k:m] = alike_gram
        if self.missing.shape[0]:
            lost = np.hstack([self.missing @ distinct, self.missing @ alike])
            matrix[:m, :m] -= lost.T @ lost
        if nb:
            matrix[:m, m:] = np.hstack([self.hb.T @ distinct, self.hb.T @ alike]).T
            matrix[m:, :m] = matrix[:m, m:].T
            matrix[m:, m:] = self.bb
        return FrameGram(matrix, np.concatenate([distinct.T @ self.q, with_alike[:, k], self.rb]), m, None)
