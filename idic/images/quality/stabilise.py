"""Grey values whose noise is the same at every intensity (variance stabilisation; docs/method.md, equation 6.5).

With variance v(I) = offset + slope I the values

    T(I) = L + 2 s / slope [sqrt(v(I)) - sqrt(v(L))],     s = sqrt(v(L)),     dT/dI = s / sqrt(v(I))

have the standard deviation s at any intensity, to first order in noise / intensity, and keep the grey value L and its
scale. Least squares on them weight every pixel by its own noise. Sources: Anscombe 1948,
doi:10.1093/biomet/35.3-4.246, for shot noise; Murtagh, Starck and Bijaoui 1995 for shot and read-out noise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from idic.images.quality.noise import NoiseModel
from idic.images.stack_views import StackView

MIN_VARIANCE_SHARE = 0.01  # of the variance at L; below, the transform is its tangent (black pixels, offset < 0)


@dataclass(frozen=True)
class Stabiliser:
    """The transform of one camera. model : noise variance over grey value; level : the grey value L that stays."""

    model: NoiseModel
    level: float

    @property
    def std_gv(self) -> float:
        """The standard deviation of the transformed noise."""
        return float(np.sqrt(self.model.offset + self.model.slope * self.level))

    def __call__(self, grey: np.ndarray) -> np.ndarray:
        """Transformed grey values  # shape kept, float32"""
        grey, s, slope = np.asarray(grey, dtype=float), self.std_gv, self.model.slope
        if slope == 0.0:
            return grey.astype(np.float32)
        variance = self.model.offset + slope * grey
        floor = MIN_VARIANCE_SHARE * s**2
        root = np.sqrt(np.maximum(variance, floor))
        below = np.minimum(variance - floor, 0.0) / (2.0 * np.sqrt(floor))  # the tangent of the root
        return (self.level + 2.0 * s / slope * (root + below - s)).astype(np.float32)


@dataclass(frozen=True, eq=False)
class StabilisedStack(StackView):
    """A stack with its grey values transformed."""

    stabiliser: Stabiliser

    def frame(self, k: int) -> np.ndarray:
        """Frame `k`  # (ny, nx) float32"""
        return self.stabiliser(self.stack.frame(k))
