"""Nodal means of point values: weighted by the (bi-, tri-)linear corner functions, which stays within the range of the
values, or carried to the nodes by the (bi-, tri-)linear field that fits the points of each element, which follows a
gradient to the edge of the body."""

from __future__ import annotations

import numpy as np

from idic.fe.mesh.element import cell_type
from idic.fe.mesh.mesh import Mesh

_CORNER_CELL = {"tri3": "tri3", "tri6": "tri3", "quad4": "quad4", "quad8": "quad4", "tet4": "tet4",
                "tet10": "tet4", "hex8": "hex8", "hex20": "hex8"}


def add_point_values(mesh: Mesh, cell: str, elements, values, quadrature, total, weight) -> None:
    """Add weighted point values (n_points, ...) of some elements of one block to the nodal sums."""
    connectivity, xi, volume = _points(mesh, cell, elements, quadrature)
    corner = cell_type(_CORNER_CELL[cell])
    at_nodes = corner.shape_functions(cell_type(cell).reference_nodes)
    share = corner.shape_functions(xi) @ at_nodes.T  # (nq, nn), mid-side nodes between their corners
    weights = np.einsum("eq,qa->eqa", volume, share)
    values = values.reshape(*volume.shape, *values.shape[1:])
    np.add.at(weight, connectivity, weights.sum(axis=1))
    np.add.at(total, connectivity, np.einsum("eqa,eq...->ea...", weights, values))


def add_carried_values(mesh: Mesh, cell: str, elements, values, quadrature, total, weight) -> None:
    """The same of the values that the linear field of each element has at its nodes, weighted by its volume."""
    connectivity, xi, volume = _points(mesh, cell, elements, quadrature)
    corner = cell_type(_CORNER_CELL[cell])
    carry = corner.shape_functions(cell_type(cell).reference_nodes) @ np.linalg.pinv(corner.shape_functions(xi))
    element_volume = volume.sum(axis=1)
    at_nodes = np.einsum("aq,eq...->ea...", carry, values.reshape(*volume.shape, *values.shape[1:]))
    np.add.at(weight, connectivity, element_volume[:, None])
    np.add.at(total, connectivity, at_nodes * element_volume.reshape(-1, *[1] * (at_nodes.ndim - 1)))


def _points(mesh: Mesh, cell: str, elements, quadrature) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Nodes of the elements (n_el, nn), reference coordinates of their points (nq, d), volumes of these (n_el, nq)."""
    block = mesh.block_of(int(elements[0]))
    connectivity = block.connectivity[np.asarray(elements) - block.first]
    xi, w = cell_type(cell).quadrature_rule(quadrature.get(cell))
    jac = np.einsum("eak,qai->eqki", mesh.nodes[connectivity], cell_type(cell).shape_gradients(xi))
    return connectivity, xi, np.linalg.det(jac) * w


def quotient(total: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Nodal means from their sums; NaN at nodes of no element."""
    with np.errstate(invalid="ignore", divide="ignore"):
        return total / weight.reshape(-1, *[1] * (total.ndim - 1))
