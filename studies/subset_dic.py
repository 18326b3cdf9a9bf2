"""A small subset DIC, to make measured fields from virtual images: the code of another system, not the one under test.

Square subsets deform affinely; zero-normalised squared differences are minimised by the inverse compositional
Gauss-Newton method on splines of SciPy (Baker and Matthews 2004, doi:10.1023/B:VISI.0000011205.11775.fd; Pan, Li
and Tong 2013, doi:10.1007/s11340-013-9717-6). It shares no code with the correlation of idic.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.ndimage import map_coordinates, spline_filter

MAX_STEPS, MIN_STEP_PX = 25, 1e-4
MIN_CORRELATION = 0.8  # of a subset that counts as found


def subset_grid(mask: np.ndarray, half: int, step: int) -> np.ndarray:
    """Centres (column, row) of subsets that lie wholly in the mask, `step` px apart  # (n, 2)"""
    ny, nx = mask.shape
    column, row = np.meshgrid(np.arange(half, nx - half, step), np.arange(half, ny - half, step))
    centres = np.column_stack([column.ravel(), row.ravel()])
    inside = [mask[r - half:r + half + 1, c - half:c + half + 1].all() for c, r in centres]
    return centres[inside]


def subset_displacements(images: Sequence[np.ndarray], centres: np.ndarray, half: int = 10,
                         order: int = 3) -> np.ndarray:
    """Displacement of the subsets since the first image  # (n_images, n, 2) px, NaN where a subset was not found

    Parameters
    ----------
    images : (ny, nx) each, the reference first; each one starts from the motion of the one before
    centres : (n, 2) column, row, integers
    half : subsets are 2 half + 1 px wide; order : of the splines between the pixels
    """
    y, x = (part.ravel().astype(float) for part in np.mgrid[-half:half + 1, -half:half + 1])
    reference = np.asarray(images[0], float)
    f, jacobian, hessian = _template(reference, centres, x, y, order)
    displacements = np.zeros((len(images), len(centres), 2))
    p = np.zeros((len(centres), 6))  # u, u_x, u_y, v, v_x, v_y
    for k, image in enumerate(images[1:], 1):
        spline = spline_filter(np.asarray(image, float), order)
        p, correlation = _match(spline, centres, x, y, f, jacobian, hessian, p, order)
        displacements[k] = np.where((correlation > MIN_CORRELATION)[:, None], p[:, [0, 3]], np.nan)
    return displacements


def _template(reference: np.ndarray, centres: np.ndarray, x: np.ndarray, y: np.ndarray, order: int):
    """Normalised subsets (n, m), their derivatives by the warp (n, m, 6), and J^T J (n, 6, 6)."""
    spline = spline_filter(reference, order)
    row, column = centres[:, 1, None] + y, centres[:, 0, None] + x
    f = map_coordinates(spline, [row, column], order=order, prefilter=False)
    e = 0.01  # px: the derivative of a spline is exact to e² over this step
    fx = (map_coordinates(spline, [row, column + e], order=order, prefilter=False)
          - map_coordinates(spline, [row, column - e], order=order, prefilter=False)) / (2 * e)
    fy = (map_coordinates(spline, [row + e, column], order=order, prefilter=False)
          - map_coordinates(spline, [row - e, column], order=order, prefilter=False)) / (2 * e)
    centred = f - f.mean(axis=1, keepdims=True)
    size = np.linalg.norm(centred, axis=1, keepdims=True)
    jacobian = np.stack([fx, fx * x, fx * y, fy, fy * x, fy * y], axis=2) / size[:, :, None]
    jacobian = jacobian - jacobian.mean(axis=1, keepdims=True)
    return centred / size, jacobian, np.einsum("nmi,nmj->nij", jacobian, jacobian)


def _match(spline, centres, x, y, f, jacobian, hessian, start, order):
    """Warp parameters (n, 6) and correlation coefficient (n,) of every subset in one image."""
    p, active = start.copy(), np.ones(len(centres), dtype=bool)
    correlation = np.zeros(len(centres))
    for _ in range(MAX_STEPS):
        q = p[active]
        column = centres[active, 0, None] + q[:, :1] + (1 + q[:, 1:2]) * x + q[:, 2:3] * y
        row = centres[active, 1, None] + q[:, 3:4] + q[:, 4:5] * x + (1 + q[:, 5:6]) * y
        g = map_coordinates(spline, [row, column], order=order, prefilter=False, mode="nearest")
        g = g - g.mean(axis=1, keepdims=True)
        g /= np.maximum(np.linalg.norm(g, axis=1, keepdims=True), 1e-12)
        correlation[active] = np.einsum("nm,nm->n", f[active], g)
        step = np.linalg.solve(hessian[active], np.einsum("nmi,nm->ni", jacobian[active], g - f[active])[:, :, None])
        p[active] = _composed(q, step[:, :, 0])
        still = np.linalg.norm(step[:, [0, 3], 0], axis=1) > MIN_STEP_PX
        active[np.flatnonzero(active)[~still]] = False
        if not active.any():
            break
    return p, correlation


def _composed(p: np.ndarray, step: np.ndarray) -> np.ndarray:
    """The warp p after the inverse of the warp `step`  # (n, 6)"""
    def matrix(q: np.ndarray) -> np.ndarray:
        homogeneous = np.tile(np.eye(3), (len(q), 1, 1))
        homogeneous[:, 0] += q[:, [1, 2, 0]]
        homogeneous[:, 1] += q[:, [4, 5, 3]]
        return homogeneous

    warp = matrix(p) @ np.linalg.inv(matrix(step)) - np.eye(3)
    return np.column_stack([warp[:, 0, 2], warp[:, 0, 0], warp[:, 0, 1], warp[:, 1, 2], warp[:, 1, 0], warp[:, 1, 1]])
