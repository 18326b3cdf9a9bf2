"""How the limit of a step follows from what the last ones were worth."""

import numpy as np
import pytest

from idic.identification.step.parameter_covariance import Scaled
from idic.identification.step.trust_radius import (
    predicted_decrease, radius_after_rejection, radius_after_step, step_length,
)
from idic.parameters import USUAL_MAX_STEP, Parameter, ParameterSet

M = np.array([[4.0, 1.0], [1.0, 9.0]])
B = np.array([2.0, -3.0])
SCALED = Scaled(("a", "b"), M, B, M, np.ones(2))


def test_the_predicted_gain_of_a_step_is_the_decrease_of_its_quadratic_model():
    """phi(d) = c - 2 b.d + d.M.d, of which the full step gains b.M^-1.b."""
    full = np.linalg.solve(M, B)
    assert predicted_decrease(full, SCALED) == pytest.approx(B @ full)
    for delta in np.random.default_rng(1).normal(size=(5, 2)):
        assert predicted_decrease(delta, SCALED) == pytest.approx(2 * B @ delta - delta @ M @ delta)
        assert predicted_decrease(delta, SCALED) < predicted_decrease(full, SCALED)


def test_the_length_of_a_step_counts_in_the_max_step_of_each_parameter():
    parameters = ParameterSet([Parameter("a", 1.0, max_step=0.05), Parameter("b", 1.0)])
    assert step_length(np.array([0.05, 0.1]), SCALED, parameters, None) == pytest.approx(1.0)
    assert step_length(np.array([0.0, 0.5 * USUAL_MAX_STEP]), SCALED, parameters, None) == pytest.approx(0.5)
    # a limit that is asked for
    assert step_length(np.array([0.0, 0.05]), SCALED, parameters, 0.05) == pytest.approx(1.0)


def test_a_step_with_its_predicted_gain_doubles_the_trust_radius_up_to_the_usual_one():
    assert radius_after_step(0.25, 0.25, 0.9) == 0.5
    assert radius_after_step(0.8, 0.8, 1.1) == 1.0
    assert radius_after_step(0.5, 0.01, 0.9) == 0.5  # a short step says nothing against long ones
    assert radius_after_step(0.25, 0.25, None) == 0.5


def test_a_step_that_was_worth_little_halves_the_limit_only_where_it_was_limited():
    assert radius_after_step(0.5, 0.5, 0.1) == 0.25
    assert radius_after_step(0.5, 0.2, 0.1) == 0.5
    assert radius_after_step(0.5, 0.5, 0.5) == 0.5


def test_after_a_rejection_the_next_step_is_half_as_long_as_the_shortest_that_was_tried():
    assert radius_after_rejection(1.0, 1.0) == 0.5
    assert radius_after_rejection(1.0, 0.2) == 0.1
    assert radius_after_rejection(1.0, 1.0, halvings=2) == 0.125
    assert radius_after_rejection(0.5, 0.0) == 0.25  # the trial was where the last one stood


def test_a_start_far_from_the_value_of_the_file_is_a_unit_of_the_search():
    """A start that a score promises lies many units away; a direction wider than a unit is left where it is."""
    known = ParameterSet([Parameter("warmth", 1e-5, free=True, scale=1e-5), Parameter("place", 20.0, scale=1.0),
                          Parameter("nu", 0.3, free=True, bounds=(-1.0, 0.5), scale=0.3),
                          Parameter("E", 2000.0, free=True, transform="log", scale=2000.0)])
    begun = known.with_starts({"warmth": -3e-4, "place": 20.0, "nu": -0.5, "E": 10.0})
    assert begun.as_values() == {"warmth": -3e-4, "place": 20.0, "nu": -0.5, "E": 10.0}
    assert [p.scale for p in begun.values()] == pytest.approx([3.1e-4, 1.0, 0.3, 2000.0])
    assert known.with_starts({})["warmth"] == known["warmth"]
