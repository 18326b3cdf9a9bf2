"""Solutions for large bodies without a factor: conjugate gradients, preconditioned by algebraic multigrid.

A factor of n equations of a compact body takes about n^(4/3) entries and n^2 operations: 1.8 GB and 10^11 at 10^5
equations, far more than a laptop holds at 10^6. Aggregates of nodes, on which the rigid motions are kept (Vanek, Mandel
and Brezina, 1996, doi:10.1007/BF02238511; PyAMG, doi:10.21105/joss.04142), take a seventh of the matrix itself. Nothing
is drawn at random: prolongations are smoothed with weights of their rows, and blocks of nodes by Gauss and Seidel.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.sparse import coo_array, csr_matrix
from scipy.sparse.linalg import cg

from idic.fe.solver.rigid_motion import rigid_modes

INNER_TOLERANCE = 1e-3  # of a solution that iterations of `idic.fe.solver.krylov` correct: four of them reach rounding
MAX_ITERATIONS = 60  # for `INNER_TOLERANCE`; hex8: 5 to 7, nu = 0.49 14 to 22, elements ten times wider than high 25
MAX_COARSEST = 300  # equations of the coarsest level, which is solved by its dense pseudo-inverse
SMOOTHING = {"omega": 4.0 / 3.0, "weighting": "local"}


@dataclass(frozen=True)
class Hierarchy:
    """A symmetric positive definite matrix, numbered node by node, and its coarser levels.

    Attributes
    ----------
    place : (n,) int
        Of each equation in the vectors of the hierarchy; held dofs of free nodes have a place too.
    matrix : bsr (m, m)
    levels : pyamg.multilevel.MultilevelSolver
    """

    place: np.ndarray
    matrix: Any
    levels: Any

    def solve(self, columns: np.ndarray) -> np.ndarray:
        """Solutions (n, k) to within `INNER_TOLERANCE`; less accurate where the iterations are too slow."""
        cycle, solutions = self.levels.aspreconditioner(cycle="V"), np.empty(columns.shape)
        for k, column in enumerate(columns.T):
            rhs = np.zeros(self.matrix.shape[0])
            rhs[self.place] = column
            solution, _ = cg(self.matrix, rhs, rtol=INNER_TOLERANCE, maxiter=MAX_ITERATIONS, M=cycle)
            solutions[:, k] = solution[self.place]
        return solutions


def hierarchy(coordinates: np.ndarray, dofs: np.ndarray, indptr: np.ndarray, indices: np.ndarray,
              values: np.ndarray) -> Hierarchy | None:
    """The hierarchy of the symmetric part of a matrix; None where PyAMG is not installed (Linux on ARM).

    Parameters
    ----------
    coordinates : (n_nodes, d) mm
    dofs : (n,) int, the dof of each equation
    indptr, indices, values : of the matrix in compressed columns
    """
    try:
        from pyamg import smoothed_aggregation_solver  # loaded where a body is that large
    except ImportError:
        return None
    d = coordinates.shape[1]
    nodes, node_of = np.unique(dofs // d, return_inverse=True)
    place = (d * node_of + dofs % d).astype(np.int32)
    matrix = _symmetric_part(place, d * len(nodes), indptr, indices, values).tobsr((d, d))
    sweeps = [("block_gauss_seidel", {"sweep": sweep}) for sweep in ("forward", "backward")]
    levels = smoothed_aggregation_solver(
        matrix, B=_rigid_motions(coordinates[nodes], place), strength=("symmetric", {"theta": 0.0}),
        smooth=("jacobi", SMOOTHING), presmoother=sweeps[0], postsmoother=sweeps[1], improve_candidates=None,
        max_coarse=MAX_COARSEST)
    return Hierarchy(place, matrix, levels)


def _symmetric_part(place: np.ndarray, m: int, indptr: np.ndarray, indices: np.ndarray,
                    values: np.ndarray) -> csr_matrix:
    """Half of the matrix and its transpose, node by node; held dofs get a stiffness of the mean size."""
    columns = place[np.repeat(np.arange(len(place), dtype=np.int32), np.diff(indptr))]
    matrix = csr_matrix(coo_array((values, (place[indices], columns)), shape=(m, m)))
    matrix = (0.5 * (matrix + matrix.T)).tocsr()
    held_dofs = np.setdiff1d(np.arange(m, dtype=np.int32), place)
    if len(held_dofs):
        mean = float(matrix.diagonal()[place].mean())
        matrix = matrix + csr_matrix(coo_array((np.full(len(held_dofs), mean), (held_dofs, held_dofs)), shape=(m, m)))
    return matrix


def _rigid_motions(coordinates: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Translations and turns of the nodes, nothing at held dofs  # (m, 3 or 6)"""
    every_node = np.arange(len(coordinates))
    motions = rigid_modes(coordinates, every_node, every_node).reshape(coordinates.size, -1)
    free_motions = np.zeros_like(motions)
    free_motions[place] = motions[place]
    return free_motions
