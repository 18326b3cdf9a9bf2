"""Sparse linear systems of the free degrees of freedom: numbering, scatter positions, factorisation, solution.

An LU by dense fronts, numbered by nested dissection: compiled where fronts are small, by LAPACK where it costs much.
Matrices are unsymmetric in general (F-bar, follower loads, non-associated laws). Where an LU costs much, the symmetric
part is factorised for half of it, if it is positive definite and near the matrix, and for a quarter in single
precision, if that is accurate enough; iterations correct the rest. Where that too costs much, multigrid takes the place
of the factor.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from functools import cached_property

import numpy as np
from scipy.sparse import coo_array, csc_array
from scipy.sparse.linalg import SuperLU, splu

from idic.fe.solver import cholesky, dissection, krylov, multifrontal, multigrid, small_fronts, storage, substitution

MIN_OPERATIONS_PER_ENTRY = 250  # of a factorisation by fronts: from here on kept factors cost less (cubes, a plate)

# of a factor, 4 GB: half of a laptop's memory. Cubes of 180 000 equations; an elastoplastic one of 100 000 with four
# derivatives takes half as long again by multigrid, for half the memory
MAX_FACTOR_ENTRIES = 5e8

MAX_BACKWARD_ERROR = 1e-13  # of an LU by fronts; beyond, its row exchanges were not enough and SuperLU takes over

MAX_LEFT_BY_SYMMETRIC_PART = 0.1  # of a right-hand side: beyond, an LU is worth its work
# of a right-hand side of the symmetric part: six iterations to 1e-12. Cubes leave 1e-6, and slender or nearly
# incompressible bodies more
MAX_LEFT_BY_SINGLE_PRECISION = 0.01


class SingularMatrix(Exception):
    """The matrix has no inverse to working accuracy."""


class FactorKind(IntEnum):
    """How a matrix that costs much is factorised, the cheapest first: its symmetric part in single or in double
    precision, or an LU."""

    SINGLE = 0
    DOUBLE = 1
    LU = 2


@dataclass(frozen=True)
class Pattern:
    """Where the entries of the matrix of free dofs are stored.

    Attributes
    ----------
    equation : (n_dof,) int
        Equation number of each dof, -1 where prescribed or attached to no element.
    dofs : (n,) int
        The dof of each equation.
    indptr, indices : (n + 1,), (n_stored,) int32
        Compressed columns with sorted rows.
    fronts : tuple of Front
        How they are factorised.
    coordinates : (n_nodes, d) mm
        Of the nodes whose dofs they are.
    """

    equation: np.ndarray
    dofs: np.ndarray
    indptr: np.ndarray
    indices: np.ndarray
    fronts: tuple[multifrontal.Front, ...] = field(default=(), repr=False)
    coordinates: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)), repr=False)

    @property
    def n(self) -> int:
        return len(self.dofs)

    @property
    def n_stored(self) -> int:
        return len(self.indices)

    @cached_property
    def costs_much(self) -> bool:
        """Whether a factorisation costs so much that an earlier one is kept as long as iterations with it converge
        fast."""
        operations = sum(s**3 / 3 + s**2 * b + s * b**2 for s, b in self._front_sizes)
        return operations > MIN_OPERATIONS_PER_ENTRY * self.factor_entries

    @cached_property
    def factor_entries(self) -> float:
        """Entries of one triangular factor."""
        return sum(s * (s + 1) / 2 + s * b for s, b in self._front_sizes)

    @cached_property
    def _front_sizes(self) -> list[tuple[float, int]]:
        """Own equations and boundary of each front."""
        return [(float(front.end - front.first), len(front.boundary)) for front in self.fronts]

    @cached_property
    def tree(self) -> cholesky.Tree:
        return cholesky.tree_of(self.fronts)

    @cached_property
    def small_fronts(self) -> small_fronts.SmallFronts:
        return small_fronts.flat(self.fronts)

    def matrix(self, values: np.ndarray) -> csc_array:
        """The matrix with these stored values, in compressed columns."""
        return csc_array((values, self.indices, self.indptr), shape=(self.n, self.n))

    def positions(self, element_dofs: np.ndarray) -> np.ndarray:
        """Place of each entry of the element matrices in the stored values, -1: not stored.

        Parameters
        ----------
        element_dofs : (n_elements, m) int

        Returns
        -------
        (n_elements, m, m) int64
        """
        equations = np.ascontiguousarray(self.equation[element_dofs])
        places = np.empty((*equations.shape, equations.shape[1]), dtype=np.int64)
        storage.places_in_columns(equations, self.indptr, self.indices, places)
        return places


@dataclass(frozen=True)
class Factor:
    """A factorised matrix.

    lu : fronts, small or by LAPACK, SuperLU, or the levels of multigrid
    matrix : where the factors are those of a similar one: of its symmetric part, or (``of_earlier_tangent``) of an
        earlier one
    """

    pattern: Pattern
    lu: small_fronts.SmallFactor | tuple[multifrontal.FrontFactor, ...] | cholesky.SymmetricFactor | (
        SuperLU | multigrid.Hierarchy)
    matrix: csc_array | None = field(default=None, repr=False)
    of_earlier_tangent: bool = False

    @property
    def kind(self) -> FactorKind:
        """Levels of multigrid count as double precision: if they do not serve, an LU does."""
        if not self.of_symmetric_part:
            return FactorKind.LU
        return FactorKind.SINGLE if getattr(self.lu, "is_single", False) else FactorKind.DOUBLE

    @property
    def of_symmetric_part(self) -> bool:
        return isinstance(self.lu, (cholesky.SymmetricFactor, multigrid.Hierarchy))

    def solve(self, rhs: np.ndarray) -> np.ndarray:
        """Solve for one (n,) or several (n, m) right-hand sides, in equation numbering."""
        if self.pattern.n == 0 or rhs.size == 0:
            return np.zeros_like(rhs)
        if self.matrix is None:
            return self.approximate(rhs)
        solution = krylov.solution(self.matrix, self.approximate, rhs.reshape(self.pattern.n, -1))
        if solution is None:
            return self._replaced().solve(rhs)
        return solution.reshape(rhs.shape)

    def _replaced(self) -> Factor:
        """Factors of the matrix itself, of a better kind where these are not of an earlier one."""
        kind = FactorKind.SINGLE if self.of_earlier_tangent else FactorKind(min(self.kind + 1, FactorKind.LU))
        return factorise(self.pattern, self.matrix.data, kind)

    def approximate(self, rhs: np.ndarray) -> np.ndarray:
        """Solutions with the matrix of the factors itself."""
        columns = rhs.reshape(self.pattern.n, -1)
        if isinstance(self.lu, tuple):
            return substitution.solve(self.pattern.fronts, self.lu, columns).reshape(rhs.shape)
        return self.lu.solve(np.ascontiguousarray(columns)).reshape(rhs.shape)

    def solve_transposed(self, rhs: np.ndarray) -> np.ndarray:
        """Solve with the transposed matrix, for adjoints; shapes as in `solve`."""
        if self.pattern.n == 0 or rhs.size == 0:
            return np.zeros_like(rhs)
        columns = rhs.reshape(self.pattern.n, -1)
        if self.matrix is not None:
            solution = krylov.solution(self.matrix.T, self._approximate_transposed, columns)
            if solution is None:
                return self._replaced().solve_transposed(rhs)
            return solution.reshape(rhs.shape)
        return self._approximate_transposed(columns).reshape(rhs.shape)

    def _approximate_transposed(self, columns: np.ndarray) -> np.ndarray:
        if self.of_symmetric_part:
            return self.approximate(columns)
        if isinstance(self.lu, SuperLU):
            return self.lu.solve(np.ascontiguousarray(columns), "T")
        if isinstance(self.lu, small_fronts.SmallFactor):
            return self.lu.solve(columns, transposed=True)
        return substitution.solve_transposed(self.pattern.fronts, self.lu, columns)


def make_pattern(coordinates: np.ndarray, element_dofs: Sequence[np.ndarray], prescribed: np.ndarray) -> Pattern:
    """Number the free dofs by nested dissection.

    Parameters
    ----------
    coordinates : (n_nodes, n_dim)
    element_dofs : sequence of (n_elements, m) int
        Dofs of the elements; dofs of no element get no equation.
    prescribed : (n_p,) int
    """
    n_dim = coordinates.shape[1]
    is_free = np.zeros(coordinates.size, dtype=bool)
    for dofs in element_dofs:
        is_free[dofs] = True
    is_free[prescribed] = False
    nodes = [dofs[:, ::n_dim] // n_dim for dofs in element_dofs]
    separators, children = dissection.separators(dissection.incidences(coordinates, nodes),
                                                  is_free.reshape(-1, n_dim).any(axis=1))
    order = (np.concatenate([np.zeros(0, dtype=np.int64), *separators])[:, None] * n_dim + np.arange(n_dim)).ravel()
    ends = np.cumsum(is_free[order])[n_dim * np.cumsum([len(part) for part in separators], dtype=np.int64) - 1]
    order = order[is_free[order]]
    equation = np.full(coordinates.size, -1, dtype=np.int64)
    equation[order] = np.arange(len(order))
    columns = _compressed_columns(len(order), [equation[dofs] for dofs in element_dofs])
    return Pattern(equation, order, *columns, multifrontal.analyse(ends, children, *columns), coordinates)


def _compressed_columns(n: int, equations: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Column pointers and sorted row numbers of all entries that some element has."""
    total = csc_array((n, n), dtype=np.int8)
    for eq in equations:
        row, col = np.broadcast_arrays(eq[:, :, None], eq[:, None, :])
        inside = (row >= 0) & (col >= 0)
        entries = coo_array((np.ones(int(inside.sum()), dtype=np.int8), (row[inside], col[inside])), shape=(n, n))
        part = entries.tocsc()
        part.data[:] = 1  # summed duplicates may have wrapped round to zero
        total = total + part
        total.data[:] = 1
    total.sort_indices()
    return total.indptr.astype(np.int32), total.indices.astype(np.int32)


def factorise(pattern: Pattern, values: np.ndarray, kind: FactorKind = FactorKind.SINGLE) -> Factor:
    """Factors of the matrix with these stored values; raises SingularMatrix.

    kind : the cheapest one to try where an LU costs much
    """
    if not np.isfinite(values.sum()):  # one pass without a mask
        raise SingularMatrix("the stiffness is not finite")
    similar = _symmetric_factor(pattern, values, kind) if kind < FactorKind.LU and pattern.costs_much else None
    return _sparse_factor(pattern, values) if similar is None else similar


def _symmetric_factor(pattern: Pattern, values: np.ndarray, kind: FactorKind) -> Factor | None:
    """Levels or factors of the symmetric part; None where it is not positive definite or not near the matrix."""
    matrix = pattern.matrix(values)
    if pattern.factor_entries > MAX_FACTOR_ENTRIES and (np.asarray(matrix.diagonal()) > 0.0).all():
        levels = multigrid.hierarchy(pattern.coordinates, pattern.dofs, pattern.indptr, pattern.indices, values)
        if levels is not None and _is_near(factor := Factor(pattern, levels, matrix)):
            return factor
    if kind is FactorKind.SINGLE:
        factor = _single_factor(pattern, values, matrix)
        if factor is not None:
            return factor if _is_near(factor) else None
    fronts = cholesky.factor(pattern.fronts, pattern.tree, values)
    return factor if fronts is not None and _is_near(factor := Factor(pattern, fronts, matrix)) else None


def _single_factor(pattern: Pattern, values: np.ndarray, matrix: csc_array) -> Factor | None:
    """Factors of the symmetric part in single precision; None where that cannot be or is not accurate enough."""
    fronts = cholesky.factor(pattern.fronts, pattern.tree, values, single=True)
    return factor if fronts is not None and _is_accurate(factor := Factor(pattern, fronts, matrix)) else None


def _is_near(factor: Factor) -> bool:
    """Whether solutions by the symmetric part leave little of a right-hand side."""
    rhs = np.cos(np.arange(factor.pattern.n, dtype=float))
    remainder = rhs - factor.matrix @ factor.approximate(rhs)
    return bool(np.linalg.norm(remainder) <= MAX_LEFT_BY_SYMMETRIC_PART * np.linalg.norm(rhs))


def _is_accurate(factor: Factor) -> bool:
    """Whether the rounding of single precision leaves little of a right-hand side of the symmetric part."""
    rhs = np.cos(np.arange(factor.pattern.n, dtype=float))
    solution = factor.approximate(rhs)
    remainder = rhs - 0.5 * (factor.matrix @ solution + factor.matrix.T @ solution)
    return bool(np.linalg.norm(remainder) <= MAX_LEFT_BY_SINGLE_PRECISION * np.linalg.norm(rhs))


def _sparse_factor(pattern: Pattern, values: np.ndarray) -> Factor:
    """LU by fronts; by SuperLU, which may exchange any rows, where the first solution with it is not accurate."""
    fronts = (multifrontal.factor(pattern.fronts, values) if pattern.costs_much
              else small_fronts.factor(pattern.small_fronts, values))
    if fronts is not None:
        factor, rhs = Factor(pattern, fronts), np.cos(np.arange(pattern.n, dtype=float))
        if substitution.backward_error(pattern.indptr, pattern.indices, values, factor.solve(rhs),
                                       rhs) <= MAX_BACKWARD_ERROR:
            return factor
    matrix = pattern.matrix(values)
    try:
        return Factor(pattern,
                      splu(matrix, permc_spec="NATURAL", diag_pivot_thresh=0.01, options={"SymmetricMode": True}))
    except RuntimeError as error:
        raise SingularMatrix(str(error)) from None
