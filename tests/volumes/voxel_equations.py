"""The normal equations of a scan voxel by voxel, by SciPy: the slow twin of `idic.correlation`'s volume kernel.

    r(x) = f(x) - g(x + u(x)),   L_i = (F^-T grad f) . phi_i,   M = L^T L,   b = L^T r

docs/method.md, equations 1.2, 4.2 and 2.2 in three dimensions; F of each element in the middle of its cell.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import map_coordinates, spline_filter

from idic.fe import cell_type

ROUNDING = 1e-11  # voxels: a point that is found


@dataclass(frozen=True)
class VoxelEquations:
    """M (n, n), b (n,), r (n_voxels,) GV, L (n_voxels, n), valid (n_voxels,) bool."""

    M: np.ndarray
    b: np.ndarray
    r: np.ndarray
    L: np.ndarray
    valid: np.ndarray


def places_in(cell: str, corners: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Places in a cell of points, by Newton's method  # corners (n_nodes, 3), points (n, 3) -> (n, 3)"""
    places = np.full(points.shape, 0.25 if cell.startswith("tet") else 0.0)
    for _ in range(30):
        gap = points - cell_type(cell).shape_functions(places) @ corners
        if np.abs(gap).max() < ROUNDING:
            return places
        jacobian = np.einsum("nid,ic->ncd", cell_type(cell).shape_gradients(places), corners)
        places = places + np.linalg.solve(jacobian, gap[:, :, None])[:, :, 0]
    raise AssertionError(f"Newton's method ends {np.abs(gap).max()} voxels beside a point")


def voxel_equations(cell: str, nodes: np.ndarray, conn: np.ndarray, owner: np.ndarray, points: np.ndarray,
                    f: np.ndarray, g: np.ndarray, U: np.ndarray, dU: np.ndarray, degree: int = 3) -> VoxelEquations:
    """M and b of one scan.

    nodes : (n_nodes, 3) column, row, slice; owner : (n_voxels,) element of each of `points` (n_voxels, 3); f, g :
    (nz, ny, nx); U : (n_nodes, 3) and dU : (n_nodes, 3, n) voxels. Voxels that leave the volume take no part.
    """
    u, phi, F = np.zeros(points.shape), np.zeros((*points.shape, dU.shape[2])), np.zeros((*points.shape, 3))
    middle = np.full((1, 3), 0.25 if cell.startswith("tet") else 0.0)
    for e in np.unique(owner):
        at, corners = owner == e, nodes[conn[e]]
        N = cell_type(cell).shape_functions(places_in(cell, corners, points[at].astype(float)))
        u[at], phi[at] = N @ U[conn[e]], np.einsum("vi,icn->vcn", N, dU[conn[e]])
        slopes = cell_type(cell).shape_gradients(middle)[0]
        F[at] = np.eye(3) + (U[conn[e]].T @ slopes) @ np.linalg.inv(corners.T @ slopes)
    coefficients, still = spline_filter(f.astype(float), degree, mode="mirror"), points.T[::-1].astype(float)
    step = 1e-4
    gradient = np.array([(_value(coefficients, still, degree, d, step) - _value(coefficients, still, degree, d, -step))
                         / (2 * step) for d in (2, 1, 0)]).T
    moved = points + u
    valid = ((moved >= 0) & (moved <= np.array(f.shape)[::-1] - 1)).all(axis=1)
    values = map_coordinates(spline_filter(g.astype(float), degree, mode="mirror"), moved.T[::-1], order=degree,
                             prefilter=False, mode="mirror")
    r = np.where(valid, f[points[:, 2], points[:, 1], points[:, 0]] - values, 0.0)
    convected = np.linalg.solve(np.swapaxes(F, 1, 2), gradient[:, :, None])[:, :, 0]
    L = np.where(valid[:, None], np.einsum("vc,vcn->vn", convected, phi), 0.0)
    return VoxelEquations(L.T @ L, L.T @ r, r, L, valid)


def _value(coefficients: np.ndarray, points: np.ndarray, degree: int, axis: int, step: float) -> np.ndarray:
    shifted = points.copy()
    shifted[axis] += step
    return map_coordinates(coefficients, shifted, order=degree, prefilter=False, mode="mirror")
