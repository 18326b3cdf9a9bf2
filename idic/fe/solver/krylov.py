"""Newton corrections without a new factorisation: generalised conjugate residuals, preconditioned with an old factor.

Large solids: a factorisation costs as much as tens of solutions with it. The tangent of an earlier iteration is near
the present one, except where points have begun to flow. A few iterations (Eisenstat, Elman and Schultz, 1983,
doi:10.1137/0720023) give the correction of the present tangent to within `TOLERANCE`; Newton's method converges as
before.
"""

from __future__ import annotations

import numpy as np

from idic.fe.solver.linear import Factor

# residual of the linear system over its right-hand side; a smaller one saves no iteration of Newton's method
TOLERANCE = 1e-2
MAX_ITERATIONS = 16  # a factorisation costs more
MAX_GAIN = 0.8  # of the residual per iteration, over the last three: slower is not worth going on


def correction(matrix, factor: Factor, rhs: np.ndarray) -> np.ndarray | None:
    """Solution (n,) of ``matrix x = rhs``, or None where the iterations are too slow.

    Parameters
    ----------
    matrix : sparse (n, n)
    factor : of a similar matrix
    """
    x, residual = np.zeros_like(rhs), rhs.copy()
    directions: list[np.ndarray] = []
    images: list[np.ndarray] = []
    norms = [float(np.linalg.norm(rhs))]
    if not np.isfinite(norms[0]):
        return None
    while norms[-1] > TOLERANCE * norms[0]:
        k = len(images)
        if k == MAX_ITERATIONS or (k >= 3 and norms[-1] > MAX_GAIN**3 * norms[-4]):
            return None
        direction = factor.solve(residual)
        image = matrix @ direction
        for earlier, its_image in zip(directions, images, strict=True):
            share = float(its_image @ image)
            image -= share * its_image
            direction -= share * earlier
        size = float(np.linalg.norm(image))
        if not 0.0 < size < np.inf:
            return None
        directions.append(direction / size)
        images.append(image / size)
        step = float(images[-1] @ residual)
        x += step * directions[-1]
        residual -= step * images[-1]
        norms.append(float(np.linalg.norm(residual)))
    return x
