"""The size of the next increment: whole intervals between frames, smaller ones after failures and out of a flat start.

A flat membrane under pressure has nothing but its bending stiffness to begin with: the rise goes like t^(1/3), and
Newton's method finds no equilibrium far from the last one. The linear answer to the first interval decides: where its
displacement gradient exceeds `MAX_LINEAR_GRADIENT`, the test starts with a quarter, a sixteenth, ... of the interval.
The parts are powers of four, so that models with slightly different parameters take the same increments.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from idic.errors import NotConverged
from idic.fe.assembly import kernels
from idic.fe.assembly.assembly import System
from idic.fe.body.boundary import Drives
from idic.fe.equilibrium import Converged, linear_move

MAX_LINEAR_GRADIENT = 0.05  # displacement gradient of the linear answer to the first increment
MIN_FIRST_PART = 4.0**-8  # of an interval
GENTLE_GROWTH, GROWTH = 1.5, 2.0
MAX_ITERATIONS_TO_GROW = 6  # Newton iterations up to which the next increment is larger
INCREMENTS_WITHOUT_EXTRAPOLATION = 4  # increments out of a flat start: extrapolation of t^(1/3) from zero misleads


@dataclass
class IncrementSize:
    """Part of the interval between two frames that the next increment takes; it changes during the march."""

    part: float = 1.0
    smallest: float = 1.0  # the part that the gentlest start so far began with
    gentle: bool = False
    unextrapolated: int = 0  # increments still to be solved without extrapolation

    def start_from_rest(self, system: System, params: Mapping[str, np.ndarray], start: Converged, end: Drives,
                        substeps: int, frozen: float | None) -> None:
        """Start an interval with a small increment where a follower pressure begins to act.

        Parameters
        ----------
        end : at the end of the interval
        frozen : the part that the first increment takes where increments are given; None: they are chosen here
        """
        if not end.pressure.any() or start.drives.pressure.any():
            return
        part = first_part(system, params, start, end, substeps) if frozen is None else min(1.0, frozen)
        if part <= 0.5:
            self.unextrapolated = INCREMENTS_WITHOUT_EXTRAPOLATION
            self.gentle = frozen is None
            self.part, self.smallest = min(self.part, part), min(self.smallest, part)

    def extrapolates(self) -> bool:
        return self.unextrapolated == 0

    def converged(self, iterations: int) -> None:
        self.unextrapolated = max(0, self.unextrapolated - 1)
        if self.gentle:  # independent of the iterations: similar models keep the same increments
            self.part = min(1.0, GENTLE_GROWTH * self.part)
        elif iterations <= MAX_ITERATIONS_TO_GROW:
            self.part = min(1.0, GROWTH * self.part)
        self.gentle = self.gentle and self.part < 1.0


def first_part(system: System, params: Mapping[str, np.ndarray], start: Converged, end: Drives, substeps: int) -> float:
    """The part of an increment to `end` (of 1 / `substeps` of its interval) that is safe to begin with: 1, 1/4, ..."""
    try:
        move = linear_move(system, params, start, end)
    except NotConverged:
        return 1.0
    steepest, d = 0.0, system.n_dim
    for group in system.groups:
        F = np.empty((group.n_points, d, d))
        kernels.deformation_gradients(group.connectivity, group.grads, move, F)
        steepest = max(steepest, float(np.abs(F - np.eye(d)).max()))
    part = 1.0
    while steepest / substeps * part > MAX_LINEAR_GRADIENT and part > MIN_FIRST_PART:
        part /= 4.0
    return part
