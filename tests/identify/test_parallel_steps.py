"""Parallel versions of a step: which of them is judged, and that nothing else changes."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import pytest
from twin_runs import TRUTH, identify, solved

from idic.errors import NotConverged
from idic.experiment_file import load_experiment
from idic.identification import Evaluation, LoopState, Trial, describe_evaluation, in_memory, resolve_stages
from idic.identification.step.state import ParallelTrial
from idic.identification.loop import _best, advance
from idic.identification.step.next_step import MAX_REJECTIONS
from idic.identification.step.parallel_steps import damping_after
from idic.model import ForwardModel
from idic.run import SerialRunner
from idic.run.prepared.session import Timing
from idic.run.part_points import PartPoints
from idic.run.prepared.session import open_session
from idic.run.store.state_file import load_state, save_state

FAR = {"BODY.E": 0.3 * TRUTH["E"], "BODY.nu": 0.05}  # more than two steps of 35 % away


def far(trial_steps, **more):
    """The options of a search from far."""
    return {"BODY__E": FAR["BODY.E"], "BODY__nu": FAR["BODY.nu"], "options__trial_steps": trial_steps,
            "options__estimator": "ordinary"} | more


@pytest.fixture(scope="module")
def alone(plain):
    return solved(plain[0], **far(1))


@pytest.fixture(scope="module")
def three(plain, tmp_path_factory):
    run = tmp_path_factory.mktemp("three") / "run"
    return run, *identify(plain[0], run, **far(3))


def test_parallel_steps_give_the_same_answer_in_fewer_rounds(alone, three):
    (state, result), (_, other, fanned) = alone, three
    assert state.rounds == state.evaluations and other.rounds < other.evaluations
    assert other.rounds < state.rounds  # steps of twice the limit are there to be taken
    for name, entry in result["parameters"].items():
        # two ends of one search: each stops when its next step is below 2 % of a standard deviation
        assert abs(entry["value"] - fanned["parameters"][name]["value"]) < 0.05 * entry["std"]
    assert fanned["status"] == "converged"


def test_every_trial_is_in_the_history_and_one_of_a_round_goes_on(three):
    _, state, _ = three
    numbers = [entry["evaluation"] for entry in state.history]
    assert numbers == list(range(state.evaluations))
    accepted = [entry for entry in state.history if entry["accepted"]]
    assert len(accepted) == state.iteration + 1
    best = state.history[1:4]  # of the first step: the ordinary one, twice as far, half as far
    assert [entry["accepted"] for entry in best].count(True) == 1
    assert min(best, key=lambda entry: entry["phi"])["accepted"]
    assert [entry["passed_over"] for entry in best] == [not entry["accepted"] for entry in best]
    said = [describe_evaluation(entry) for entry in best]
    assert sum("passed over" in line for line in said) == 2 and not any("rejected" in line for line in said)


def test_near_the_end_a_full_step_is_tried_alone(three):
    """Of a Gauss-Newton step there is only one version."""
    _, state, _ = three
    assert state.parallel_evaluations < 2 * (state.rounds - 2)


def test_in_memory_and_on_files_the_same_trials_are_made(plain, three):
    _, state, _ = three
    start = {f"material.{name}.value": value for name, value in FAR.items()}
    experiment = load_experiment(plain[0], start | {"options.trial_steps": 3, "options.estimator": "ordinary"})
    found = in_memory.identify(experiment)
    assert found.state.evaluations == state.evaluations
    assert found.state.parallel_evaluations == state.parallel_evaluations
    for one, other in zip(found.state.history, state.history, strict=True):
        assert one["accepted"] == other["accepted"]
        assert one["values"] == pytest.approx(other["values"], rel=1e-9)


def test_the_checkpoint_of_an_open_round_comes_back_to_the_last_bit(plain, three, tmp_path):
    """It holds all trials of the round; missing simulations are made."""
    run, state, _ = three
    stopped, result = identify(plain[0], tmp_path / "run", **far(3, options__max_iterations=1))
    assert stopped.status == "max_iterations" and stopped.rounds == 1
    assert load_state(run) == state
    parallel = (ParallelTrial({"BODY.E": 1 / 3, "BODY.nu": 0.1}, 1e-3, 1),)
    open_round = replace(state, trial=replace(state.trial, parallel=parallel))
    save_state(tmp_path / "run", open_round)
    assert load_state(tmp_path / "run") == open_round


def test_a_version_that_cannot_be_simulated_leaves_the_others_in_the_race(plain, monkeypatch):
    march = ForwardModel.march

    def failing(self, parameters, *args, **more):
        if 1.3 * FAR["BODY.E"] < parameters["BODY.E"].value < 1.5 * FAR["BODY.E"]:  # the ordinary first step
            raise NotConverged("no equilibrium, for the test")
        yield from march(self, parameters, *args, **more)

    monkeypatch.setattr(ForwardModel, "march", failing)
    state, result = solved(plain[0], **far(3))
    first = state.history[1]
    assert not first["accepted"] and first["phi"] is None and "for the test" in first["message"]
    assert any(entry["accepted"] for entry in state.history[2:4]) and result["status"] == "converged"


# the loop on made-up points --------------------------------------------------------------------------
@pytest.mark.parametrize("ordinary, other, chosen", [
    (40.0, 25.0, 1),  # a quarter more than the ordinary step gains
    (40.0, 35.0, 0),  # a trifle: a shorter step leaves the weak directions where they are
    (110.0, 109.0, 1), (None, 90.0, 1), (40.0, None, 0), (None, None, 0)])
def test_another_step_goes_on_where_it_is_clearly_better(ordinary, other, chosen):
    """The functional was 100 before."""

    def point(phi):
        system = SimpleNamespace(phi=phi, phi_image=phi, n_pixels=9, n_lost=0)
        return Evaluation(0, None if phi is None else system, None)

    before, *points = map(point, (100.0, ordinary, other))
    assert _best(points, before) == chosen


def test_trials_are_numbered_one_after_the_other():
    parallel = (ParallelTrial({"E": 2.0}, 1e-4, -1), ParallelTrial({"E": 0.5}, 1e-3, 1))
    state = LoopState(Trial({"E": 1.0}, parallel), evaluations=4)
    assert [(one.evaluations, one.trial, one.trust.damping) for one in state.trial_states] == [
        (4, Trial({"E": 1.0}), 0.0), (5, Trial({"E": 2.0}), 1e-4), (6, Trial({"E": 0.5}), 1e-3)]


def test_the_damping_after_several_halvings_is_that_of_as_many_rejections():
    damping = 0.0
    for halvings in range(1, 5):
        damping = damping_after(damping, 1)
        assert damping_after(0.0, halvings) == pytest.approx(damping)
    assert damping_after(0.3, 0) == 0.3


def test_a_round_without_an_accepted_step_counts_as_the_rejections_that_it_saves(plain, tmp_path):
    """Four rounds with two shorter versions each use up what eight rejections one by one do."""
    state, _ = identify(plain[0], tmp_path / "run", **far(1, options__max_iterations=2))
    session = open_session(tmp_path / "run", SerialRunner(), "direct")
    open_again = replace(state, status="running")
    here = replace(open_again, trial=Trial(state.accepted.values), evaluations=state.accepted.number)
    accepted = PartPoints(session, Timing()).correlate(here, resolve_stages(session.experiment)[0])
    patient = replace(session.experiment.options, trial_steps=4, max_iterations=100)
    experiment, state, rounds = replace(session.experiment, options=patient), open_again, 0
    while state.running:
        first, *parallel = (Evaluation(trial.evaluations, None, None, "lost") for trial in state.trial_states)
        state = advance(state, experiment, first, accepted, session.context.weights.image_noise, parallel)
        rounds += 1
    assert state.status == "forward_failed" and 1 < rounds <= MAX_REJECTIONS // 2 + 1
