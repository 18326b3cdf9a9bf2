"""Fill and operations of the direct solver, counted on the mesh before there is a matrix.

The front of a separator (`idic.fe.solver.dissection`) holds its own dofs, s, and those of earlier separators around its
part, b:
s (s + 1) / 2 + s b entries of one triangle and about s^3 / 3 + s^2 b + s b^2 multiplications.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from idic.fe.solver import linear
from idic.fe.solver.dissection import dissect, incidences
from idic.fe.mesh.mesh import Mesh


@dataclass(frozen=True)
class Fill:
    """entries : of one triangular factor; operations : multiplications of the symmetric factorisation"""

    entries: float
    operations: float

    @property
    def costs_much(self) -> bool:
        """Whether an earlier factor is kept as long as iterations with it converge fast."""
        return self.operations > linear.MIN_OPERATIONS_PER_ENTRY * self.entries

    @property
    def is_too_large(self) -> bool:
        """Whether multigrid takes the place of factors."""
        return self.entries > linear.MAX_FACTOR_ENTRIES


def dissected(mesh: Mesh) -> Fill:
    """The fill of the stiffness of a mesh, all dofs free."""
    touching = incidences(mesh.nodes, [block.connectivity for block in mesh.blocks])
    entries = operations = 0.0
    for level in dissect(touching):
        part, n_parts = level.part[touching.elements], int(level.part.max()) + 1
        s = mesh.n_dim * _counted(part, touching.nodes, level.chosen, n_parts)
        b = mesh.n_dim * _counted(part, touching.nodes, level.separated, n_parts)
        entries += float((s * (s + 1) / 2 + s * b).sum())
        operations += float((s**3 / 3 + s**2 * b + s * b**2).sum())
    return Fill(entries, operations)


def _counted(parts: np.ndarray, nodes: np.ndarray, chosen: np.ndarray, n_parts: int) -> np.ndarray:
    """Number of different chosen nodes at the elements of each part  # (n_parts,) float"""
    inside = chosen[nodes]
    pairs = np.unique(parts[inside] * len(chosen) + nodes[inside])
    return np.bincount(pairs // len(chosen), minlength=n_parts).astype(float)
