"""Where a point begins to yield, b jumps: roots that lie in a jump, and roots behind one.

One parameter with a piecewise linear b whose root on either side is written down; the loop itself walks on it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from twin_runs import FORCE, GRIPS, Twin, write_folder

from idic.correlation import CorrelationSystem
from idic.experiment_file import load_experiment
from idic.identification.loop import advance
from idic.identification import Evaluation, GENERALISED, start
from idic.identification.step.state import EstimatorChoice

STD = 0.01  # of the one parameter, scaled
BODY = """
[material.BODY]
law = "elastic"
E = { value = 1200, unit = "MPa", identify = true }
nu = { value = 0.25 }
"""


@pytest.fixture(scope="module")
def experiment(clean, tmp_path_factory):
    return load_experiment(write_folder(tmp_path_factory.mktemp("jump") / "test", Twin(), BODY + GRIPS + FORCE, clean))


def walk(experiment, jump, left, right, lowest, generalised=False):
    """The loop from x = 0 to its end on b(x) = M (left - x) in front of the jump, M (right - x) behind it.

    jump, left, right, lowest : in standard deviations; lowest : minimum of the functional, beside the roots
    """
    begin = experiment.model.parameters["BODY.E"]
    state = start(experiment)
    if generalised:
        state = replace(state, estimator=EstimatorChoice(GENERALISED))
    accepted = None
    while state.running:
        value = replace(begin, value=state.trial.values["BODY.E"])
        x = (value.to_scaled() - begin.to_scaled()) / STD
        slope, M = value.slope(), STD**-2
        b, phi = M * STD * ((left if x < jump else right) - x), 1000.0 + (x - lowest) ** 2
        unscaled = np.array([[M / slope**2]])
        system = CorrelationSystem(("BODY.E",), unscaled, np.array([b / slope]), phi, phi, unscaled, np.zeros((0, 1)),
                                   (), generalised=state.estimator.kind == GENERALISED)
        point = Evaluation(state.evaluations, system, np.zeros((1, 1)))
        state = advance(state, experiment, point, accepted, 1.0)
        if state.has_accepted(point.number):
            accepted = point
    end = replace(begin, value=state.accepted.values["BODY.E"])
    return state, (end.to_scaled() - begin.to_scaled()) / STD


def test_a_root_in_a_jump_converges(experiment):
    """From in front steps lead to 0.08 behind it, from behind back to where they came from.

    The way there halves the decrement after a rejection, the way back lowers the functional: nothing else would end it.
    """
    state, x = walk(experiment, jump=0.015, left=0.08, right=0.0, lowest=-0.1)
    assert state.status == "converged"
    assert state.evaluations < 10
    assert -1e-9 < x < 0.08


def test_generalised_least_squares_go_over_a_jump_to_the_root_behind_it(experiment):
    """The decrement grows across the jump, from 0.026 to 0.036; a root is only behind it."""
    state, x = walk(experiment, jump=0.006, left=0.16, right=0.35, lowest=0.0, generalised=True)
    assert state.status == "converged" and state.estimator.kind == GENERALISED
    assert x == pytest.approx(0.35, abs=1e-3)


def test_generalised_least_squares_do_not_go_to_and_fro_over_a_jump_for_ever(experiment):
    """Half a standard deviation from either side to the other: that is no arrival, and no endless search."""
    state, x = walk(experiment, jump=0.2, left=0.45, right=0.0, lowest=0.0, generalised=True)
    assert state.evaluations < 25
    assert -1e-9 < x < 0.45


@pytest.mark.parametrize("generalised", [False, True])
def test_without_a_jump_one_step_is_enough(experiment, generalised):
    state, x = walk(experiment, jump=9.0, left=0.9, right=0.9, lowest=0.8, generalised=generalised)
    assert state.status == "converged" and state.evaluations == 2
    assert x == pytest.approx(0.9, abs=1e-9)
