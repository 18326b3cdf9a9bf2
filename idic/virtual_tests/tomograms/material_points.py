"""Where the material at a place of the deformed body lies in the undeformed one: X with X + u(X) = x.

Inside an element both are polynomials of its local coordinates xi:  x(xi) = sum_m a_m p_m(xi), X(xi) likewise. For each
place in the box around a deformed element, xi follows by Newton from that of the place before. Nothing of
`idic.correlation` or `idic.images` is used.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from itertools import product

import numba
import numpy as np

from idic.fe import CELL_TYPES, Mesh

BOX_MARGIN = 0.1  # of the size of an element: a curved face may leave the box around the nodes
TOLERANCE = 1e-6  # of local coordinates at faces, which two elements share
NEWTON_STEPS = 15
_MAX_POWER = 2
_NO_POINT = np.nan


@dataclass(frozen=True)
class Lattice:
    """Places on a regular lattice in mesh axes.

    first_mm : (3,) x, y, z of the first place; step_mm : (3,); shape : number of places along z, y, x
    """

    first_mm: np.ndarray
    step_mm: np.ndarray
    shape: tuple[int, int, int]


def material_points(mesh: Mesh, u: np.ndarray, lattice: Lattice) -> np.ndarray:
    """The material points at the places of a lattice, NaN outside the body  # (nz, ny, nx, 3) mm

    Parameters
    ----------
    mesh : Mesh
        Of solids, tet4, tet10, hex8 or hex20.
    u : (n_nodes, 3) mm
        Displacements that bring the nodes to where the lattice finds them.
    """
    points = np.full((*lattice.shape, 3), _NO_POINT)
    first, step = (np.asarray(values, float) for values in (lattice.first_mm, lattice.step_mm))
    for block in mesh.blocks:
        powers, matrix = polynomials(block.cell)
        reference = mesh.nodes[block.connectivity]
        moved = (mesh.nodes + u)[block.connectivity]
        low, high = moved.min(axis=1), moved.max(axis=1)
        margin = BOX_MARGIN * (high - low)
        _fill(np.ascontiguousarray(matrix @ moved), np.ascontiguousarray(matrix @ reference), powers,
              low - margin, high + margin, block.cell.startswith("tet"), first, step, points)
    return points


@cache
def polynomials(cell: str) -> tuple[np.ndarray, np.ndarray]:
    """Exponents (n, 3) of the polynomials of a cell, and (n, n) from values at its nodes to coefficients."""
    sides = range(_MAX_POWER + 1)
    candidates = list(product(sides, sides, sides))
    keep = {"tet4": lambda powers: sum(powers) <= 1, "tet10": lambda powers: sum(powers) <= 2,
            "hex8": lambda powers: max(powers) <= 1,
            "hex20": lambda powers: powers.count(2) <= 1}[cell]
    powers = np.array([entry for entry in candidates if keep(entry)], dtype=np.int64)
    nodes = CELL_TYPES[cell].reference_nodes
    values = np.prod(nodes[:, None, :] ** powers[None], axis=2)
    return powers, np.linalg.inv(values)


@numba.njit(cache=True, nogil=True)
def _fill(moved, reference, powers, low, high, is_simplex, first, step, points):
    """moved, reference : (n_elements, n, 3) coefficients; points : (nz, ny, nx, 3), written where NaN"""
    n = powers.shape[0]
    values, slopes = np.empty(n), np.empty((n, 3))
    centre = 0.25 if is_simplex else 0.0
    xi, row_xi, target = np.empty(3), np.empty(3), np.empty(3)
    start, stop = np.empty(3, np.int64), np.empty(3, np.int64)
    for e in range(moved.shape[0]):
        for a in range(3):
            start[a] = max(0, int(np.ceil((low[e, a] - first[a]) / step[a])))
            stop[a] = min(points.shape[2 - a], int(np.floor((high[e, a] - first[a]) / step[a])) + 1)
        row_xi[:] = centre
        for k in range(start[2], stop[2]):
            target[2] = first[2] + k * step[2]
            for j in range(start[1], stop[1]):
                target[1] = first[1] + j * step[1]
                xi[:] = row_xi
                is_first = True
                for i in range(start[0], stop[0]):
                    if not np.isnan(points[k, j, i, 0]):
                        continue
                    target[0] = first[0] + i * step[0]
                    if not _local(moved[e], powers, target, xi, values, slopes):
                        xi[:] = centre
                        continue
                    if is_first:
                        row_xi[:] = xi
                        is_first = False
                    if _is_inside(xi, is_simplex):
                        for a in range(3):
                            total = 0.0
                            for m in range(n):
                                total += reference[e, m, a] * values[m]
                            points[k, j, i, a] = total


@numba.njit(cache=True, nogil=True)
def _is_inside(xi, is_simplex):
    if is_simplex:
        return min(xi[0], xi[1], xi[2]) >= -TOLERANCE and xi[0] + xi[1] + xi[2] <= 1.0 + TOLERANCE
    return max(abs(xi[0]), abs(xi[1]), abs(xi[2])) <= 1.0 + TOLERANCE


@numba.njit(cache=True, nogil=True)
def _local(coefficients, powers, target, xi, values, slopes):
    """Newton for x(xi) = target from xi on; whether it converges. values : of the polynomials at the end"""
    jacobian, error = np.empty((3, 3)), np.empty(3)
    for _ in range(NEWTON_STEPS):
        _polynomials_at(powers, xi, values, slopes)
        error[:] = target
        jacobian[:] = 0.0
        for m in range(powers.shape[0]):
            for a in range(3):
                error[a] -= coefficients[m, a] * values[m]
                for b in range(3):
                    jacobian[a, b] += coefficients[m, a] * slopes[m, b]
        determinant = (jacobian[0, 0] * (jacobian[1, 1] * jacobian[2, 2] - jacobian[1, 2] * jacobian[2, 1])
                       - jacobian[0, 1] * (jacobian[1, 0] * jacobian[2, 2] - jacobian[1, 2] * jacobian[2, 0])
                       + jacobian[0, 2] * (jacobian[1, 0] * jacobian[2, 1] - jacobian[1, 1] * jacobian[2, 0]))
        if determinant == 0.0:
            return False
        size = 0.0
        for b in range(3):
            c, d = (b + 1) % 3, (b + 2) % 3
            change = (error[0] * (jacobian[1, c] * jacobian[2, d] - jacobian[1, d] * jacobian[2, c])
                      + error[1] * (jacobian[2, c] * jacobian[0, d] - jacobian[2, d] * jacobian[0, c])
                      + error[2] * (jacobian[0, c] * jacobian[1, d] - jacobian[0, d] * jacobian[1, c])) / determinant
            xi[b] += change
            size = max(size, abs(change))
        if not size < 4.0:  # far outside the element, or NaN
            return False
        if size < 1e-9:
            _polynomials_at(powers, xi, values, slopes)
            return True
    return False


@numba.njit(cache=True, nogil=True)
def _polynomials_at(powers, xi, values, slopes):
    table = np.empty((3, 3))
    for a in range(3):
        table[a, 0], table[a, 1], table[a, 2] = 1.0, xi[a], xi[a] * xi[a]
    for m in range(powers.shape[0]):
        p, q, r = powers[m, 0], powers[m, 1], powers[m, 2]
        x, y, z = table[0, p], table[1, q], table[2, r]
        values[m] = x * y * z
        slopes[m, 0] = p * table[0, max(p - 1, 0)] * y * z
        slopes[m, 1] = q * x * table[1, max(q - 1, 0)] * z
        slopes[m, 2] = r * x * y * table[2, max(r - 1, 0)]
