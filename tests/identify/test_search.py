"""Far starts: the coarse fit to a measured motion, the values that a law wants tried, and the reach of a step."""

from dataclasses import replace

import numpy as np
import pytest
from twin_runs import ELASTIC, FORCE, GRIPS, Twin, write_folder

from idic.errors import NotConverged
from idic.experiment_file import load_experiment
from idic.identification import CoarseFit, StartTrial, first_free, resolve_stages, search, start, wants_search
from idic.identification.coarse import MIN_FRAMES, coarse_frames
from idic.identification.start_search import (
    MAX_NEAR_COARSE_MISFIT, MAX_NEAR_MISFIT, MAX_PROMISING_COARSE_MISFIT, stabilised_start, trial_points,
)
from idic.identification.step.parameter_covariance import Scaled
from idic.identification.step.proposal import propose
from idic.identification.step.schedule import BLURRED_STAGE, is_continued
from idic.model import ForwardModel, Stage, build_forward, selected_frames, solve
from idic.parameters import USUAL_MAX_STEP, Parameter, ParameterSet
from idic.run import RunStore, SerialRunner
from idic.run.prepared.prepare import ingest, prepare
from idic.run.prepared.session import open_session
from idic.run.search import SEARCH_FILE, TrialJob, fit_trial, start_values

TRUTH = {"BODY.E": 2000.0, "BODY.nu": 0.35}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return write_folder(tmp_path_factory.mktemp("search") / "test", Twin(), ELASTIC + GRIPS + FORCE)


@pytest.fixture(scope="module")
def measured(folder):
    """An experiment, and the motion in px that its own model has at the true parameters."""
    experiment = load_experiment(folder)
    parameters = experiment.model.parameters.with_values(TRUTH)
    found = solve(build_forward(experiment), parameters)
    channels = tuple(replace(channel, values=found.channels[:, c]) for c,
                     channel in enumerate(experiment.model.channels))
    nodes, camera = experiment.model.mesh.nodes, experiment.model.camera
    u_px = np.array([camera.project(nodes + u) - camera.project(nodes) for u in found.u])
    return replace(experiment, recording=replace(experiment.recording, stack=None),
                   model=replace(experiment.model, channels=channels)), u_px


def with_trials(experiment, name, trials):
    changed = (replace(p, start_values=trials) if p.name == name else p for p in experiment.model.parameters.values())
    return replace(experiment, model=replace(experiment.model, parameters=ParameterSet(changed)))


def test_a_coarse_fit_finds_the_parameters_of_a_motion_from_any_distance(measured):
    """No image, no grain of a pattern: from five times the modulus and a wrong Poisson's ratio."""
    experiment, u_px = measured
    fit = CoarseFit.of(experiment, u_px, {"BODY.E": 10e3, "BODY.nu": 0.05}, 15)
    assert fit.misfit < 1e-2
    for name, value in TRUTH.items():
        assert fit.values[name] == pytest.approx(value, rel=1e-2)


def test_a_coarse_fit_moves_measured_edges_as_they_were_measured(measured, tmp_path):
    """At rest no parameter does anything, and every start would be as good as another."""
    edges = "".join(f'\n[[boundary]]\nnodes = "{name}"\nu = "measured"\n' for name in ("LEFT", "RIGHT"))
    given, u_px = measured
    experiment = load_experiment(write_folder(tmp_path / "test", Twin(), ELASTIC + edges + FORCE))
    experiment = replace(experiment, recording=replace(experiment.recording, stack=None),
                         model=replace(experiment.model, channels=given.model.channels))
    fit = CoarseFit.of(experiment, u_px, {"BODY.E": 10e3, "BODY.nu": 0.05}, 15)
    assert fit.misfit < 1e-2
    for name, value in TRUTH.items():
        assert fit.values[name] == pytest.approx(value, rel=1e-2)


def test_a_test_of_few_frames_can_be_searched(measured):
    experiment, u_px = measured
    frames = list(range(MIN_FRAMES - 1))
    fit = CoarseFit.of(selected_frames(experiment, frames), u_px[frames], {"BODY.E": 4e3}, 10)
    assert fit.part == 1.0 and fit.values["BODY.E"] == pytest.approx(2000.0, rel=1e-2)


def test_bounds_that_admit_no_value_of_the_law_leave_the_start(measured):
    experiment = with_trials(measured[0], "BODY.nu", (0.45, 0.49))
    narrow = {name: replace(p, bounds=(0.1, 0.4)) if name == "BODY.nu" else p for name, p in
              experiment.model.parameters.items()}
    experiment = replace(experiment, model=replace(experiment.model, parameters=ParameterSet(narrow.values())))
    assert [trial.label for trial in trial_points(experiment)] == ["start, continued"]


def test_nodes_that_were_not_measured_and_excluded_frames_do_not_count(measured):
    experiment, u_px = measured
    spoilt = u_px.copy()
    spoilt[3] += 50.0
    holes = spoilt.copy()
    holes[:, ::2] = np.nan
    fit = CoarseFit.of(replace(experiment, recording=replace(experiment.recording, excluded=(3,))), holes,
                       {"BODY.E": 4e3}, 15)
    assert fit.misfit < 1e-2 and fit.points < np.isfinite(u_px).sum()


def test_the_channels_alone_can_be_fitted(measured):
    experiment, _ = measured
    fit = CoarseFit.of(experiment, None, {"BODY.E": 4e3, "BODY.nu": 0.35}, 15)
    assert fit.misfit < 1e-2


def test_fewer_frames_are_simulated_of_a_long_test(measured, monkeypatch):
    experiment, _ = measured
    monkeypatch.setattr("idic.identification.coarse.MAX_FRAMES", 2)
    frames = coarse_frames(experiment.model)
    assert frames[0] == experiment.model.reference and frames[-1] == experiment.model.n_frames - 1 and len(frames) == 3
    thinned = selected_frames(experiment, frames)
    assert np.array_equal(thinned.model.times, experiment.model.times[frames])
    np.testing.assert_allclose(solve(build_forward(thinned), thinned.model.parameters).u,
                               solve(build_forward(experiment), experiment.model.parameters).u[frames],
                               atol=1e-9)  # elastic


def breaking(monkeypatch, frames):
    """Let simulations with a modulus E break down after so many frames, a function of E."""
    whole = ForwardModel.march

    def march(self, parameters, *others):
        for state in whole(self, parameters, *others):
            if state.frame >= frames(parameters["BODY.E"].value):
                raise NotConverged("it breaks down here")
            yield state

    monkeypatch.setattr(ForwardModel, "march", march)


def test_a_simulation_that_breaks_down_is_compared_as_far_as_it_came(measured, monkeypatch):
    """Above 3000 MPa the last frame is not reached, above 6000 no more than what says where to go."""
    experiment, u_px = measured
    last = experiment.model.n_frames - 1
    assert last >= MIN_FRAMES
    breaking(monkeypatch, lambda E: last + 1 if E < 3e3 else last if E < 6e3 else MIN_FRAMES)
    first = CoarseFit.of(experiment, u_px, {"BODY.E": 8e3}, 1)
    assert np.isfinite(first.phi) and first.part == pytest.approx((MIN_FRAMES - 1) / last)
    fit = CoarseFit.of(experiment, u_px, {"BODY.E": 8e3}, 15)
    assert fit.part == 1.0 and fit.misfit < 1e-2 and fit.values["BODY.E"] == pytest.approx(2000.0, rel=1e-2)


def test_frames_that_were_not_reached_count_with_the_motion_that_is_missing(measured, monkeypatch):
    experiment, u_px = measured
    whole = CoarseFit.of(experiment, u_px, TRUTH, 1)
    last = experiment.model.n_frames - 1
    breaking(monkeypatch, lambda E: last)
    fit = CoarseFit.of(experiment, u_px, TRUTH, 1)
    missing = 4.0 * np.nansum((u_px[last] - u_px[last - 1]) ** 2)  # weighed by half a pixel
    channel = experiment.model.channels[0].values
    missing += (channel[last] - channel[last - 1]) ** 2 / (0.01 * np.abs(channel).max()) ** 2
    assert fit.phi - whole.phi == pytest.approx(missing, rel=1e-6)


def test_a_simulation_that_breaks_down_at_once_says_nothing(measured, monkeypatch):
    experiment, u_px = measured
    breaking(monkeypatch, lambda E: MIN_FRAMES - 1)
    fit = CoarseFit.of(experiment, u_px, TRUTH, 3)
    assert fit.phi == np.inf and fit.part == 0.0


def fits(misfits):
    """A maker of fits whose misfits are told: by label."""
    def fit_all(trials):
        return [CoarseFit({"BODY.E": float(k)}, misfits[trial.label] ** 2 * 100, 100, trial.evaluations)
                for k, trial in enumerate(trials)]
    return fit_all


def test_a_start_that_is_near_is_left_alone(measured):
    experiment = with_trials(measured[0], "BODY.E", (1000.0, 2500.0))
    misfits = {"start": 0.9 * MAX_PROMISING_COARSE_MISFIT, "start, given model": 0.9 * MAX_NEAR_MISFIT}
    found = search(experiment, fits(misfits))
    assert found.values == experiment.model.parameters.as_values() and not found.moved
    assert [label for label, _ in found.tried] == ["start", "start, given model"]


def test_a_start_that_only_the_simplified_model_calls_near_is_not_left_alone(measured):
    experiment = with_trials(measured[0], "BODY.E", (1000.0, 2500.0))
    misfits = {"start": 0.9 * MAX_PROMISING_COARSE_MISFIT, "start, given model": 1.1 * MAX_NEAR_MISFIT,
               "start, continued": 5.0, "BODY.E = 1000": 1.5, "BODY.E = 2500": 9.0}
    said = []
    found = search(experiment, fits(misfits), said.append)
    assert found.moved and found.values == {"BODY.E": 1.0}
    assert said[1] == f"search 2: start, given model: misfit {1.1 * MAX_NEAR_MISFIT:.3g} after 1 evaluation"
    assert len(said) == len(found.tried) == 5


def test_the_best_trials_are_continued_and_the_best_of_them_is_the_start(measured):
    experiment = with_trials(measured[0], "BODY.E", (1000.0, 1800.0, 2500.0))
    begin = experiment.model.parameters["BODY.E"].value
    misfits = {"start": 50.0, "start, continued": 40.0, "BODY.E = 1000": 9.0, "BODY.E = 1800": 20.0,
               "BODY.E = 2500": 10.0, "BODY.E = 1000, continued": 5.0, "BODY.E = 2500, continued": 2.0}
    found = search(experiment, fits(misfits))
    labels = [label for label, _ in found.tried]
    assert ("start, continued" in labels) == (1000.0 <= begin <= 2500.0)
    assert labels[-2:] == ["BODY.E = 1000, continued", "BODY.E = 2500, continued"]
    assert found.values == {"BODY.E": 1.0}  # the second of those continued


def test_no_trial_is_continued_if_one_is_near(measured):
    experiment = with_trials(measured[0], "BODY.E", (1.0, 2.0))
    found = search(experiment, fits({"start": 50.0, "BODY.E = 1": 20.0, "BODY.E = 2": 0.9 * MAX_NEAR_COARSE_MISFIT}))
    assert len(found.tried) == 3 and found.values == {"BODY.E": 1.0}  # the second


def test_where_every_simulation_breaks_down_stabilised_starts_are_tried(measured):
    """Half the value where a law has a stabilising factor, and half of that; the values of a trial itself stay."""
    experiment = with_trials(measured[0], "BODY.E", (1.0, 2.0))
    changed = (replace(p, stabilising_factor=0.5) if p.name == "BODY.nu" else p
               for p in experiment.model.parameters.values())
    experiment = replace(experiment, model=replace(experiment.model, parameters=ParameterSet(changed)))
    asked = []

    def fit_all(trials):
        asked.extend(trials)
        holds = [t.values.get("BODY.nu", 1.0) < 0.1 for t in trials]
        return [CoarseFit(dict(t.values), 100.0 if whole else 1e6, 100, t.evaluations, 1.0 if whole else 0.3)
                for t, whole in zip(trials, holds, strict=True)]

    found = search(experiment, fit_all)
    nu = experiment.model.parameters["BODY.nu"].value
    assert stabilised_start(experiment, 1) == {"BODY.nu": 0.5 * nu}
    wanted = [{"BODY.nu": part * nu, "BODY.E": E} for part in (0.5, 0.25) for E in (1.0, 2.0)]
    assert 0.1 < 0.5 * nu < 0.2 and [dict(t.values) for t in asked if "stabilised" in t.label] == wanted
    assert found.values["BODY.nu"] < 0.1
    assert not stabilised_start(measured[0], 1)


def test_with_a_schedule_the_search_covers_only_the_parameters_of_its_first_stage(measured):
    experiment, u_px = measured
    staged = replace(with_trials(experiment, "BODY.E", (1000.0, 2500.0)), stages=(Stage(("BODY.nu",)), Stage("all")))
    assert first_free(staged) == ("BODY.nu",) and not wants_search(staged)
    staged = replace(staged, stages=(Stage(("BODY.E",)), Stage("all")))
    assert wants_search(staged)
    nu = experiment.model.parameters["BODY.nu"].value
    fit = CoarseFit.of(staged, u_px, {"BODY.E": 4e3}, 10)
    assert fit.values["BODY.nu"] == nu and fit.values["BODY.E"] != 4e3


def test_a_stage_goes_on_where_the_last_one_frees_more():
    one, both, other = Stage(("a",)), Stage(("a", "b")), Stage(("b",))
    assert is_continued((one, both), 0) and is_continued((one, other, both), 0)
    assert not is_continued((one, both), 1) and not is_continued((one, other), 0)  # there it is the only one to find a
    assert not is_continued((both, both), 0)


def test_a_start_beyond_the_values_to_be_tried_is_not_among_them(measured):
    experiment = with_trials(measured[0], "BODY.E", (1.0, 2.0))
    assert [trial.label for trial in trial_points(experiment)] == ["BODY.E = 1", "BODY.E = 2"]


def test_a_search_is_made_only_where_a_free_parameter_asks_for_it(measured):
    experiment = with_trials(measured[0], "BODY.E", (1000.0, 2500.0))
    assert wants_search(experiment) and not wants_search(measured[0])
    assert not wants_search(replace(experiment, options=replace(experiment.options, search="never")))
    locked = replace(experiment, model=replace(experiment.model,
                                               parameters=experiment.model.parameters.with_free(["BODY.nu"])))
    assert not wants_search(locked)


def test_a_stage_on_blurred_images_follows_a_search_and_only_a_search(folder):
    experiment = with_trials(load_experiment(folder), "BODY.E", (1000.0, 2500.0))
    stages = resolve_stages(experiment)
    assert [stage.lowpass_px for stage in stages] == [BLURRED_STAGE.lowpass_px, None]
    assert start(experiment).schedule.stage == 1 and start(experiment, searched=True).schedule.stage == 0
    asked = replace(experiment, options=replace(experiment.options, search="never"))
    assert len(resolve_stages(asked)) == 1 and start(asked).schedule.stage == 0


def test_in_a_run_the_search_is_kept_and_repeated_to_the_last_bit(folder, tmp_path, monkeypatch):
    path, run = folder, tmp_path / "run"
    experiment = load_experiment(path)
    store = RunStore(run)
    with store.claim(experiment.recording.identity):
        ingest(store, experiment, SerialRunner())
        prepare(str(run), str(path), {}, SerialRunner())
        session = open_session(run, SerialRunner(), "direct")
        assert start_values(session) is None  # nothing of this law asks for it
        monkeypatch.setattr("idic.run.search.wants_search", lambda experiment: True)
        monkeypatch.setattr("idic.identification.start_search.MAX_NEAR_MISFIT", 0.0)
        monkeypatch.setattr("idic.identification.start_search.trial_points",
                            lambda experiment: [StartTrial("far", {"BODY.E": 5e3}, 3),
                                                 StartTrial("near", {"BODY.E": 2200.0}, 3)])
        first = start_values(session)
        again = start_values(session)  # from what is kept
        kept = fit_trial(TrialJob(str(run), 1, StartTrial("far", {"BODY.E": 5e3}, 3)))
        store.remove("search/01")
        assert fit_trial(TrialJob(str(run), 1, StartTrial("far", {"BODY.E": 5e3}, 3))) == kept
        chunk = next(path for path in (store.group("search/01") / "facts").rglob("*") if path.name != "zarr.json"
                     and path.is_file())
        chunk.write_bytes(chunk.read_bytes()[:-3])
        assert fit_trial(TrialJob(str(run), 1, StartTrial("far", {"BODY.E": 5e3}, 3))) == kept  # computed anew
    assert first == again and (run / SEARCH_FILE).exists()
    assert first["BODY.E"] == pytest.approx(2000.0, rel=0.05)  # the motion of noisy images, and a force


def test_a_parameter_with_a_small_max_step_stops_there_and_the_others_do_not():
    M = np.array([[4.0, 1.0], [1.0, 9.0]]) * 1e4
    step = np.array([0.3, -0.2])
    scaled = Scaled(("a", "b"), M, M @ step, M, np.ones(2))
    parameters = ParameterSet([Parameter("a", 1.0, free=True, transform="log", max_step=0.05),
                               Parameter("b", 1.0, free=True, transform="log")])
    taken = propose(scaled, scaled.spectrum(), np.full(2, 0.01), parameters, 0.0)
    assert taken.delta[0] == pytest.approx(0.05)
    assert taken.delta[1] == pytest.approx((scaled.b[1] - M[1, 0] * 0.05) / M[1, 1])  # solved again
    assert taken.largest == pytest.approx(0.3) and not taken.pinned  # convergence is judged by the whole step
    halved = propose(scaled, scaled.spectrum(), np.full(2, 0.01), parameters, 0.0, clip=0.175)
    assert halved.delta[0] == pytest.approx(0.025)


def test_a_parameter_with_a_large_max_step_is_measured_by_it():
    """Twice the usual reach: half the ridge of the other, and twice the length before anything is limited."""
    M = np.diag([1.0, 1.0]) * 1e4
    parameters = ParameterSet([Parameter("a", 1.0, free=True, transform="log", max_step=2 * USUAL_MAX_STEP),
                               Parameter("b", 1.0, free=True, transform="log")])

    def taken(step):
        scaled = Scaled(("a", "b"), M, M @ np.array(step), M, np.ones(2))
        return propose(scaled, scaled.spectrum(), np.full(2, 0.01), parameters, 0.0)

    assert not taken([0.6, 0.1]).clipped
    both = taken([1.4, 0.7])  # a ridge k: 1.4 / (1 + k / 4) = 0.7 for the one, 0.7 / (1 + k) for the other
    assert both.clipped and both.delta[0] == pytest.approx(0.7, rel=0.02)
    assert both.delta[1] == pytest.approx(0.7 / (1.0 + 4.0), rel=0.05)
