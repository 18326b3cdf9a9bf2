"""What has not begun yet: a parameter that nothing depends on because its value is out of reach, a yield stress say.

Where the start says that nothing yields, no derivative tells otherwise. A law names such parameters and a factor that
lets them begin sooner (`LawParameter.sooner`). As long as nothing has ever depended on one, every step multiplies it by
that factor beside what the others do; where that makes things worse it is shortened once, and then given up: the test
does not reach it. Once felt, it is a parameter like any other; where it had a say on the way only (a start far too
stiff made everything yield) and has none where the search would end, it begins sooner once more.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from idic.identify.covariance import UNDETERMINED_STD, Scaled
from idic.parameters import ParameterSet

MAX_REJECTED_ACTIVATIONS = 2  # of such steps; then what is left has no say in this test


def active_parameters(scaled: Scaled, parameters: ParameterSet) -> tuple[str, ...]:
    """Of the parameters that may begin sooner, those that something depends on here."""
    own = np.sqrt(np.maximum(np.diagonal(scaled.M), 0.0))  # one over the standard deviation, all others known
    return tuple(name for i, name in enumerate(scaled.names)
                 if parameters[name].sooner < 1.0 and own[i] >= 1.0 / UNDETERMINED_STD)


def activation_step(scaled: Scaled, parameters: ParameterSet, known: Sequence[str], reach: float) -> np.ndarray:
    """The change of what is to begin sooner, scaled unknowns, zero elsewhere  # (n,)

    known : what something has depended on before; reach : part of the usual change
    """
    delta = np.zeros(len(scaled.names))
    for i, name in enumerate(scaled.names):
        parameter = parameters[name]
        if parameter.sooner < 1.0 and name not in known and np.isfinite(parameter.value):
            least = max(parameter.bounds[0], parameter.value * parameter.sooner**reach)
            delta[i] = parameter.to_scaled(least) - parameter.to_scaled()
    return delta
