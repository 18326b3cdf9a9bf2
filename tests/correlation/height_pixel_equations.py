"""The equation for height images, to read: residual, M and b of one frame, pixel by pixel.

    r(x)  = f(x) + h(x) - g(x + u(x))                          docs/method.md, equation 9.1
    L phi = F^-T (grad f + grad h) . phi_xy - phi_h            docs/method.md, equation 9.2

with the simulated rise h, positive upwards (Neggers et al. 2015, equation 22). The identification computes the same M
and b from sums over elements (`idic.correlation.height.surface`); the tests compare the two.
"""

from __future__ import annotations

import numpy as np

from correlation.pixel_equations import PixelEquations
from idic.correlation import PixelMap
from images.spline_reference import inside, spline_slopes, spline_values


def height_normal_equations(pixel_map: PixelMap, f: np.ndarray, g: np.ndarray, motion: np.ndarray, d_motion: np.ndarray,
                     degree: int = 3, gaps: np.ndarray | None = None) -> PixelEquations:
    """M and b of one height image.

    Parameters
    ----------
    f, g : arrays (ny, nx)
        Reference and frame, unit of height, without gaps.
    motion : array (n_nodes, 3)
        Displacement (px, px) and rise (unit of height).
    d_motion : array (n_nodes, 3, n)
        Its derivatives, per unit of the parameter.
    degree : {3, 5}
        Of the spline.
    gaps : array (ny, nx), bool, optional
        Pixels of the frame without a value: a position is left out where its taps reach one.
    """
    x = pixel_map.points()  # (n_pixels, 2)
    moved = x + pixel_map.interpolate(motion[:, :2])
    valid = inside(moved, pixel_map.shape)
    if gaps is not None:
        valid &= ~_taps_touch(gaps, moved, degree)
    h = pixel_map.interpolate(motion[:, 2])
    r = np.where(valid, spline_values(f, x, degree) + h - spline_values(g, moved, degree), 0.0)

    number = pixel_map.pixels_per_element
    F = np.repeat(pixel_map.deformation_gradient(motion[:, :2]), number, axis=0)  # (n_pixels, 2, 2)
    as_first = np.column_stack([motion[:, 2], np.zeros(len(motion))])  # a field whose first gradient row is grad h
    grad_h = np.repeat(pixel_map.deformation_gradient(as_first) - np.eye(2), number, axis=0)[:, 0]
    slope = spline_slopes(f, x, degree) + grad_h  # (n_pixels, 2)
    slope = np.linalg.solve(np.swapaxes(F, 1, 2), slope[:, :, None])[:, :, 0]
    phi = pixel_map.interpolate(d_motion.reshape(len(d_motion), -1)).reshape(len(x), 3, -1)  # (n_pixels, 3, n)
    L = np.where(valid[:, None], np.einsum("xc,xci->xi", slope, phi[:, :2]) - phi[:, 2], 0.0)
    return PixelEquations(M=L.T @ L, b=L.T @ r, r=r, L=L, valid=valid)


def _taps_touch(gaps: np.ndarray, points: np.ndarray, degree: int) -> np.ndarray:
    """Whether one of the (degree + 1)^2 taps of a point is a gap  # gaps (ny, nx), points (n, 2) -> (n,) bool"""
    ny, nx = gaps.shape
    first = np.floor(points).astype(int) - (degree - 1) // 2
    hit = np.zeros(len(points), dtype=bool)
    for i in range(degree + 1):
        for j in range(degree + 1):
            column, row = first[:, 0] + i, first[:, 1] + j
            known = (column >= 0) & (column < nx) & (row >= 0) & (row < ny)
            hit[known] |= gaps[row[known], column[known]]
    return hit
