"""How long a step may be: as long as the last ones were worth what the model had promised of them.

The limit of a step is remembered from one to the next, as a part of the usual one (`LoopState.reach`): halved where a
step was in vain or worth little, doubled where it was worth what was promised. Limits alone, not damping, answer a long
step that was in vain: a damping by the diagonal of M that is large enough to be felt by the strong directions stops the
weak ones for many steps to come (on a virtual test with ten parameters: 18 evaluations instead of 14). It comes in
where steps have become short (`MAX_DAMPED_RADIUS`).
(Nocedal & Wright, Numerical Optimization, 2006, algorithm 4.1.)
"""

from __future__ import annotations

import numpy as np

from idic.identify.covariance import Scaled
from idic.identify.step.proposal import STEP_CLIP
from idic.parameters import USUAL_REACH, ParameterSet

MIN_GOOD_GAIN_RATIO, MAX_POOR_GAIN_RATIO = 0.7, 0.25  # decrease of the functional over the one that was promised
MAX_DAMPED_RADIUS = 0.05  # reach below which a step in vain is damped, too
MIN_LIMITED_LENGTH_SHARE = 0.95  # of the limit: a step as long as that would have been longer


def step_length(delta: np.ndarray, scaled: Scaled, parameters: ParameterSet, step_limit: float | None) -> float:
    """The longest component of a step over the usual limit of its parameter; delta : (n,) scaled."""
    sizes = np.array([parameters[name].reach for name in scaled.names]) / USUAL_REACH * (step_limit or STEP_CLIP)
    return float((np.abs(delta) / sizes).max(initial=0.0))


def predicted_decrease(delta: np.ndarray, scaled: Scaled) -> float:
    """Decrease of the functional over a step (n,) by the model it was taken from."""
    return float(2.0 * scaled.b @ delta - delta @ scaled.M @ delta)


def radius_after_step(reach: float, length: float, worth: float | None) -> float:
    """The reach after an accepted step.

    worth : decrease of the functional over the promised one; None where functionals cannot be compared
    """
    if worth is None or worth >= MIN_GOOD_GAIN_RATIO:
        return max(reach, min(1.0, 2.0 * length))
    return 0.5 * length if worth < MAX_POOR_GAIN_RATIO and length >= MIN_LIMITED_LENGTH_SHARE * reach else reach


def radius_after_rejection(reach: float, length: float, shorter: int = 0) -> float:
    """The reach after a step that was in vain, and so many further ones, each half as long as the one before."""
    return min(reach, length or reach) * 0.5 ** (1 + shorter)
