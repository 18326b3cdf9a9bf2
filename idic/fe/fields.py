"""Nodal fields for display: deformation, strain, stress and plastic strain averaged from the points.

Point values are averaged with the (bi-, tri-)linear corner functions as weights: values stay within the range of the
point values (a plastic strain never turns negative); next to an edge the average is first-order accurate only.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array

from idic.errors import InputError
from idic.fe.assembly.point_means import add_point_values, quotient
from idic.fe.time_march import FrameState, PointValues
from idic.fe.mesh.mesh import Mesh, PerMesh
from idic.fe.body.body import Body

QUANTITIES = ("F", "strain", "stress", "plastic_strain")
_NODAL_SLOPES = PerMesh()


def nodal_field(body: Body, frame: FrameState, quantity: str) -> np.ndarray:
    """A quantity at the nodes of a simulated frame.

    Parameters
    ----------
    quantity : {"F", "strain", "stress", "plastic_strain"}
        Deformation gradient; small-strain tensor or, for finite-strain laws, Green's strain; Cauchy stress in MPa;
        equivalent plastic strain (zero where the law has none).

    Returns
    -------
    (n_nodes, d, d), or (n_nodes,) for the plastic strain; NaN at nodes of no element
    """
    if quantity not in QUANTITIES:
        raise InputError("unknown field", expected=", ".join(QUANTITIES), found=quantity,
                         remedy="write one of these names")
    shape = () if quantity == "plastic_strain" else (body.mesh.n_dim,) * 2
    total, weight = np.zeros((body.mesh.n_nodes, *shape)), np.zeros(body.mesh.n_nodes)
    for values in frame.points:
        add_point_values(body.mesh, values.cell, values.elements, point_values(body, values, quantity),
                         body.quadrature,
             total, weight)
    return quotient(total, weight)


def nodal_state(body: Body, frame: FrameState, name: str) -> np.ndarray:
    """A scalar state of the laws at the nodes; NaN at nodes of no element whose law has it  # (n_nodes,)"""
    total, weight = np.zeros(body.mesh.n_nodes), np.zeros(body.mesh.n_nodes)
    for values in frame.points:
        names = body.sections[values.section].law.spec.state_names
        if name in names:
            add_point_values(body.mesh, values.cell, values.elements, values.state[:, names.index(name)],
                             body.quadrature, total, weight)
    return quotient(total, weight)


def point_values(body: Body, values: PointValues, quantity: str) -> np.ndarray:
    """A quantity at the integration points of one group  # (n_points, ...) as `nodal_field`"""
    law = body.sections[values.section].law
    if quantity == "F":
        return values.F
    if quantity == "strain":
        return small_strain(values.F) if law.small else green_strain(values.F)
    if quantity == "stress":
        return values.P if law.small else cauchy_stress(body, values)
    names = law.spec.state_names
    if "plastic_strain" not in names:
        return np.zeros(len(values.F))
    return values.state[:, names.index("plastic_strain")]


def small_strain(F: np.ndarray) -> np.ndarray:
    """sym(F) - I  # (n, d, d)"""
    return (F + F.transpose(0, 2, 1)) / 2 - np.eye(F.shape[1])


def green_strain(F: np.ndarray) -> np.ndarray:
    """Green's strain (F^T F - I)/2  # (n, d, d)"""
    return (np.einsum("nki,nkj->nij", F, F) - np.eye(F.shape[1])) / 2


def cauchy_stress(body: Body, values: PointValues) -> np.ndarray:
    """Cauchy stress P F^T / J of a finite-strain group, in plane for 2D  # (n_points, d, d) MPa"""
    J = np.linalg.det(values.F)
    if body.kind == "plane_stress":
        J = J * values.state[:, -1]  # F33, which plane stress keeps behind the law's own state
    return np.einsum("nik,njk->nij", values.P, values.F) / J[:, None, None]


def nodal_deformation(mesh: Mesh, u: np.ndarray) -> np.ndarray:
    """Deformation gradient at the nodes of any nodal displacement, also a measured one.

    The mean of what the elements around a node find there: second-order accurate also on an edge of the body, where an
    average of point values would be of first order only.

    Parameters
    ----------
    u : (n_nodes, d) mm, or of a plane mesh with a third component out of the plane

    Returns
    -------
    (n_nodes, components, d); NaN at nodes of no element
    """
    slopes, count = _NODAL_SLOPES.once(mesh, (), lambda: _nodal_slopes(mesh))
    d, components = mesh.n_dim, u.shape[1]
    total = (slopes @ u).reshape(mesh.n_nodes, d, components).transpose(0, 2, 1)
    return quotient(total + count[:, None, None] * np.eye(components, d), count)


def _nodal_slopes(mesh: Mesh) -> tuple[csr_array, np.ndarray]:
    """Sum over the elements around a node of the slopes there of a nodal field, and their number; zeros are stored, so
    that a node without a value leaves none at any node of its elements

    # (n_nodes d, n_nodes) 1/mm, (n_nodes,)
    """
    d, count = mesh.n_dim, np.zeros(mesh.n_nodes)
    values, rows, columns = [np.zeros(0)], [np.zeros(0, dtype=np.int64)], [np.zeros(0, dtype=np.int64)]
    for block in mesh.blocks:
        cell = block.kind
        if cell.dim != d:
            continue
        slopes = block.kind.shape_gradients(cell.reference_nodes)  # (nodes: where, nodes: whose, d)
        jac = np.einsum("eak,qai->eqki", mesh.nodes[block.connectivity], slopes)
        grads = np.einsum("qai,eqik->eqka", slopes, np.linalg.inv(jac))
        row, column = np.broadcast_arrays(block.connectivity[:, :, None, None] * d + np.arange(d)[:, None],
                                          block.connectivity[:, None, None, :])
        for entries, part in ((values, grads), (rows, row), (columns, column)):
            entries.append(part.ravel())
        np.add.at(count, block.connectivity, 1.0)
    places = np.concatenate(rows), np.concatenate(columns)
    return csr_array((np.concatenate(values), places), shape=(mesh.n_nodes * d, mesh.n_nodes)), count
