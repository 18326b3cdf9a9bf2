"""Smoothness of a motion on a surface in space, flat or curved: second differences over the neighbours of every node.

    D U at node i = sqrt(A_i) times the surface Laplacian of each component, made zero for every affine motion

A_i is the area of the node. The Laplacian comes from the faces, sum_f int grad N_a . grad N_i / A_i; what it makes of
an affine motion on a curved surface, or at an edge, is taken off by the smallest change of its coefficients: rigid
motion and even strain pass unchanged. Of waves of length lambda the part 1/(1 + (l/lambda)^4) passes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import sparse

from idic.correlation import CELLS, N_NODES
from idic.fe import cell_type


@dataclass(frozen=True, eq=False)
class SurfaceSmoother:
    """nodes : (n,) of the mesh; operator : (n, n) D of one component; area_mm2 : of all faces; length_mm : l"""

    nodes: np.ndarray
    operator: sparse.csr_array
    area_mm2: float
    length_mm: float

    def penalty(self, information: sparse.csc_array) -> sparse.csc_array:
        """w D^T D for three components, w from the information per area  # (3 n, 3 n)"""
        shifts = np.tile(np.eye(3), (len(self.nodes), 1))  # of the whole surface along each axis
        weight = np.diag(shifts.T @ (information @ shifts)) / self.area_mm2 * (self.length_mm / (2.0 * np.pi)) ** 4
        return sparse.kron((self.operator.T @ self.operator), sparse.diags_array(weight), format="csc")


def surface_smoother(points: np.ndarray, cells: Sequence[tuple[np.ndarray, np.ndarray]],
                     length_mm: float | None = None) -> SurfaceSmoother:
    """The smoother on the faces that any camera sees.

    points : (n_nodes, 3) mm; cells : per camera the faces, nodes (n, 8) and kinds (n,) of `PixelMap`; length_mm : None:
    twice the distance of the nodes
    """
    conn, kind = np.concatenate([c for c, _ in cells]), np.concatenate([k for _, k in cells])
    _, first = np.unique(np.column_stack([conn, kind]), axis=0, return_index=True)
    conn, kind = conn[first], kind[first]
    used = np.unique(np.concatenate([conn[kind == k, :N_NODES[k]].ravel() for k in np.unique(kind)]))
    number = np.full(len(points), -1)
    number[used] = np.arange(len(used))
    x, n = points[used], len(used)
    laplacian, area, edges = sparse.csr_array((n, n)), np.zeros(n), []
    for k in np.unique(kind):
        faces = number[conn[kind == k, :N_NODES[k]]]
        stiffness, node_areas = _face_matrices(CELLS[k], x[faces])
        i, j = np.broadcast_arrays(faces[:, :, None], faces[:, None, :])
        laplacian = laplacian + sparse.coo_array((stiffness.ravel(), (i.ravel(), j.ravel())), shape=(n, n)).tocsr()
        np.add.at(area, faces, node_areas)
        corners = faces[:, :3 if k % 2 == 0 else 4]
        lengths = np.linalg.norm(x[corners] - x[np.roll(corners, -1, axis=1)], axis=2).ravel()
        edges.append(lengths / (1 if N_NODES[k] == corners.shape[1] else 2))
    distance = float(np.median(np.concatenate(edges)))
    length = 2.0 * distance if length_mm is None else float(length_mm)
    return SurfaceSmoother(used, _without_affine(laplacian, x, area), float(area.sum()), length)


def _face_matrices(cell: str, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """int grad N_a . grad N_b over each face in space, and its area by nodes  # (n, nn, 3) -> (n, nn, nn), (n, nn)"""
    xi, w = cell_type(cell).quadrature_rule()
    slopes, shape = cell_type(cell).shape_gradients(xi), cell_type(cell).shape_functions(xi)
    tangent = np.einsum("eac,qai->eqci", x, slopes)  # (n, q, 3, 2)
    metric = np.einsum("eqci,eqcj->eqij", tangent, tangent)
    area = np.sqrt(np.linalg.det(metric)) * w
    stiffness = np.einsum("eq,qai,eqij,qbj->eab", area, slopes, np.linalg.inv(metric), slopes)
    mass = np.einsum("eq,qa->ea", area, shape**2)
    return stiffness, mass / mass.sum(axis=1, keepdims=True) * area.sum(axis=1)[:, None]


def _without_affine(laplacian: sparse.csr_array, x: np.ndarray, area: np.ndarray) -> sparse.csr_array:
    """Rows over the square root of the nodal area, zero for 1, x, y, z by the smallest change of their coefficients."""
    data = np.empty_like(laplacian.data)
    for i in range(len(x)):
        row = slice(laplacian.indptr[i], laplacian.indptr[i + 1])
        around = laplacian.indices[row]
        offset = x[around] - x[i]
        affine = np.column_stack([np.ones(len(around)), offset / max(np.abs(offset).max(initial=0.0), 1e-300)])
        c = laplacian.data[row] / np.sqrt(area[i])
        data[row] = c - affine @ np.linalg.lstsq(affine, c, rcond=1e-6)[0]
    return sparse.csr_array((data, laplacian.indices, laplacian.indptr), shape=laplacian.shape)
