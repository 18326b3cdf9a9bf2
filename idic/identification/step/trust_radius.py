"""The trust radius: the bound on the next step, by the share of the predicted decrease that the last steps gained.

The radius is the limit of a step over the usual one. A rejected step and an accepted one of small gain halve it, a step
of good gain doubles it. The radius alone answers a rejected long step: a damping by the diagonal of M that is large
enough for the strong directions stops the weak ones for many steps (18 evaluations in place of 14 on a virtual test
with ten parameters). Damping is added where the radius has become small.
(docs/method.md, equation 10.2; Nocedal & Wright, Numerical Optimization, 2006, algorithm 4.1.)
"""

from __future__ import annotations

import numpy as np

from idic.identification.step.parameter_covariance import Scaled
from idic.identification.step.proposal import STEP_CLIP
from idic.parameters import USUAL_MAX_STEP, ParameterSet

MIN_GOOD_GAIN_RATIO, MAX_POOR_GAIN_RATIO = 0.7, 0.25  # decrease of the functional over the predicted one
MAX_DAMPED_RADIUS = 0.05  # below this radius a rejected step is damped, too
MIN_LIMITED_LENGTH_SHARE = 0.95  # of the radius: the limit has shortened a step of that length


def step_length(delta: np.ndarray, scaled: Scaled, parameters: ParameterSet, step_limit: float | None) -> float:
    """The longest component of a step over the usual limit of its parameter; delta : (n,) scaled."""
    sizes = np.array([parameters[name].max_step for name in scaled.names]) / USUAL_MAX_STEP * (step_limit or STEP_CLIP)
    return float((np.abs(delta) / sizes).max(initial=0.0))


def predicted_decrease(delta: np.ndarray, scaled: Scaled) -> float:
    """Decrease of the functional over a step (n,) by the quadratic model of its point."""
    return float(2.0 * scaled.b @ delta - delta @ scaled.M @ delta)


def radius_after_step(radius: float, length: float, gain_ratio: float | None) -> float:
    """The radius after an accepted step.

    gain_ratio : decrease of the functional over the predicted one; None where functionals cannot be compared
    """
    if gain_ratio is None or gain_ratio >= MIN_GOOD_GAIN_RATIO:
        return max(radius, min(1.0, 2.0 * length))
    limited = length >= MIN_LIMITED_LENGTH_SHARE * radius
    return 0.5 * length if gain_ratio < MAX_POOR_GAIN_RATIO and limited else radius


def radius_after_rejection(radius: float, length: float, halvings: int = 0) -> float:
    """The radius after a rejected step and so many rejected further ones, each half as long as the one before."""
    return min(radius, length or radius) * 0.5 ** (1 + halvings)
