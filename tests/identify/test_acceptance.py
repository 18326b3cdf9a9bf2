"""A trial is accepted that lowers the functional with its priors, which are no part of the sums over the frames, or
that goes towards the root of b where the noise that the interpolation passes raises the functional."""

from __future__ import annotations

import numpy as np
import pytest
from volumes.tomograms import Tomograms

from idic.correlation import CorrelationSystem
from idic.experiment_file import load_experiment
from idic.identification import (
    AcceptedPoint, Evaluation, LoopState, Trial, evaluate_at, identify, resolve_stages, scaled_system,
)
from idic.identification.step.acceptance import falls, improves
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


@pytest.fixture(scope="module")
def judged(tmp_path_factory):
    """Scans with noise of a quarter of the contrast: the changes of the functional and of D over a step in Poisson's
    ratio, and whether the step is accepted; from and to : places, standard deviations from the root of b"""
    experiment = load_experiment(Tomograms(noise_gv=8.0).write(tmp_path_factory.mktemp("noisy") / "bar"))
    end = identify(experiment)
    stage, noise = resolve_stages(experiment)[0], end.weights.image_noise
    std = end.result["parameters"]["BODY.nu"]["std"]

    def at(place: float) -> tuple[dict[str, float], Evaluation, float]:
        values = end.parameters.as_values()
        values["BODY.nu"] += place * std
        point = evaluate_at(experiment, values, end.local)[0]
        scaled = scaled_system(point.system, end.parameters.with_values(values), point.reference_gram, noise)
        return values, point, float(scaled.b @ np.linalg.solve(scaled.M, scaled.b))

    def step(origin: float, place: float) -> tuple[float, float, bool]:
        (values, previous, decrement), (moved, trial, trial_decrement) = at(origin), at(place)
        state = LoopState(Trial(moved), AcceptedPoint(values, 0, previous.system.phi))
        return (trial.system.phi - previous.system.phi, trial_decrement / decrement,
                improves(trial, previous, experiment, stage, noise, state))

    return step


def test_a_step_towards_the_root_is_accepted_where_the_noise_that_the_spline_passes_grows(judged):
    """The minimum of the functional lies a quarter of a standard deviation beside the root of b."""
    change, ratio, accepted = judged(0.2, 0.15)
    assert change > 0.0 and 0.5 < ratio < 0.6
    assert accepted


def test_a_step_away_from_both_is_rejected(judged):
    change, ratio, accepted = judged(-0.15, -0.2)
    assert change > 0.0 and ratio > 1.0
    assert not accepted
