"""A minimum in a kink of the functional, and the return from generalised least squares that do not converge.

Two parameters and a functional whose minimum is written down; the loop itself walks on it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from twin_runs import FORCE, GRIPS, Twin, write_folder

from idic.correlation import CorrelationSystem
from idic.experiment_file import load_experiment
from idic.identification import Evaluation, GENERALISED, start
from idic.identification.step.state import Ending, EstimatorChoice
from idic.identification.loop import advance
from idic.identification.step.increments import KNOWN
from idic.identification.step.non_smooth import smallest_gradient
from idic.identification.step.parameter_covariance import Scaled
from idic.identification.step.state import ENOUGH, GENERALISED_REJECTED
from idic.model import Measured

NAMES = ("BODY.E", "BODY.nu")
STD = 0.01  # of either parameter, scaled
ACROSS = np.array([0.8, 0.6])  # normal of the kink
BODY = """
[material.BODY]
law = "elastic"
E = { value = 1200, unit = "MPa", identify = true }
nu = { value = 0.25, identify = true }
"""


@pytest.fixture(scope="module")
def experiment(clean, tmp_path_factory):
    return load_experiment(write_folder(tmp_path_factory.mktemp("kink") / "test", Twin(), BODY + GRIPS + FORCE, clean))


def walk(experiment, gradient, functional, state=None, has_ended=lambda state: not state.running):
    """The loop from x = 0 to its end; x in standard deviations, half the gradient and the functional of it  # state,
    x"""
    begin = [experiment.model.parameters[name] for name in NAMES]

    def place(values):
        now = [replace(p, value=values[name]) for p, name in zip(begin, NAMES, strict=True)]
        return now, np.array([a.to_scaled() - b.to_scaled() for a, b in zip(now, begin, strict=True)]) / STD

    state, accepted = state or start(experiment), None
    while not has_ended(state):
        now, x = place(state.trial.values)
        slopes = np.array([p.slope() for p in now])
        M = np.diag(STD**-2.0 / slopes**2)
        phi = functional(x)
        system = CorrelationSystem(NAMES, M, -gradient(x, state.generalised) / STD / slopes, phi, phi, M,
                                   np.zeros((0, 2)),
                                   (), generalised=state.generalised)
        point = Evaluation(state.evaluations, system, np.zeros((2, 2)))
        state = advance(state, experiment, point, accepted, 1.0)
        if state.has_accepted(point.number):
            accepted = point
    return state, place(state.accepted.values)[1]


def kinked(root, at, steep):
    """|x - root|^2 + 2 steep |ACROSS x - at|: half its gradient, itself, its minimum where that is in the kink."""
    lowest = root + (at - ACROSS @ root) * ACROSS
    assert abs(at - ACROSS @ root) < steep  # or the minimum were beside it

    def gradient(x, _):
        return x - root + steep * np.sign(ACROSS @ x - at) * ACROSS

    return gradient, lambda x: 1000.0 + (x - root) @ (x - root) + 2.0 * steep * abs(ACROSS @ x - at), lowest


@pytest.mark.parametrize("steep", [0.5, 2.0])
@pytest.mark.parametrize("root", [(1.0, 0.0), (5.0, -3.0), (-2.0, 2.0)])
def test_a_minimum_at_a_non_smooth_point_converges(experiment, root, steep):
    """Steps from either side lead over to the other, half to two standard deviations far, however near they begin."""
    root = np.array(root)
    gradient, functional, lowest = kinked(root, ACROSS @ root - 0.3 * steep, steep)
    state, x = walk(experiment, gradient, functional)
    assert state.status == "converged"
    assert state.evaluations < 30
    assert np.linalg.norm(x - lowest) < 0.3  # a tenth for the way across and for the step that is left, in two unknowns


def test_a_rejected_step_on_a_smooth_slope_is_no_convergence(experiment):
    """A functional that nothing lowers and gradients that agree: the search is stuck, and says so."""
    state, _ = walk(experiment, lambda x, _: np.array([-1.0, 0.0]), lambda x: 1000.0 + np.abs(x).sum())
    assert state.status == "stalled"


def test_a_flat_objective_ends_as_converged_and_says_so(experiment):
    """A slope that no step follows, as rounding makes one: the objective of every trial is that of the accepted
    point."""
    state, x = walk(experiment, lambda x, _: np.array([-1.0, 0.0]), lambda x: 1000.0 + 1e-7 * np.abs(x).sum())
    assert state.status == "converged" and not x.any()
    assert "flat" in state.end.reason and state.end.limit is None


def test_rough_steps_end_only_a_search_that_goes_on_with_other_increments(experiment):
    """A slope of 0.3 standard deviations that no step follows, as noise of measured edges makes one where points
    yield."""
    slope = (lambda x, _: np.array([-0.3, 0.0])), lambda x: 1000.0 + np.abs(x).sum()
    state, _ = walk(experiment, *slope)
    assert state.status == "stalled" and state.trust.rejections > 2
    rough = replace(experiment, model=replace(experiment.model, materials=tuple(replace(one, law="j2_linear")
                                                                                for one in experiment.model.materials),
                                              prescribed=tuple(replace(one, drive=Measured())
                                                               for one in experiment.model.prescribed)))
    state, _ = walk(rough, *slope, has_ended=lambda state: state.trial.new_increments or not state.running)
    assert state.running and state.trust.rejections == 2
    end, _ = walk(rough, *slope)
    assert end.status == "stalled" and end.trust.rejections > 2 and end.increments.status == ENOUGH


def test_an_end_names_its_limit(experiment):
    few = replace(experiment, options=replace(experiment.options, max_iterations=2, step_limit=0.001))
    state, _ = walk(few, lambda x, _: x - 20.0, lambda x: 1000.0 + ((x - 20.0) ** 2).sum())
    assert (state.status, state.end.limit) == ("max_iterations", "iterations")
    assert "2 evaluations" in state.end.reason and "step_limit" in state.end.reason
    state, _ = walk(experiment, lambda x, _: np.array([-1.0, 0.0]), lambda x: 1000.0 + np.abs(x).sum())
    assert (state.status, state.end.limit) == ("stalled", "step")


def test_the_smallest_combination_of_two_gradients_is_at_right_angles_to_their_difference():
    rng = np.random.default_rng(3)
    M = np.array([[4.0, 1.0], [1.0, 2.0]])
    here, there = (Scaled(NAMES, M, b, M, np.ones(2)) for b in (rng.standard_normal(2), -rng.standard_normal(2)))
    found = Scaled(NAMES, 1e4 * M, here.b, 1e4 * M, np.ones(2)).spectrum()
    b, apart = smallest_gradient(here, there, found).b, there.b - here.b
    part = (b - here.b) @ apart / (apart @ apart)
    assert 0.0 <= part <= 1.0
    if 0.0 < part < 1.0:
        assert abs(b @ found.inverse @ apart) < 1e-12
    for t in np.linspace(0.0, 1.0, 21):
        other = here.b + t * apart
        assert b @ found.inverse @ b <= other @ found.inverse @ other + 1e-12


@pytest.mark.parametrize("limit", [40, 10])
def test_generalised_least_squares_that_do_not_converge_lead_back_to_ordinary_least_squares(experiment, limit):
    """Their gradient vanishes nowhere and does not shrink: no step is progress, with many evaluations left or few."""
    few = replace(experiment, options=replace(experiment.options, max_iterations=limit))
    begin = start(few)
    state = replace(begin, estimator=EstimatorChoice(GENERALISED, dict(begin.trial.values)))

    def gradient(x, generalised):
        return (1.0 + abs(x[0])) * np.array([-3.0, 0.0]) if generalised else np.array([0.05, 0.0])

    state, x = walk(few, gradient, lambda x: 1000.0, state)
    assert state.status == "converged" and state.estimator.kind == GENERALISED_REJECTED
    assert x == pytest.approx(0.0, abs=1e-12)
    assert state.evaluations <= limit


@pytest.mark.parametrize("limit", [40, 10])
def test_a_solution_that_was_only_foretold_is_searched_to_its_end_where_evaluations_are_left(experiment, limit):
    few = replace(experiment, options=replace(experiment.options, max_iterations=limit))
    begin, root = start(few), np.array([0.5, 0.0])  # half a standard deviation beside what was foretold
    state = replace(begin, estimator=EstimatorChoice(GENERALISED, dict(begin.trial.values)), end=Ending(KNOWN, ""))

    def gradient(x, generalised):
        return (1.0 + abs(x[0])) * np.array([-3.0, 0.0]) if generalised else x - root

    state, x = walk(few, gradient, lambda x: 1000.0 + ((x - root) ** 2).sum(), state)
    assert (state.status, state.estimator.kind) == ("converged", GENERALISED_REJECTED)
    assert x == pytest.approx(root if state.evaluations < limit else 0.0, abs=1e-3) and state.evaluations <= limit


def test_generalised_least_squares_that_do_not_converge_from_the_start_are_followed_by_ordinary_ones(experiment):
    """Without an ordinary-least-squares solution there is nothing to return to."""
    root = np.array([5.0, -3.0])
    shaken = iter([np.array([1.0, 1.0]), np.array([-1.0, 1.0])] * 100)

    def gradient(x, generalised):
        return 3.0 * next(shaken) if generalised else x - root

    begun = start(experiment, estimator="generalised")
    state, x = walk(experiment, gradient, lambda x: 1000.0 + (x - root) @ (x - root), begun)
    assert state.status == "converged" and state.estimator.kind == GENERALISED_REJECTED
    np.testing.assert_allclose(x, root, atol=0.1)
