"""Stages of another specimen on the same grid of points: a jump of the whole field that is nowhere smooth.

Points of two specimens differ slightly and irregularly in position, even where both grids have the same numbers and the
same pitch. From a stage of one specimen to a stage of the other, points move against their four neighbours, all over
the field; between stages of one specimen they do so by noise and by the curvature of the field alone. Points that lie
on the very same places (a computed grid, coordinates rounded to the grid) do not show it.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

MIN_STEPS = 6  # between stages; fewer do not tell what is usual
MIN_SWITCH = 6.0  # times the usual step: stages before and after are calm, which noise of a stage is not
MIN_SINGLE = 20.0  # times the usual step: of one stage alone, which may be a noisy one
MIN_SWITCH_PITCH = 2e-3  # distances of neighbours
MAX_CALM = 3.0  # times the usual step
MAX_CURVATURE = 0.1  # of the step of strain: difference of strain across a distance of neighbours
MAD_TO_STD = 1.4826


@dataclass
class PatternSteps:
    """Steps between stages, of points against the mean of their neighbours.

    pitch_um : distance of neighbours; steps, double_steps : (n - 1,), (n - 2,) µm, from a stage to the next and to the
    one after
    """

    pitch_um: float
    steps: list[float] = field(default_factory=list)
    double_steps: list[float] = field(default_factory=list)
    _last: list[np.ndarray] = field(default_factory=list)

    def add(self, against_neighbours: np.ndarray) -> None:
        """The next stage  # (m, 2) µm, NaN where not measured"""
        if self._last:
            self.steps.append(_typical(against_neighbours - self._last[-1]))
        if len(self._last) > 1:
            self.double_steps.append(_typical(against_neighbours - self._last[-2]))
        self._last = [*self._last[-1:], against_neighbours]

    def other_pattern(self, strains: np.ndarray) -> tuple[int, float] | None:
        """The first stage of another pattern (from 0), and the step to it in usual steps; None where there is none.

        strains : (n, 2, 2) mean strain of every stage
        """
        steps, double = np.array(self.steps), np.array(self.double_steps)
        if len(steps) < MIN_STEPS or not np.isfinite(steps).all() or not np.isfinite(double).all():
            return None
        usual, least = float(np.median(steps)), MIN_SWITCH_PITCH * self.pitch_um
        if usual > max(MIN_SWITCH * float(np.median(double)), least):  # stages of two specimens in turn
            return 1, usual / max(float(np.median(double)), 1e-300)
        curved = MAX_CURVATURE * self.pitch_um * np.linalg.norm(np.diff(strains, axis=0), axis=(1, 2))
        rough = steps > np.maximum(np.maximum(MIN_SWITCH * usual, least), curved)
        calm = steps < max(MAX_CALM * usual, 0.1 * least)
        for k in np.flatnonzero(rough).tolist():
            size = float(steps[k]) / max(usual, 1e-300)
            if all(calm[j] for j in (k - 1, k + 1) if 0 <= j < len(steps)) and k + 1 < len(steps):
                return k + 1, size
            back = k + 1 >= len(steps) or (rough[k + 1] and double[k] < max(MAX_CALM * usual, 0.1 * least))
            if back and size > MIN_SINGLE:
                return k + 1, size
        return None


def _typical(step: np.ndarray) -> float:
    measured = np.isfinite(step).all(axis=1)
    return MAD_TO_STD * float(np.median(np.abs(step[measured]))) if measured.any() else float("nan")
