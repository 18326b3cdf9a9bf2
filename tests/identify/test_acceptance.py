"""A trial that lowers the functional with its priors is accepted; priors are no part of the sums over the frames."""

from __future__ import annotations

import numpy as np
import pytest

from idic.correlation import CorrelationSystem
from idic.identification import Evaluation, scaled_system
from idic.identification.step.acceptance import falls
from idic.parameters import Parameter, ParameterSet

BEST, INFORMATION, MEAN, STD = 0.3, 4.0, 1.0, 0.25  # of the data; of the prior


def at(value: float, prior: bool) -> tuple[ParameterSet, Evaluation]:
    """A linear problem of one parameter, whose functional of the data is least at BEST."""
    stated = {"prior_mean": MEAN, "prior_std": STD} if prior else {}
    parameters = ParameterSet([Parameter("a", value, "mm", True, scale=1.0, **stated)])
    off, M = BEST - value, np.array([[INFORMATION]])
    system = CorrelationSystem(("a",), M, np.array([INFORMATION * off]), INFORMATION * off**2, INFORMATION * off**2, M,
                               np.zeros((0, 1)), ())
    return parameters, Evaluation(0, system, np.zeros((1, 1)))


@pytest.mark.parametrize("start, end", [(0.3, 0.6), (0.5, 0.8), (0.9, 0.84), (0.9, 0.5), (0.7, 0.4), (1.2, 0.9)])
@pytest.mark.parametrize("prior", [True, False])
def test_a_step_is_judged_by_the_functional_with_the_squares_of_the_priors(start, end, prior):
    def whole(value: float) -> float:
        return INFORMATION * (value - BEST)**2 + prior * ((value - MEAN) / STD)**2

    (here, previous), (there, trial) = at(start, prior), at(end, prior)
    before, beyond = (scaled_system(point.system, values, point.reference_gram, 1.0)
                      for values, point in ((here, previous), (there, trial)))
    delta = np.array([there["a"].to_scaled() - here["a"].to_scaled()])
    assert falls(trial, previous, before, beyond, delta) == (whole(end) <= whole(start))
