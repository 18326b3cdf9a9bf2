"""The normal equations of integrated DIC, written to be read: residual, M and b of one frame, pixel by pixel.

    r(x) = f(x) - g(x + u(x))                   equation 10 of the paper    docs/method.md, equation 1.2
           f + sum_m w_m f_m, u + its shift     of low-passed images        docs/method.md, equations 1.10, 1.12
    L_i  = (F^-T grad f) . phi_i                F = I + grad u              docs/method.md, equation 4.2
    M_ij = sum_x L_i L_j                        equation 6                  docs/method.md, equation 2.2
    b_i  = sum_x L_i r                          equation 7                  docs/method.md, equation 2.3

The frames add, and M dlam = b is the step of the parameters. At small strain F^-T grad f is the grad f of the paper
(Neggers, Hoefnagels, Geers, Hild, Roux, Int. J. Numer. Meth. Engng, 2015).

This module holds a row of L for every pixel. The identification computes the same M and b without L
(`idic.correlation.nodal_equations`). The tests compare the two.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from idic.correlation import PixelMap
from idic.images import (
    PIXEL_BLUR_PX, derivative_maps, fineness_of, matching_weights, mean_shift,
)
from images.spline_reference import inside, spline_slopes, spline_values


@dataclass(frozen=True, eq=False)
class PixelEquations:
    """M (n, n), b (n,), r (n_pixels,) GV, L (n_pixels, n) GV per unit of lam, valid (n_pixels,) bool."""

    M: np.ndarray
    b: np.ndarray
    r: np.ndarray
    L: np.ndarray
    valid: np.ndarray


def normal_equations(pixel_map: PixelMap, f: np.ndarray, g: np.ndarray, U: np.ndarray, dU: np.ndarray,
                     degree: int = 3, lowpass_px: float = 0.0, camera_blur_px: float = PIXEL_BLUR_PX) -> PixelEquations:
    """M and b of one frame.

    f, g : (ny, nx) reference image and frame, GV; U : (n_nodes, 2) displacement of the nodes, px; dU : (n_nodes, 2, n)
    its derivatives, px per unit of lam; degree : of the spline; lowpass_px : of f and g, which are blurred already;
    camera_blur_px : the camera's own blur. Pixels that leave the image take no part.
    """
    x = pixel_map.points()  # (n_pixels, 2): column, row
    u = pixel_map.interpolate(U)  # (n_pixels, 2)
    phi = pixel_map.interpolate(dU.reshape(len(dU), -1)).reshape(len(x), 2, -1)  # (n_pixels, 2, n)
    F = np.repeat(pixel_map.deformation_gradient(U), pixel_map.pixels_per_element, axis=0)  # (n_pixels, 2, 2)
    still = spline_values(f, x, degree)
    if lowpass_px > 0:
        u = u + lowpass_shift(pixel_map, U, F, f, lowpass_px, camera_blur_px)  # (n_pixels, 2)
        weights = matching_weights(np.linalg.inv(F), lowpass_px, camera_blur_px)  # (n_pixels, 8)
        still = still + np.einsum("xm,mx->x", weights, derivative_maps(f, pixel_map.ix, pixel_map.iy))
    valid = inside(x + u, pixel_map.shape)
    r = np.where(valid, still - spline_values(g, x + u, degree), 0.0)
    grad_g = np.linalg.solve(np.swapaxes(F, 1, 2), spline_slopes(f, x, degree)[:, :, None])[:, :, 0]  # F^-T grad f
    L = np.where(valid[:, None], np.einsum("xc,xci->xi", grad_g, phi), 0.0)
    return PixelEquations(M=L.T @ L, b=L.T @ r, r=r, L=L, valid=valid)


def lowpass_shift(pixel_map: PixelMap, U: np.ndarray, F: np.ndarray, f: np.ndarray, lowpass_px: float,
                  camera_blur_px: float) -> np.ndarray:
    """By how much a low-pass displaces the pattern at every pixel, docs/method.md, equation 1.12  # (n_pixels, 2) px

    F : (n_pixels, 2, 2) deformation gradient
    """
    inverse = np.linalg.inv(F[pixel_map.start[:-1]])  # of the elements
    curvature = pixel_map.element_curvature(pixel_map.element_coefficients(U), inverse)
    shift = mean_shift(curvature, fineness_of(f, pixel_map.ix, pixel_map.iy), lowpass_px, camera_blur_px)
    return np.repeat(shift, pixel_map.pixels_per_element, axis=0)
