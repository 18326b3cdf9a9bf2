"""Steady heat conduction on a mesh: temperatures at nodes without a measurement.

Uniform conductivity, insulated surface: ``K T = 0`` at the nodes without a value (Laplace's equation, the smoothest
field in the sense of least ``∫ |grad T|² dV``); a body with one known temperature has it everywhere.
"""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu

from idic.errors import InputError
from idic.fe.mesh.mesh import Mesh


def conductance(mesh: Mesh) -> sparse.csr_array:
    """``K_ab = ∫ grad N_a . grad N_b dV`` over the undeformed body  # (n_nodes, n_nodes) mm^(dim - 2)"""
    rows, columns, values = [], [], []
    for block in mesh.blocks:
        slopes, weights = _slopes(mesh, block)
        Ke = np.einsum("eqak,eqbk,eq->eab", slopes, slopes, weights)
        n = block.connectivity.shape[1]
        rows.append(np.repeat(block.connectivity, n, axis=1).ravel())
        columns.append(np.tile(block.connectivity, (1, n)).ravel())
        values.append(Ke.ravel())
    triplet = (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns)))
    return sparse.csr_array(triplet, shape=(mesh.n_nodes, mesh.n_nodes))


def volume(mesh: Mesh) -> float:
    """Area of a plane mesh in mm², volume of a solid in mm³."""
    return float(sum(_slopes(mesh, block)[1].sum() for block in mesh.blocks))


def _slopes(mesh: Mesh, block) -> tuple[np.ndarray, np.ndarray]:
    """dN/dX (n_el, nq, nn, d) and volumes (n_el, nq) at the points of a full quadrature."""
    # reduced integration would leave hourglass patterns at no cost
    order = 3 if block.cell in ("quad8", "hex20") else None
    xi, w = block.kind.quadrature_rule(order)
    gradient = block.kind.shape_gradients(xi)
    jac = np.einsum("eak,qai->eqki", mesh.nodes[block.connectivity], gradient)
    return np.einsum("qai,eqik->eqak", gradient, np.linalg.inv(jac)), np.linalg.det(jac) * w


def conducted(mesh: Mesh, values: np.ndarray) -> np.ndarray:
    """Nodal temperatures with the unknown ones (NaN) filled in  # (m, n_nodes) -> (m, n_nodes)

    Raises
    ------
    InputError
        A piece of the mesh without any known temperature.
    """
    values = np.array(values, dtype=float)
    unknown = np.isnan(values)
    if not unknown.any():
        return values
    K = conductance(mesh).tocsc()
    pattern, pattern_number = np.unique(unknown, axis=0, return_inverse=True)
    for k, gaps in enumerate(pattern):
        if not gaps.any():
            continue
        lost = unreached(mesh, ~gaps)
        if lost is not None:
            raise InputError("a piece of the mesh without a temperature", key="[[boundary]] temperature",
                             expected="a temperature in every piece of the mesh",
                             found=f"none in the piece with node {mesh.node_labels[lost]}",
                             remedy="give one there, or one without `nodes` first, for the whole mesh")
        rows, used = np.flatnonzero(pattern_number.ravel() == k), gaps & (K.diagonal() > 0)
        inside, measured = np.flatnonzero(used), np.flatnonzero(~gaps)
        flow = K[inside][:, measured] @ values[rows][:, measured].T
        values[np.ix_(rows, inside)] = -splu(K[inside][:, inside].tocsc()).solve(np.asarray(flow)).T
        values[np.ix_(rows, np.flatnonzero(gaps & ~used))] = 0.0  # nodes of no element have no temperature to speak of
    return values


def unreached(mesh: Mesh, measured: np.ndarray) -> int | None:
    """A node of a piece of the mesh without any measured node; None where each has one. measured : (n_nodes,) bool"""
    rows = np.concatenate([block.connectivity.ravel() for block in mesh.blocks])
    ends = np.concatenate([np.repeat(block.connectivity[:, 0], block.connectivity.shape[1]) for block in mesh.blocks])
    graph = sparse.csr_array((np.ones(len(rows)), (rows, ends)), shape=(mesh.n_nodes, mesh.n_nodes))
    piece = connected_components(graph, directed=False)[1]
    lost = ~np.isin(piece, piece[measured])
    lost &= np.isin(np.arange(mesh.n_nodes), rows)
    return int(np.argmax(lost)) if lost.any() else None
