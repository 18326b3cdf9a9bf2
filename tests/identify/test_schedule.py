"""Schedules: which directions wait, what a stage sees, and that they lead to the same answer."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from twin_runs import ELASTIC, FORCE, GRIPS, Twin, identify, write_folder

from idic.errors import InputError
from idic.experiment_file import load_experiment
from idic.identification import identify as identify_in_memory, resolve_stages, seen_in
from idic.identification.step.parameter_covariance import Scaled
from idic.identification.step.schedule import strong_directions
from idic.model import Stage

COARSE = """
[[stage]]
lowpass_px = 3.0
[[stage]]
free = "all"
until_s = 2.5
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return write_folder(tmp_path_factory.mktemp("schedule") / "test", Twin(), ELASTIC + GRIPS + FORCE)


def scaled(values, steps):
    """A system with these eigenvalues along turned axes, and Gauss-Newton steps along them."""
    vectors, _ = np.linalg.qr(np.random.default_rng(2).standard_normal((len(values),) * 2))
    M = vectors * values @ vectors.T
    return Scaled(tuple("abc"[:len(values)]), M, vectors @ (values * steps), M, np.ones(len(values)))


@pytest.mark.parametrize("steps, free", [
    ([0.5, 0.5, 0.5], [True, False, False]),  # the strong direction has far to go
    ([0.05, 0.5, 0.5], [True, True, False]),  # it stands: the next one moves
    ([0.05, 0.05, 0.5], [True, True, True]),
    ([0.05, 0.5, 0.05], [True, True, False]),
])
def test_a_weak_direction_waits_until_all_stronger_ones_stand(steps, free):
    system = scaled(np.array([1e8, 1e5, 1e2]), np.array(steps))  # standard deviations 1e-4, 3e-3, 0.1
    assert strong_directions(system, system.spectrum()).tolist() == free


def test_directions_of_like_strength_do_not_wait_for_each_other():
    system = scaled(np.array([1e8, 2e7, 5e6]), np.array([0.5, 0.5, 0.5]))
    assert strong_directions(system, system.spectrum()).all()


def test_a_stage_sees_blurred_images_or_the_first_frames(folder):
    experiment = load_experiment(folder)
    assert seen_in(experiment, Stage("all")) is experiment
    assert seen_in(experiment, Stage("all", lowpass_px=3.0)).options.lowpass_px == 3.0
    assert seen_in(experiment, Stage("all", until_s=2.5)).recording.excluded == (3, 4, 5)
    staged = replace(experiment, stages=(Stage("all", lowpass_px=3.0),))
    assert [stage.lowpass_px for stage in resolve_stages(staged)] == [3.0, None]  # the answer is that of all images


def test_a_stage_that_ends_before_anything_is_compared_is_refused(folder):
    early = replace(load_experiment(folder), stages=(Stage("all", until_s=0.5), Stage("all")))
    with pytest.raises(InputError, match="stage 1 ends before the first image that is compared"):
        resolve_stages(early)


def test_a_converged_result_stands_if_another_estimator_gains_nothing(folder):
    experiment = load_experiment(folder)
    allow = lambda n, how: replace(experiment, options=replace(experiment.options, max_iterations=n,  # noqa: E731
                                                               estimator=how))
    needed = identify_in_memory(allow(40, "ordinary")).state.evaluations
    found = identify_in_memory(allow(needed + 1, "auto"))
    assert (found.state.status, found.result["estimator"]) == ("converged", "ordinary")
    asked = identify_in_memory(allow(needed + 1, "generalised"))
    assert asked.state.status == "max_iterations"  # generalised ones were asked for and are not there


def test_another_estimator_begins_at_the_known_end_of_the_search_and_iterations_are_steps(folder):
    """The last step of ordinary least squares is evaluated once, by the other estimator."""
    found = identify_in_memory(load_experiment(folder))
    assert (found.state.status, found.result["estimator"]) == ("converged", "generalised")
    entries = [entry for entry in found.state.history if entry["accepted"]]
    moves = sum(one["values"] != other["values"] for one, other in zip(entries, entries[1:], strict=False))
    assert found.state.iteration == moves == len(entries) - 1


def test_a_stage_of_one_step_makes_it_after_a_stage_on_other_images(folder):
    stages = (Stage("all", lowpass_px=3.0), Stage("all", max_iterations=1))
    found = identify_in_memory(replace(load_experiment(folder), stages=stages))
    entries = [entry for entry in found.state.history if entry["stage"] == 1 and entry["accepted"]]
    assert len({tuple(entry["values"].items()) for entry in entries}) == 2


def test_every_schedule_ends_where_the_plain_one_does(folder, tmp_path):
    """Every search ends within about 0.02 standard deviations, its tolerance: two differ by 0.04, and 0.05 is asked."""
    plain = identify_in_memory(load_experiment(folder)).result["parameters"]
    text = folder.read_text()
    for name, toml in (("staged", text + COARSE), ("spectrum", text + '\n[options]\nschedule = "spectrum"\n')):
        folder.with_name(f"{name}.toml").write_text(toml)
        found = identify_in_memory(load_experiment(folder.with_name(f"{name}.toml")))
        assert found.state.status == "converged"
        results = [found.result]
        if name == "staged":
            state, result = identify(folder.with_name(f"{name}.toml"), tmp_path / "run")
            results.append(result)
            assert [entry["stage"] for entry in state.history][-1] == 2
            assert {entry["stage"] for entry in state.history} == {0, 1, 2}
        for entries, key in product((result["parameters"] for result in results), ("BODY.E", "BODY.nu")):
            assert entries[key]["value"] == pytest.approx(plain[key]["value"], abs=0.05 * plain[key]["std"])
            assert entries[key]["std"] == pytest.approx(plain[key]["std"], rel=1e-3)
