"""Eqs 6, 7 and 10 of the paper as they are printed, pixel by pixel: slow, memory-hungry, readable.

Of the compiled route only the pixel map is used: SciPy's spline in double precision, one deformation gradient per
element, one row of L per pixel. The tests compare `idic.correlation.frame` with it. Source: Neggers, Hoefnagels, Geers,
Hild, Roux, Time-resolved integrated digital image correlation, Int. J. Numer. Meth. Engng (2015).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from idic.correlation.pixel_map import PixelMap


@dataclass(frozen=True, eq=False)
class PixelwiseSystem:
    """One frame: M (n, n), b (n,), residual r (n_pixels,), columns L (n_pixels, n), valid (n_pixels,) bool."""

    M: np.ndarray
    b: np.ndarray
    r: np.ndarray
    L: np.ndarray
    valid: np.ndarray


def pixelwise_system(pixel_map: PixelMap, f_image: np.ndarray, g_image: np.ndarray, u_px: np.ndarray,
                     phi_px: np.ndarray, degree: int = 3) -> PixelwiseSystem:
    """M and b of one frame from pixel-sized sensitivity fields.

    Parameters
    ----------
    f_image, g_image : arrays (ny, nx), GV
    u_px : array (n_nodes, 2), px
    phi_px : array (n_nodes, 2, n), px per unit of the parameter
    """
    x = pixel_map.points()  # (n_pixels, 2)
    moved = x + pixel_map.interpolate(u_px)
    ny, nx = pixel_map.shape
    valid = ((moved >= 0) & (moved <= [nx - 1, ny - 1])).all(axis=1)
    r = np.where(valid, spline_values(f_image, x, degree) - spline_values(g_image, moved, degree), 0.0)
    deformation = np.repeat(pixel_map.deformation_gradient(u_px), pixel_map.pixels_per_element, axis=0)
    slope = np.linalg.solve(np.swapaxes(deformation, 1, 2), spline_slopes(f_image, x, degree)[:, :, None])[:, :, 0]
    phi = pixel_map.interpolate(phi_px.reshape(len(phi_px), -1)).reshape(len(x), 2, -1)  # (n_pixels, 2, n)
    L = np.where(valid[:, None], np.einsum("pc,pcn->pn", slope, phi), 0.0)
    return PixelwiseSystem(L.T @ L, L.T @ r, r, L, valid)


def pixelwise_heights(pixel_map: PixelMap, f_image: np.ndarray, g_image: np.ndarray, motion: np.ndarray,
                      phi: np.ndarray, degree: int = 3, blind: np.ndarray | None = None) -> PixelwiseSystem:
    """M and b of one height image (Eq. 22, u_z positive upwards) from pixel-sized sensitivity fields.

    Parameters
    ----------
    f_image, g_image : arrays (ny, nx), height, without gaps
    motion : array (n_nodes, 3), px, px, height
    phi : array (n_nodes, 3, n), per unit of the parameter
    blind : array (ny, nx), bool, optional
        Gaps of the frame: a pixel is left out where its taps reach one.
    """
    x = pixel_map.points()  # (n_pixels, 2)
    moved = x + pixel_map.interpolate(motion[:, :2])
    ny, nx = pixel_map.shape
    valid = ((moved >= 0) & (moved <= [nx - 1, ny - 1])).all(axis=1)
    if blind is not None:
        valid &= ~_taps_touch(blind, moved, degree)
    rise = pixel_map.interpolate(motion[:, 2])
    r = np.where(valid, spline_values(f_image, x, degree) + rise - spline_values(g_image, moved, degree), 0.0)
    number = pixel_map.pixels_per_element
    deformation = np.repeat(pixel_map.deformation_gradient(motion[:, :2]), number, axis=0)
    as_first = np.column_stack([motion[:, 2], np.zeros(len(motion))])  # a field whose first gradient row is grad h
    steepness = np.repeat(pixel_map.deformation_gradient(as_first) - np.eye(2), number, axis=0)[:, 0]
    slope = spline_slopes(f_image, x, degree) + steepness  # grad f + grad h, (n_pixels, 2)
    slope = np.linalg.solve(np.swapaxes(deformation, 1, 2), slope[:, :, None])[:, :, 0]
    fields = pixel_map.interpolate(phi.reshape(len(phi), -1)).reshape(len(x), 3, -1)  # (n_pixels, 3, n)
    L = np.einsum("pc,pcn->pn", slope, fields[:, :2]) - fields[:, 2]
    L = np.where(valid[:, None], L, 0.0)
    return PixelwiseSystem(L.T @ L, L.T @ r, r, L, valid)


def _taps_touch(gaps: np.ndarray, points: np.ndarray, degree: int) -> np.ndarray:
    """Whether one of the (degree + 1)^2 taps of a point is a gap  # gaps (ny, nx), points (n, 2) -> (n,) bool"""
    ny, nx = gaps.shape
    first = np.floor(points).astype(int) - (degree - 1) // 2
    hit = np.zeros(len(points), dtype=bool)
    for i in range(degree + 1):
        for j in range(degree + 1):
            column, row = first[:, 0] + i, first[:, 1] + j
            inside = (column >= 0) & (column < nx) & (row >= 0) & (row < ny)
            hit[inside] |= gaps[row[inside], column[inside]]
    return hit


def brightness_columns(f_image: np.ndarray, pixel_map: PixelMap, patch: np.ndarray, mean: np.ndarray,
                       valid: np.ndarray) -> np.ndarray:
    """Columns (-(f - mean), -1) of every patch  # patch (n_pixels,), mean (n_patches,) -> (n_pixels, 2 n_patches)"""
    columns = np.zeros((pixel_map.n_pixels, 2 * len(mean)))
    every = np.arange(pixel_map.n_pixels)
    columns[every, 2 * patch] = -(f_image[pixel_map.iy, pixel_map.ix] - mean[patch])
    columns[every, 2 * patch + 1] = -1.0
    return columns * valid[:, None]


def spline_values(image: np.ndarray, points: np.ndarray, degree: int) -> np.ndarray:
    """Interpolated grey values; positions outside take the nearest edge  # points (n, 2) (column, row) -> (n,)"""
    coefficients = ndimage.spline_filter(np.asarray(image, dtype=float), degree, mode="mirror")
    return ndimage.map_coordinates(coefficients, points[:, ::-1].T, order=degree, mode="mirror", prefilter=False)


def spline_slopes(image: np.ndarray, points: np.ndarray, degree: int, step: float = 1e-4) -> np.ndarray:
    """Gradient of the spline by central differences (its error ~ step^2 is far below float32)  # (n, 2)"""
    coefficients = ndimage.spline_filter(np.asarray(image, dtype=float), degree, mode="mirror")
    slopes = np.empty((len(points), 2))
    for axis in range(2):
        shift = np.zeros(2)
        shift[axis] = step
        ahead, behind = (
            ndimage.map_coordinates(coefficients, x[:, ::-1].T, order=degree, mode="mirror", prefilter=False)
            for x in (points + shift, points - shift)
        )
        slopes[:, axis] = (ahead - behind) / (2 * step)
    return slopes
