"""The coverage study: what a draw is made of, and how draws are counted."""

import json
from dataclasses import replace

import numpy as np
import pytest

from idic_studies.pages.case_record import CaseRecord
from idic_studies.pages.coverage_page import coverage_of, draw_coverage
from idic_studies.cases.case import CaseJob, case_experiment, render, run_case
from idic_studies.cases.realisation import Disturbance
from idic_studies.cases.registry import make_study
from idic_studies.cases.store import StudyStore

NAMES = ["sheet.E", "sheet.nu"]


def record(key, value, std, status="converged"):
    facts = {"names": NAMES, "status": status, "estimator": "generalised"}
    return CaseRecord(key, facts, {"value": np.array(value), "std": np.array(std), "truth": np.array([100.0, 0.3])})


def draws(n, scatter, name="polymer-generalised"):
    rng = np.random.default_rng(3)
    values = np.array([100.0, 0.3]) + scatter * np.array([1.0, 0.01]) * rng.standard_normal((n, 2))
    return [record(f"{name}/{k:04d}", value, [1.0, 0.01]) for k, value in enumerate(values)]


def test_honest_error_bars_cover_the_truth_in_95_per_cent_of_the_draws():
    found = coverage_of("polymer-generalised", draws(4000, 1.0), record("bound/polymer", [100.0, 0.3], [0.8, 0.01]))
    assert np.abs(found.covered - 0.95).max() < 0.011  # three standard errors of 4000 draws
    np.testing.assert_allclose(np.diff(found.band, axis=0), 4 * np.sqrt(0.95 * 0.05 / 4000), rtol=0.1)
    assert (found.band[0] < found.covered).all() and (found.covered < found.band[1]).all()
    assert np.abs(found.scatter - 1.0).max() < 0.035 and np.abs(found.bias).max() < 0.05
    assert found.above_bound == pytest.approx(found.scatter / [0.8, 1.0])


def test_error_bars_that_are_too_small_show():
    found = coverage_of("polymer-generalised", draws(1000, 1.5), None)
    assert found.covered.max() < 0.85 and found.scatter.min() > 1.4 and np.isnan(found.above_bound).all()


def test_the_page_has_a_target_per_group_and_counts_draws_that_did_not_converge():
    made = {r.key: r for r in draws(600, 1.0)}
    made["polymer-generalised/9999"] = record("polymer-generalised/9999", [0.0, 0.0], [1.0, 1.0], "stalled")
    made["bound/polymer"] = record("bound/polymer", [100.0, 0.3], [1.0, 0.01])
    page = draw_coverage(made)
    assert [goal.met for goal in page.goals] == [True, True]
    assert page.sections[0].tables[0].rows[0][-1] == "600 of 601"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with the images of the polymer strip."""
    out = tmp_path_factory.mktemp("coverage")
    render(CaseJob(str(out), "coverage", "sketch", "polymer"))
    return out


def test_a_draw_is_the_same_whenever_it_is_read_and_differs_in_all_that_is_recorded(folder):
    study, store = make_study("coverage", "sketch"), StudyStore(folder)
    case = next(case for case in study.cases if case.key == "polymer-ordinary/0000")
    rendering = study.rendering("polymer")
    one, again = (case_experiment(store, rendering, case) for _ in range(2))
    other = case_experiment(store, rendering, replace(case, seed=case.seed + 1))
    still = case_experiment(store, rendering, replace(case, noise=0.0, disturbance=Disturbance()))
    assert np.array_equal(one.recording.stack.frame(3), again.recording.stack.frame(3))
    assert np.array_equal(one.model.channels[0].values, again.model.channels[0].values)
    assert not np.array_equal(one.recording.stack.frame(3), other.recording.stack.frame(3))
    noise = one.model.channels[0].values - still.model.channels[0].values
    assert 0.2 < np.std(noise) / one.model.channels[0].noise_std < 2.5  # ten values: far outside once in 10 000
    logged = [next(e.drive for e in x.model.prescribed if e.nodes == "RIGHT" and e.component == "x")
              for x in (one, still)]
    assert np.abs(logged[0].values - logged[1].values).max() > 0.0 == logged[0].values[0]
    bright = np.mean(one.recording.stack.frame(3)) / np.mean(still.recording.stack.frame(3))
    assert bright != pytest.approx(1.0, abs=1e-4) and one.recording.stack.frame(0).mean() == pytest.approx(
        still.recording.stack.frame(0).mean(), abs=0.1)  # the reference keeps its light


def test_a_case_identifies_by_the_estimator_that_it_asks_for(folder):
    job = CaseJob(str(folder), "coverage", "sketch", "polymer-generalised/0000")
    run_case(job)
    found = StudyStore(folder).read_case(job.key)
    assert found.converged and found.facts["estimator"] == "generalised"
    assert np.abs(found.normalised_error).max() < 5.0  # one draw, two parameters
    truth = json.loads((folder / "experiments" / "polymer" / "truth.json").read_text())
    assert truth["parameters"]["sheet.E"] == 2000.0
