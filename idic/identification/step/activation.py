"""Inactive parameters: a yield stress that the test does not reach, from which no derivative leads down.

At a start at which nothing yields, the residual does not depend on the yield stress. The law names such parameters and
a factor that brings their onset nearer (`LawParameter.activation_factor`). While such a parameter has been inactive at
every point so far, every step also multiplies it by that factor: the activation step. A rejected step shortens it once;
after a second rejection the parameter stays, since this test does not reach it. An active parameter moves like any
other. One that was active on the way (at a start far too stiff, which made everything yield) and is inactive at the end
is reactivated once.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from idic.identification.step.parameter_covariance import MAX_DETERMINED_STD, Scaled
from idic.parameters import ParameterSet

MAX_REJECTED_ACTIVATIONS = 2


def active_parameters(scaled: Scaled, parameters: ParameterSet) -> tuple[str, ...]:
    """The parameters with an onset that the data determine at this point to better than a factor e."""
    inverse_stds = np.sqrt(np.maximum(np.diagonal(scaled.M), 0.0))  # one over the standard deviation, all others known
    return tuple(name for i, name in enumerate(scaled.names)
                 if parameters[name].activation_factor < 1.0 and inverse_stds[i] >= 1.0 / MAX_DETERMINED_STD)


def activation_step(scaled: Scaled, parameters: ParameterSet, active: Sequence[str], radius: float) -> np.ndarray:
    """Change of the inactive parameters, scaled unknowns, zero for all others  # (n,)

    Parameters
    ----------
    active : the parameters that have been active at some point
    radius : trust radius, the exponent of the law's factor
    """
    delta = np.zeros(len(scaled.names))
    for i, name in enumerate(scaled.names):
        parameter = parameters[name]
        if parameter.activation_factor < 1.0 and name not in active and np.isfinite(parameter.value):
            least = max(parameter.bounds[0], parameter.value * parameter.activation_factor**radius)
            delta[i] = parameter.to_scaled(least) - parameter.to_scaled()
    return delta
