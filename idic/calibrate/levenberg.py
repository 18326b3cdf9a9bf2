"""Least squares by Levenberg and Marquardt on the normal equations.

A target with free points has hundreds of unknowns: a Cholesky factor of J^T J costs a tenth of the singular value
decomposition of J that scipy.optimize.least_squares takes. K. Levenberg (1944), D. W. Marquardt (1963).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from idic.errors import NotConverged

MAX_STEPS = 100
FIRST_DAMPING, LEAST_DAMPING, MOST_DAMPING = 1e-3, 1e-9, 1e10  # of the diagonal of J^T J
FLOOR = 1e-24  # px² per equation: rounding


def minimum(distances: Callable[[np.ndarray], np.ndarray],
            normal_equations: Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]], n_unknowns: int,
            tolerance: float) -> np.ndarray:
    """The unknowns, from zero, with the smallest sum of squared distances  # (n_unknowns,)

    Parameters
    ----------
    distances : callable
        Unknowns (n,) to distances (m,), infinite where they cannot be.
    normal_equations : callable
        Unknowns (n,) and the distances there (m,) to J^T J (n, n) and J^T distances (n,), J the derivatives of the
        distances.
    tolerance : float
        It ends where an undamped step promises less than this share of the sum of squares.

    Raises
    ------
    NotConverged
        It does not settle.
    """
    unknowns, damping = np.zeros(n_unknowns), FIRST_DAMPING
    errors = distances(unknowns)
    for _ in range(MAX_STEPS):
        cost = float(errors @ errors)
        normal, gradient = normal_equations(unknowns, errors)
        diagonal = np.maximum(np.diag(normal), 1e-300)
        while True:
            step = _solve(normal, diagonal, damping, gradient)
            if step is not None:
                promised = float(gradient @ step)
                trial = distances(unknowns - step)
                if np.isfinite(trial).all() and trial @ trial <= cost:
                    break
                if promised <= tolerance * cost + FLOOR * len(errors):
                    return unknowns
            damping *= 10.0
            if damping > MOST_DAMPING:
                raise NotConverged("no step of the bundle adjustment reduces the residual; free fewer values of the "
                                   "lens (--free)")
        unknowns, errors, damping = unknowns - step, trial, max(damping / 10.0, LEAST_DAMPING)
        if promised <= tolerance * cost + FLOOR * len(errors) and damping < FIRST_DAMPING:
            return unknowns
    raise NotConverged(f"the bundle adjustment does not converge in {MAX_STEPS} steps; the views hardly determine "
                       f"its unknowns: take more views with more tilt, or free fewer values of the lens (--free)")


def _solve(normal, diagonal, damping, gradient):
    scale = 1.0 / np.sqrt(diagonal)
    scaled = normal * scale[:, None] * scale
    scaled[np.diag_indices_from(scaled)] += damping
    try:
        return scale * cho_solve(cho_factor(scaled, check_finite=False), scale * gradient, check_finite=False)
    except LinAlgError:
        return None
