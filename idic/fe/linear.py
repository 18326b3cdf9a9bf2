"""Sparse linear systems of the free degrees of freedom: numbering, scatter positions, factorisation, solution.

Reverse Cuthill-McKee numbering and LAPACK band LU where the band is narrow (thin strips, 2D), else SuperLU with minimum
degree on A^T + A. Matrices are unsymmetric in general (F-bar, follower loads, non-associated laws).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg.lapack import dgbtrf, dgbtrs
from scipy.sparse import coo_array, csc_array
from scipy.sparse.csgraph import reverse_cuthill_mckee
from scipy.sparse.linalg import SuperLU, splu

MAX_BAND_BYTES = 250e6  # wider: SuperLU. A 3D block of that size factorises faster, and in less memory, by SuperLU


class SingularMatrix(Exception):
    """The matrix has no inverse to working accuracy."""


@dataclass(frozen=True)
class Pattern:
    """Where the entries of the matrix of free dofs are stored.

    Attributes
    ----------
    equation : (n_dof,) int
        Equation number of each dof, -1 where prescribed or attached to no element.
    dofs : (n,) int
        The dof of each equation.
    half_bandwidth : int or None
        Band storage (LAPACK, leading dimension 3 * half_bandwidth + 1); None: compressed columns.
    """

    equation: np.ndarray
    dofs: np.ndarray
    half_bandwidth: int | None
    indptr: np.ndarray | None = None
    indices: np.ndarray | None = None

    @property
    def n(self) -> int:
        return len(self.dofs)

    @property
    def n_stored(self) -> int:
        if self.half_bandwidth is None:
            return len(self.indices)
        return (3 * self.half_bandwidth + 1) * self.n

    def positions(self, element_dofs: np.ndarray) -> np.ndarray:
        """Place of each entry of the element matrices in the stored values, -1: not stored.

        Parameters
        ----------
        element_dofs : (n_elements, m) int

        Returns
        -------
        (n_elements, m, m) int64
        """
        eq = self.equation[element_dofs]
        row, col = np.broadcast_arrays(eq[:, :, None], eq[:, None, :])
        inside = (row >= 0) & (col >= 0)
        if self.half_bandwidth is not None:
            kl = self.half_bandwidth
            place = (2 * kl + row - col) + (3 * kl + 1) * col
        else:
            keys = np.repeat(np.arange(self.n), np.diff(self.indptr)) * self.n + self.indices
            place = np.searchsorted(keys, col * self.n + row)
        return np.where(inside, place, -1).astype(np.int64)


@dataclass(frozen=True)
class Factor:
    """A factorised matrix."""

    pattern: Pattern
    lu: np.ndarray | SuperLU
    pivots: np.ndarray | None = None

    def solve(self, rhs: np.ndarray) -> np.ndarray:
        """Solve for one (n,) or several (n, m) right-hand sides, in equation numbering."""
        if self.pattern.n == 0 or rhs.size == 0:
            return np.zeros_like(rhs)
        if self.pivots is None:
            return self.lu.solve(np.ascontiguousarray(rhs))
        kl = self.pattern.half_bandwidth
        x, info = dgbtrs(self.lu, kl, kl, np.asfortranarray(rhs), self.pivots)
        if info != 0:
            raise SingularMatrix(f"dgbtrs: info {info}")
        return x


def make_pattern(n_dof: int, n_dim: int, element_dofs: Sequence[np.ndarray], prescribed: np.ndarray,
                 max_band_bytes: float = MAX_BAND_BYTES) -> Pattern:
    """Number the free dofs and choose the storage.

    Parameters
    ----------
    element_dofs : sequence of (n_elements, m) int
        Dofs of the elements; dofs of no element get no equation.
    prescribed : (n_p,) int
    """
    free = np.zeros(n_dof, dtype=bool)
    for dofs in element_dofs:
        free[dofs] = True
    free[prescribed] = False
    rank = _node_ranks(n_dof // n_dim, n_dim, element_dofs)
    order = np.argsort(rank[np.arange(n_dof) // n_dim], kind="stable")
    order = order[free[order]]
    equation = np.full(n_dof, -1, dtype=np.int64)
    equation[order] = np.arange(len(order))
    band = 0
    for dofs in element_dofs:
        eq = equation[dofs]
        low = np.where(eq < 0, n_dof, eq).min(axis=1, initial=n_dof)
        band = max(band, int((eq.max(axis=1, initial=-1) - low).max(initial=0)))
    if (3 * band + 1) * len(order) * 8 <= max_band_bytes:
        return Pattern(equation, order, band)
    indptr, indices = _compressed_columns(len(order), [equation[dofs] for dofs in element_dofs])
    return Pattern(equation, order, None, indptr, indices)


def _node_ranks(n_nodes, n_dim, element_dofs):
    rows, cols = [], []
    for dofs in element_dofs:
        nodes = dofs[:, ::n_dim] // n_dim
        m = nodes.shape[1]
        rows.append(np.repeat(nodes, m, axis=1).ravel())
        cols.append(np.tile(nodes, (1, m)).ravel())
    rows, cols = np.concatenate(rows), np.concatenate(cols)
    graph = coo_array((np.ones(len(rows), dtype=np.int8), (rows, cols)), shape=(n_nodes, n_nodes)).tocsr()
    rank = np.empty(n_nodes, dtype=np.int64)
    rank[reverse_cuthill_mckee(graph, symmetric_mode=True)] = np.arange(n_nodes)
    return rank


def _compressed_columns(n, equations):
    keys = []
    for eq in equations:
        row, col = np.broadcast_arrays(eq[:, :, None], eq[:, None, :])
        inside = (row >= 0) & (col >= 0)
        keys.append(np.unique((col * n + row)[inside]))
    keys = np.unique(np.concatenate(keys))
    indptr = np.searchsorted(keys, np.arange(n + 1) * n)
    return indptr.astype(np.int32), (keys % n).astype(np.int32)


def factorise(pattern: Pattern, values: np.ndarray) -> Factor:
    """LU of the matrix with these stored values (overwritten); raises SingularMatrix."""
    if pattern.n == 0:
        return Factor(pattern, values, np.zeros(0, dtype=np.int32))
    if not np.isfinite(values).all():
        raise SingularMatrix("the stiffness is not finite")
    if pattern.half_bandwidth is None:
        matrix = csc_array((values, pattern.indices, pattern.indptr), shape=(pattern.n, pattern.n))
        try:
            lu = splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.01, options={"SymmetricMode": True})
        except RuntimeError as error:
            raise SingularMatrix(str(error)) from None
        return Factor(pattern, lu)
    kl = pattern.half_bandwidth
    band = values.reshape((3 * kl + 1, pattern.n), order="F")
    lu, pivots, info = dgbtrf(band, kl, kl, overwrite_ab=1)
    if info != 0:
        raise SingularMatrix(f"pivot {info} of {pattern.n} is zero")
    return Factor(pattern, lu, pivots)
