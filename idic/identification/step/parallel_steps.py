"""Parallel versions of a step: longer ones where its length was limited, shorter ones after a rejection.

A step of limited length is a guess, and so is one after a rejection. Idle workers simulate several guesses at the same
time, and the one with the lowest functional is judged: a rejection then costs no time. A full Gauss-Newton step is no
guess and is tried alone, since near the end the lowest functional is not the point nearest to the root. The experiment
says how many versions are tried (`trial_steps`), never the number of workers, so that a run ends alike on any machine.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from idic.identification.step.proposal import Step

FIRST_DAMPING = 1e-3
HALVINGS_OF_A_LIMITED_STEP = (-1, 1, -2, 2, 3, 4, 5)  # twice as long, half as long ..., the most promising first
HALVINGS_AFTER_A_REJECTION = (1, 2, 3, 4, 5, 6, 7)
MAX_DIFFERENCE_OF_EQUAL_STEPS = 1e-3  # of the largest component


def damping_after(damping: float, halvings: int) -> float:
    """Damping after so many more rejections, each of which halves the step."""
    return damping if halvings == 0 else max(FIRST_DAMPING, 10.0 * damping) * 10.0 ** (halvings - 1)


def parallel_steps(propose: Callable[[float, float], Step], step: Step, damping: float, limit: float, number: int,
                   rejected: bool) -> list[tuple[int, float, Step]]:
    """Up to `number` further versions of `step`, no two alike: (halvings, damping, step) of each.

    Parameters
    ----------
    propose : the step with a damping and a limit of its largest component
    rejected : whether the last step was rejected: then shorter versions only
    """
    steps: list[tuple[int, float, Step]] = []
    if not step.clipped and not rejected:
        return steps
    for halvings in HALVINGS_AFTER_A_REJECTION if rejected else HALVINGS_OF_A_LIMITED_STEP:
        if len(steps) == number:
            break
        version_damping = damping if step.clipped else damping_after(damping, halvings)
        version = propose(version_damping, limit * 0.5**halvings)
        if not any(_equal(version, earlier) for earlier in (step, *(entry[2] for entry in steps))):
            steps.append((halvings, version_damping, version))
    return steps


def _equal(first: Step, second: Step) -> bool:
    largest = np.abs(second.delta).max(initial=0.0)
    return bool(np.abs(first.delta - second.delta).max(initial=0.0) <= MAX_DIFFERENCE_OF_EQUAL_STEPS * largest)
