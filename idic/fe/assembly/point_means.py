"""Nodal means of point values, weighted by the (bi-, tri-)linear corner functions: they stay within the range of the
values."""

from __future__ import annotations

import numpy as np

from idic.fe.mesh import element
from idic.fe.mesh.mesh import Mesh

_CORNER_CELL = {"tri3": "tri3", "tri6": "tri3", "quad4": "quad4", "quad8": "quad4", "tet4": "tet4",
                "tet10": "tet4", "hex8": "hex8", "hex20": "hex8"}


def add_point_values(mesh: Mesh, cell: str, elements, values, quadrature, total, weight) -> None:
    """Add weighted point values (n_points, ...) of some elements of one block to the nodal sums."""
    block = mesh.block_of(int(elements[0]))
    connectivity = block.connectivity[np.asarray(elements) - block.first]
    xi, w = element.quadrature(cell, quadrature.get(cell))
    jac = np.einsum("eak,qai->eqki", mesh.nodes[connectivity], element.gradient(cell, xi))
    volume = np.linalg.det(jac) * w  # (n_el, nq)
    share = element.shape(_CORNER_CELL[cell], xi) @ element.shape(
        _CORNER_CELL[cell], element.cell(cell).reference_nodes).T  # (nq, nn), mid-side nodes between their corners
    weights = np.einsum("eq,qa->eqa", volume, share)
    values = values.reshape(*volume.shape, *values.shape[1:])
    np.add.at(weight, connectivity, weights.sum(axis=1))
    np.add.at(total, connectivity, np.einsum("eqa,eq...->ea...", weights, values))


def quotient(total: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Nodal means from their sums; NaN at nodes of no element."""
    with np.errstate(invalid="ignore", divide="ignore"):
        return total / weight.reshape(-1, *[1] * (total.ndim - 1))
