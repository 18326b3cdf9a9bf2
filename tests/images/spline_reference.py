"""The B-spline of an image by SciPy in double precision: slow, and the reference for the compiled one.

The tests compare `idic.images.interpolate` with it; the equations written out pixel by pixel use it
(`tests/correlation/pixel_equations.py`). docs/method.md, equation 1.7.
"""

from __future__ import annotations

import numpy as np
import scipy


def spline_values(image: np.ndarray, points: np.ndarray, degree: int) -> np.ndarray:
    """Interpolated grey values; positions outside take the nearest edge.

    Parameters
    ----------
    image : array (ny, nx), GV
    points : array (n, 2)
        (column, row), px.
    degree : {3, 5}

    Returns
    -------
    array (n,), GV
    """
    return _at(_coefficients(image, degree), points, degree)


def spline_slopes(image: np.ndarray, points: np.ndarray, degree: int, step: float = 1e-4) -> np.ndarray:
    """Gradient of the spline by central differences; their error, about step^2, is far below float32.

    Arguments as in `spline_values`; step : px. Returns an array (n, 2): d/d(column), d/d(row) in GV/px.
    """
    coefficients = _coefficients(image, degree)
    slopes = np.empty((len(points), 2))
    for axis, shift in enumerate(step * np.eye(2)):
        forward, backward = (_at(coefficients, x, degree) for x in (points + shift, points - shift))
        slopes[:, axis] = (forward - backward) / (2 * step)
    return slopes


def inside(points: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """Which points (n, 2) (column, row) lie in an image of this shape (ny, nx)  # (n,) bool"""
    return np.all((points >= 0) & (points <= [shape[1] - 1, shape[0] - 1]), axis=1)


def _coefficients(image: np.ndarray, degree: int) -> np.ndarray:
    return scipy.ndimage.spline_filter(np.asarray(image, dtype=float), degree, mode="mirror")


def _at(coefficients: np.ndarray, points: np.ndarray, degree: int) -> np.ndarray:
    return scipy.ndimage.map_coordinates(coefficients, points[:, ::-1].T, order=degree, mode="mirror", prefilter=False)
