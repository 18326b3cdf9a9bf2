"""A speckle that fills space: the grey value of any material point of any surface, alike for all cameras.

The dots of `idic.images.pattern` as balls on a jittered grid of cells; what a surface shows is its section.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np

from idic.images import DOT_RADIUS

PERIOD_CELLS = 64  # the pattern repeats after so many cells along each axis
DENSITY = 1.0 / 1.5**2  # balls per sigma³
GAIN = 0.5


@dataclass(frozen=True, eq=False)
class SolidSpeckle:
    """A periodic field of round balls.

    balls : (n, n, n, n_balls, 4) place in the cell (0 … 1) and amplitude; cell_mm : edge of a cell, the radius of the
    balls; low, high : grey values that the texture approaches
    """

    balls: np.ndarray
    cell_mm: float
    low: float
    high: float

    def value(self, points_mm: np.ndarray) -> np.ndarray:
        """Grey values of material points  # (n, 3) mm -> (n,)"""
        out = np.empty(len(points_mm))
        _evaluate(np.ascontiguousarray(points_mm, dtype=np.float64), self.balls, self.cell_mm, GAIN, out)
        return self.low + (self.high - self.low) * out

    @classmethod
    def drawn(cls, rng: np.random.Generator, sigma_mm: float, low: float = 20.0,
              high: float = 235.0) -> SolidSpeckle:
        """A dense speckle whose autocorrelation on a surface is close to exp(-d²/(4 sigma²))."""
        n_balls = max(1, round(DENSITY * DOT_RADIUS**3 / 10.0))
        balls = rng.random((*[PERIOD_CELLS] * 3, n_balls, 4), dtype=np.float32)
        balls[..., 3] = np.sqrt(10.0) * rng.standard_normal(balls.shape[:4], dtype=np.float32)
        return cls(balls, DOT_RADIUS * sigma_mm, float(low), float(high))


@numba.njit(cache=True, nogil=True)
def _evaluate(points, balls, cell, gain, out):
    n, n_balls = balls.shape[0], balls.shape[3]
    for p in range(points.shape[0]):
        x, y, z = points[p, 0] / cell, points[p, 1] / cell, points[p, 2] / cell
        i0, j0, k0 = int(np.floor(x)), int(np.floor(y)), int(np.floor(z))
        total = 0.0
        for i in range(i0 - 1, i0 + 2):
            for j in range(j0 - 1, j0 + 2):
                for k in range(k0 - 1, k0 + 2):
                    cell_balls = balls[i % n, j % n, k % n]
                    for m in range(n_balls):
                        dx, dy, dz = x - i - cell_balls[m, 0], y - j - cell_balls[m, 1], z - k - cell_balls[m, 2]
                        q = 1.0 - dx * dx - dy * dy - dz * dz
                        if q > 0.0:
                            q = q * q
                            total += cell_balls[m, 3] * q * q
        out[p] = 0.5 * (1.0 + np.tanh(gain * total))
