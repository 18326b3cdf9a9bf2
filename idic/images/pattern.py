"""Analytic speckle: grey values of a painted surface at arbitrary material points, for virtual experiments.

The texture is a sum of smooth round dots ``(1 - r²/R²)^4`` on a jittered cell grid, passed through a bounded
non-linearity, so its value anywhere is exact and no stored image is ever interpolated. It repeats itself only after
``period_px``. Nothing here is used by the correlator.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np

DOT_RADIUS = np.sqrt(12.0)  # R / sigma: the dot then has the second moment of a Gaussian of that sigma


@dataclass(frozen=True)
class Pattern:
    """A periodic field of round dots; make one with :func:`dense_speckle` or :func:`sparse_speckle`.

    Attributes
    ----------
    dots : (n_cells, n_cells, n_dots, 3) float64
        Column and row of each dot relative to its cell (in cells, 0…1) and its amplitude.
    cell_px : float
        Size of a cell = radius R of the dots, so a point sees the dots of 3 x 3 cells only.
    low, high : float
        Grey values that the texture approaches and never leaves.
    gain : float
        Slope of the non-linearity.
    inked : bool
        True: dark dots on bright paint, ``low + (high-low) exp(-gain s)``; False: ``(1 + tanh(gain s))/2``.
    """

    dots: np.ndarray
    cell_px: float
    low: float
    high: float
    gain: float
    inked: bool

    @property
    def period_px(self) -> float:
        return self.dots.shape[0] * self.cell_px

    def value(self, points_px: np.ndarray) -> np.ndarray:
        """Grey values at material points given in px of the unloaded surface.  (n, 2) → (n,)"""
        points = np.ascontiguousarray(points_px, dtype=np.float64)
        out = np.empty(len(points))
        _evaluate(points, self.dots, self.cell_px, self.gain, self.inked, out)
        return self.low + (self.high - self.low) * out


def dense_speckle(
    rng: np.random.Generator, sigma_px: float = 1.2, low: float = 20.0, high: float = 235.0, extent_px: float = 2000.0
) -> Pattern:
    """A dense random speckle without bare patches (dots of either sign, about one per (1.5 sigma)²).

    ``sigma_px`` sets the speckle size: the autocorrelation is close to ``exp(-d²/(4 sigma²))``, i.e. 0.5 at 2 px for
    1.2 px (medium speckle) and 0.2 for 0.78 px (fine speckle).
    """
    return _make(rng, sigma_px, low, high, extent_px, density=1.0 / 1.5**2, gain=0.5, inked=False)


def sparse_speckle(
    rng: np.random.Generator, sigma_px: float = 1.8, low: float = 25.0, high: float = 220.0, extent_px: float = 2000.0
) -> Pattern:
    """Black dots sprayed on white paint: bare patches between them, as from a careless spray can."""
    return _make(rng, sigma_px, low, high, extent_px, density=1.0 / 4.0**2, gain=2.5, inked=True)


def _make(rng, sigma_px, low, high, extent_px, density, gain, inked) -> Pattern:
    cell = DOT_RADIUS * sigma_px
    n_cells = max(3, int(np.ceil(extent_px / cell)))
    n_dots = max(1, round(density * DOT_RADIUS**2))
    dots = rng.random((n_cells, n_cells, n_dots, 3))  # (n_cells, n_cells, n_dots, 3)
    if inked:
        dots[..., 2] = 0.5 + 0.5 * dots[..., 2]
        dots[..., 2] *= rng.random(dots.shape[:3]) < density * DOT_RADIUS**2 / n_dots
    else:
        dots[..., 2] = rng.standard_normal(dots.shape[:3])
    return Pattern(dots, cell, float(low), float(high), float(gain), inked)


@numba.njit(cache=True, nogil=True)
def _evaluate(points, dots, cell, gain, inked, out):
    nearby_dots = np.empty((5, 9
                            * dots.shape[2]))  # dots of 3 x 3 cells: column and row of the cell, place in it, amplitude
    terms = np.empty(nearby_dots.shape[1])
    last_i, last_j = 0, 0
    for p in range(points.shape[0]):
        x = points[p, 0] / cell
        y = points[p, 1] / cell
        i0 = int(np.floor(x))
        j0 = int(np.floor(y))
        if p == 0 or i0 != last_i or j0 != last_j:
            last_i, last_j = i0, j0
            _gather(dots, i0, j0, nearby_dots)
        for k in range(terms.shape[0]):  # without a branch: several dots at a time
            dx = x - nearby_dots[0, k] - nearby_dots[2, k]
            dy = y - nearby_dots[1, k] - nearby_dots[3, k]
            q = 1.0 - dx * dx - dy * dy
            q = q * q if q > 0.0 else 0.0
            terms[k] = nearby_dots[4, k] * q * q
        total = 0.0
        for k in range(terms.shape[0]):
            total += terms[k]
        if inked:
            out[p] = np.exp(-gain * total)
        else:
            out[p] = 0.5 * (1.0 + np.tanh(gain * total))


@numba.njit(cache=True, nogil=True)
def _gather(dots, i0, j0, nearby_dots):
    n_cells, n_dots = dots.shape[0], dots.shape[2]
    at = 0
    for j in range(j0 - 1, j0 + 2):
        for i in range(i0 - 1, i0 + 2):
            for k in range(n_dots):
                nearby_dots[0, at], nearby_dots[1, at] = i, j
                for c in range(3):
                    nearby_dots[2 + c, at] = dots[j % n_cells, i % n_cells, k, c]
                at += 1
