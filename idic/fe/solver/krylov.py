"""Solutions by the factor of a similar matrix: generalised conjugate residuals, preconditioned with it.

Large solids: a factorisation costs as much as tens of solutions with it. The factor is that of the symmetric part of
the tangent, or of the tangent of an earlier iteration, which is near the present one, except where points have begun to
flow. A few iterations (Eisenstat, Elman and Schultz, 1983, doi:10.1137/0720023) give Newton's correction to within
`TOLERANCE`, and his method converges as before; more of them give the solution to within rounding.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

# residual of the linear system over its right-hand side; a smaller one saves no iteration of Newton's method
TOLERANCE = 1e-2
MAX_ITERATIONS = 16  # a factorisation costs more
MAX_GAIN = 0.8  # of the residual per iteration, over the last three: slower is not worth going on

EXACT = 1e-12  # residual over right-hand side of a solution that counts as exact
ROUNDING = 5e-16  # or residual over the size of the terms: what a direct solver leaves
MAX_COLUMNS = 16  # right-hand sides at a time: their directions are all kept


@dataclass(frozen=True)
class Iterated:
    """x (n, m); gain : mean factor of the largest residual per iteration"""

    x: np.ndarray
    gain: float


def iterate(matrix, approximate: Callable[[np.ndarray], np.ndarray], rhs: np.ndarray, tolerance: float,
            rounding: float = 0.0) -> Iterated | None:
    """Solutions of ``matrix x = rhs`` (n, m), or None where the iterations are too slow.

    Parameters
    ----------
    matrix : sparse (n, n)
    approximate : solutions (n, m) with a similar matrix
    tolerance : residual of every column over its right-hand side
    rounding : or over the size of the terms of the product
    """
    x, residual = np.zeros_like(rhs), rhs.copy()
    directions: list[np.ndarray] = []
    images: list[np.ndarray] = []
    begin = np.linalg.norm(rhs, axis=0)
    if not np.isfinite(begin).all():
        return None
    largest = float(abs(matrix).sum(axis=1).max()) if rounding else 0.0
    over, worst = np.where(begin > 0.0, begin, 1.0), [1.0]
    while True:
        norms = np.linalg.norm(residual, axis=0)
        if (norms <= tolerance * begin + rounding * largest * np.linalg.norm(x, axis=0)).all():
            return Iterated(x, worst[-1] ** (1.0 / max(1, len(worst) - 1)))
        k = len(images)
        if k == MAX_ITERATIONS or (k >= 3 and worst[-1] > MAX_GAIN**3 * worst[-4]):
            return None
        direction = approximate(residual)
        image = matrix @ direction
        for earlier, its_image in zip(directions, images, strict=True):
            share = np.einsum("nm,nm->m", its_image, image)
            image -= share * its_image
            direction -= share * earlier
        size = np.linalg.norm(image, axis=0)
        if not (np.isfinite(size).all() and (size[norms > 0.0] > 0.0).all()):
            return None
        size[size == 0.0] = 1.0  # a right-hand side of zeros
        directions.append(direction / size)
        images.append(image / size)
        step = np.einsum("nm,nm->m", images[-1], residual)
        x += step * directions[-1]
        residual -= step * images[-1]
        worst.append(float((np.linalg.norm(residual, axis=0) / over).max()))


def correction(matrix, factor, rhs: np.ndarray) -> Iterated | None:
    """Newton's correction, x (n,), by an earlier `Factor`; None where the iterations are too slow."""
    outcome = iterate(matrix, factor.approximate, rhs[:, None], TOLERANCE)
    return None if outcome is None else Iterated(outcome.x[:, 0], outcome.gain)


def solution(matrix, approximate: Callable[[np.ndarray], np.ndarray], rhs: np.ndarray) -> np.ndarray | None:
    """Solutions (n, m) to within rounding; None where the iterations are too slow."""
    x = np.empty_like(rhs)
    for first in range(0, rhs.shape[1], MAX_COLUMNS):
        part = slice(first, first + MAX_COLUMNS)
        outcome = iterate(matrix, approximate, rhs[:, part], EXACT, ROUNDING)
        if outcome is None:
            return None
        x[:, part] = outcome.x
    return x
