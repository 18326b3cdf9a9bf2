"""Further versions of a step, tried side by side with it: longer ones, and the shorter ones of a rejection.

A step of limited length is a guess, and so is one after a rejection. Where workers have nothing else to do, several
guesses are simulated at the same time and the best goes on (lowest functional): a rejection then costs no time, and a
step that could have been longer is. A full Gauss-Newton step is no guess; it is tried alone, as near the end the lowest
functional does not mean the nearest to the root. How many are tried is said by the experiment, never by the number of
workers, so that a run ends alike wherever it is made.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from idic.identify.step.proposal import Step

FIRST_DAMPING = 1e-3
HALVINGS_OF_A_LIMITED_STEP = (-1, 1, -2, 2, 3, 4, 5)  # twice as long, half as long ..., in the order in which they are worth a try
HALVINGS_AFTER_A_REJECTION = (1, 2, 3, 4, 5, 6, 7)  # after a rejection
MIN_EXTRA_GAIN_SHARE = 0.2  # more of what the ordinary step gains: then another one goes on
MAX_DIFFERENCE_OF_EQUAL_STEPS = 1e-3  # of the largest component: steps that differ by less are one


@dataclass(frozen=True)
class ParallelTrial:
    """A further trial: values of all parameters (internal units), its damping, how many rejections it stands for."""

    values: Mapping[str, float]
    damping: float
    rung: int


def damping_at(damping: float, rung: int) -> float:
    """Damping after so many rejections more."""
    return damping if rung == 0 else max(FIRST_DAMPING, 10.0 * damping) * 10.0 ** (rung - 1)


def parallel_steps(propose: Callable[[float, float], Step], step: Step, damping: float, limit: float, number: int,
                  rejected: bool) -> list[tuple[int, float, Step]]:
    """Up to `number` steps beside `step`, no two alike: (rung, damping, step) of each.

    Parameters
    ----------
    propose : the step with a damping and a limit of its largest component
    rejected : whether the step before was: then shorter ones are tried, and no longer ones
    """
    found: list[tuple[int, float, Step]] = []
    if not step.clipped and not rejected:
        return found
    for rung in HALVINGS_AFTER_A_REJECTION if rejected else HALVINGS_OF_A_LIMITED_STEP:
        if len(found) == number:
            break
        own = damping if step.clipped else damping_at(damping, rung)
        other = propose(own, limit * 0.5**rung)
        if not any(_alike(other, known) for known in (step, *(one[2] for one in found))):
            found.append((rung, own, other))
    return found


def _alike(one: Step, other: Step) -> bool:
    return bool(np.abs(one.delta - other.delta).max(initial=0.0) <= MAX_DIFFERENCE_OF_EQUAL_STEPS * np.abs(other.delta).max(initial=0.0))
