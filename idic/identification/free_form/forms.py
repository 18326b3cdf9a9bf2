"""The free functions whose number of knots the evidence chooses: curves, relaxation spectra, yield surfaces.

Each tells what `idic.identification.free_form.evidence` needs: by which matrix the identified values follow from
those of fewer knots, the smoothness prior of these, and at which places the function is compared.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from idic.laws import (
    FAMILY_ERROR, POWER, RINGS, RING_KNOTS, ROOT, STRAIN, Smoothness, basis, bends, grid, knot_stresses, knots, powers,
    prior_rows, relaxing,
)

NUMBERS = (4, 6, 8, 10, 12, 16, 20, 24)  # of knots of a curve, of times of a spectrum
COMPARED_TIMES = 40  # of a spectrum
NEAREST = 4  # identified times by which another one is interpolated: cubic over the logarithm


class FreeForm(Protocol):
    """A free function in the list of parameters.

    at : (n,) places of its values; over : smoothness to try; numbers : of knots to try, the last one is identified;
    lowest : of its values; centre : of its values in the prior; family_error : that its band counts beside the noise
    """

    @property
    def at(self) -> tuple[int, ...]: ...
    @property
    def over(self) -> tuple[str, ...]: ...
    @property
    def numbers(self) -> tuple[int, ...]: ...
    @property
    def lowest(self) -> float: ...
    @property
    def centre(self) -> float: ...
    @property
    def family_error(self) -> float: ...

    def finer(self, n: int) -> np.ndarray:
        """The identified values by those of n knots  # (n_identified, m)"""

    def bends(self, n: int, smoothness: Smoothness) -> np.ndarray:
        """Combinations of the values that are zero with unit variance in the prior  # (k, m)"""

    def ends(self, n: int) -> np.ndarray:
        """Combinations of unit density, which the prior leaves open  # (2 or 0, m)"""

    def seen(self, n: int, finest: int) -> np.ndarray:
        """The function at places that depend on `finest` alone, by the values of n knots  # (p, m)"""


@dataclass(frozen=True)
class FreeCurve:
    """A curve that is linear between its knots: hardening, or a derivative of a rubber's energy.

    last_knot : where it ends; size : of its starting curve
    """

    at: tuple[int, ...]
    last_knot: float
    size: float
    over: tuple[str, ...] = (STRAIN, ROOT)
    numbers: tuple[int, ...] = NUMBERS
    lowest: float = -np.inf
    centre: float = 0.0
    family_error: float = 0.0

    def finer(self, n: int) -> np.ndarray:
        return self.seen(n, len(self.at))

    def bends(self, n: int, smoothness: Smoothness) -> np.ndarray:
        return bends(knots(self.last_knot, n), self.size, smoothness)

    def ends(self, n: int) -> np.ndarray:
        return np.eye(n)[[0, -1]]

    def seen(self, n: int, finest: int) -> np.ndarray:
        return basis(knots(self.last_knot, finest), self.last_knot, n)


@dataclass(frozen=True)
class FreeSpectrum:
    """Weights of relaxation times from `shortest` to `longest` (s); compared is the share that has relaxed.

    size : of the starting weights, their mean times their number less one
    """

    at: tuple[int, ...]
    shortest: float
    longest: float
    size: float
    over: tuple[str, ...] = (ROOT,)
    numbers: tuple[int, ...] = NUMBERS
    lowest: float = 0.0
    centre: float = 0.0
    family_error: float = 0.0

    def finer(self, n: int) -> np.ndarray:
        """Relaxation with one time is met by that with its nearest times in the grid, exp(-t / tau) cubic in ln tau."""
        places = np.linspace(0.0, len(self.at) - 1.0, n)
        interpolation = np.zeros((len(self.at), n))
        first = np.clip(np.floor(places).astype(int) - NEAREST // 2 + 1, 0, max(len(self.at) - NEAREST, 0))
        for k, (place, low) in enumerate(zip(places, first, strict=True)):
            neighbours = np.arange(low, min(low + NEAREST, len(self.at)))
            for i in neighbours:
                roots = neighbours[neighbours != i]
                interpolation[i, k] = np.prod((place - roots) / (i - roots))
        return interpolation

    def bends(self, n: int, smoothness: Smoothness) -> np.ndarray:
        return bends(knots(1.0, n), self.size, smoothness)

    def ends(self, n: int) -> np.ndarray:
        """Of the density over the logarithm of time, which the weights are times n - 1."""
        return (n - 1.0) * np.eye(n)[[0, -1]]

    def seen(self, n: int, finest: int) -> np.ndarray:
        return relaxing(np.geomspace(self.shortest, self.longest, COMPARED_TIMES), grid(self.shortest, self.longest, n))


@dataclass(frozen=True)
class FreeSurface:
    """Weights of a yield surface on three rings; compared is the radius over that along axis 1, linear about `weights`.

    weights : as identified; size : std of the difference of neighbours; spread : of every weight
    """

    at: tuple[int, ...]
    weights: tuple[float, ...]
    size: float
    spread: float
    over: tuple[str, ...] = (STRAIN,)
    numbers: tuple[int, ...] = tuple(range(RING_KNOTS[0], RING_KNOTS[1] + 1))
    lowest: float = 0.0
    centre: float = 1.0
    family_error: float = FAMILY_ERROR

    def finer(self, n: int) -> np.ndarray:
        """All forms of degree 8 are combinations of those of 9 knots, exactly; equal weights stay equal."""
        identified = len(self.at) // RINGS
        stress = knot_stresses(RING_KNOTS[1])
        coefficients = np.linalg.lstsq(powers(identified, stress), powers(n, stress), rcond=1e-10)[0]
        return coefficients * (identified / n)

    def bends(self, n: int, smoothness: Smoothness) -> np.ndarray:
        return np.vstack([prior_rows(n, smoothness.strength * self.size), np.eye(RINGS * n) / self.spread])

    def ends(self, n: int) -> np.ndarray:
        return np.zeros((0, RINGS * n))

    def seen(self, n: int, finest: int) -> np.ndarray:
        stress = np.vstack([[1.0, 0.0, 0.0], knot_stresses(RING_KNOTS[1])])
        identified = len(self.at) // RINGS
        share = powers(n, stress) * (identified / n) / (powers(identified, stress) @ self.weights)[:, None]
        return (share[:1] - share[1:]) / POWER
