"""Square subsets with affine or quadratic shape functions: the reference that the free FE-DIC is compared with.

Gauss-Newton on zero-normalised squared differences, quintic splines, gradient of the reference image (Lu and Cary 2000,
doi:10.1007/BF02323101). No code is shared with the correlation of idic.
"""

from __future__ import annotations

import numba
import numpy as np
from scipy.ndimage import map_coordinates, spline_filter

MAX_STEPS, MIN_STEP_PX, DEGREE = 20, 1e-4, 5
_SLOPE_STEP_PX = 0.01


def subset_motion(reference: np.ndarray, image: np.ndarray, centres: np.ndarray, half: int,
                  quadratic: bool) -> np.ndarray:
    """Displacement of the centres of subsets of 2 half + 1 px  # (ny, nx) twice, (n, 2) column, row -> (n, 2) px"""
    spline = spline_filter(reference, DEGREE)
    row, column = np.mgrid[:reference.shape[0], :reference.shape[1]].astype(float)

    def value(dx: float, dy: float) -> np.ndarray:
        return map_coordinates(spline, [row + dy, column + dx], order=DEGREE, prefilter=False, mode="mirror")

    e = _SLOPE_STEP_PX
    slopes = np.stack([value(e, 0) - value(-e, 0), value(0, e) - value(0, -e)]) / (2 * e)
    return _matched(reference, slopes, spline_filter(image, DEGREE), centres, half, quadratic)


@numba.njit(cache=True, nogil=True)
def _weights(t: float, weights: np.ndarray) -> None:
    """Quintic B-spline at the six pixels around a place; t : its distance from the third one."""
    for k in range(6):
        x = abs(t - (k - 2))
        if x < 1:
            weights[k] = 11 / 20 - x**2 / 2 + x**4 / 4 - x**5 / 12
        elif x < 2:
            weights[k] = 17 / 40 + 5 * x / 8 - 7 * x**2 / 4 + 5 * x**3 / 4 - 3 * x**4 / 8 + x**5 / 24
        else:
            weights[k] = max(3 - x, 0.0) ** 5 / 120


@numba.njit(cache=True, nogil=True)
def _monomials(x: float, y: float, quadratic: bool, terms: np.ndarray) -> None:
    terms[0], terms[1], terms[2] = 1.0, x, y
    if quadratic:
        terms[3], terms[4], terms[5] = x * x, x * y, y * y


@numba.njit(cache=True, nogil=True)
def _matched(reference, slopes, spline, centres, half, quadratic):
    n_terms, side = 6 if quadratic else 3, 2 * half + 1
    jacobian, f, g = np.empty((side * side, 2 * n_terms)), np.empty(side * side), np.empty(side * side)
    along, down, terms = np.empty(6), np.empty(6), np.empty(n_terms)
    motion = np.zeros((len(centres), 2))
    for number in range(len(centres)):
        column, row = centres[number]
        for i in range(side * side):
            x, y = i % side - half, i // side - half
            _monomials(x / half, y / half, quadratic, terms)
            f[i] = reference[row + y, column + x]
            jacobian[i, :n_terms] = slopes[0, row + y, column + x] * terms
            jacobian[i, n_terms:] = slopes[1, row + y, column + x] * terms
        for k in range(2 * n_terms):
            jacobian[:, k] -= jacobian[:, k].mean()
        f -= f.mean()
        size = np.sqrt((f**2).sum())
        inverse, p = np.linalg.inv(jacobian.T @ jacobian), np.zeros(2 * n_terms)
        for _ in range(MAX_STEPS):
            for i in range(side * side):
                x, y = i % side - half, i // side - half
                _monomials(x / half, y / half, quadratic, terms)
                at_x, at_y = column + x + (p[:n_terms] * terms).sum(), row + y + (p[n_terms:] * terms).sum()
                first_x, first_y = int(np.floor(at_x)), int(np.floor(at_y))
                _weights(at_x - first_x, along)
                _weights(at_y - first_y, down)
                g[i] = 0.0
                for k in range(6):
                    for j in range(6):
                        g[i] += down[k] * along[j] * spline[first_y - 2 + k, first_x - 2 + j]
            g -= g.mean()
            step = inverse @ (jacobian.T @ (f - g * (size / np.sqrt((g**2).sum()))))
            p += step
            if step[0] ** 2 + step[n_terms] ** 2 < MIN_STEP_PX**2:
                break
        motion[number] = p[0], p[n_terms]
    return motion
