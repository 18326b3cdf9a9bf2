"""An identification in memory begins every simulation at the accepted one, and simulates no point twice."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from twin_runs import ELASTIC, FORCE, GRIPS, Twin, write_folder

from idic.diagnose import JUDGEMENT, residual_evidence, thinned
from idic.diagnose.refits.fitted_model import FittedModel
from idic.diagnose import Fit
from idic.diagnose.residual.residual_evidence import simulated
from idic.experiment_file import load_experiment
from idic.identification import kept_simulation as paths
from idic.identification import identify
from idic.model import ForwardModel, Stage


@pytest.fixture(scope="module", params=["grips as logged", "grips with noise"])
def experiment(tmp_path_factory, request):
    grips, noise = GRIPS, 0.0
    if request.param == "grips with noise":
        grips, noise = GRIPS.replace('"grip_mm" }', '"grip_mm", noise_std = 0.0005 }'), 0.0005
    file = write_folder(tmp_path_factory.mktemp("kept") / "case", Twin(grip_noise=noise), ELASTIC + grips + FORCE)
    text = file.read_text()
    if "noise_std_gv" not in text:
        file.write_text(text.replace("[camera]\n", "[camera]\nnoise_std_gv = 2.0\n"))
    return load_experiment(file)


@pytest.fixture
def marches(monkeypatch):
    """Whether each simulation had a warm start."""
    march, begun = ForwardModel.march, []

    def counted(self, parameters, names=(), local=None, steps=None, influence=False, warm_start=None, **options):
        begun.append(warm_start is not None)
        return march(self, parameters, names, local, steps, influence, warm_start, **options)

    monkeypatch.setattr(ForwardModel, "march", counted)
    return begun


def test_no_point_is_simulated_twice_and_every_one_but_the_first_starts_warm(experiment, marches):
    found = identify(replace(experiment, stages=(Stage("all", lowpass_px=2.0), Stage("all"))))
    seen = [tuple(sorted(entry["values"].items())) for entry in found.state.history]
    points = len(seen) if found.local.size else len(set(seen))  # unknowns of the frames move where the others stand
    assert found.state.status == "converged" and len(set(seen)) < len(seen)  # the second stage looked again
    assert marches == [False] + [True] * (points - 1)


def test_without_memory_the_answer_is_the_same(experiment, marches, monkeypatch):
    kept = identify(experiment)
    monkeypatch.setattr(paths, "MAX_KEPT_BYTES", 0.0)
    other = identify(experiment)
    assert kept.path is not None and other.path is None and kept.state.evaluations == other.state.evaluations
    stds = {name: entry["std"] for name, entry in kept.result["parameters"].items()}
    for name in kept.parameters.free:
        assert abs(kept.parameters[name].value - other.parameters[name].value) < 1e-4 * stds[name]


def test_kept_fields_equal_those_of_a_new_simulation(experiment, monkeypatch):
    kept = identify(experiment)
    monkeypatch.setattr(paths, "MAX_KEPT_BYTES", 0.0)
    other = identify(experiment)
    for one, again in zip(simulated(kept), simulated(other), strict=True):
        assert one.frame == again.frame
        np.testing.assert_allclose(one.u, again.u, atol=1e-7)
        np.testing.assert_allclose(one.du, again.du, rtol=1e-3, atol=1e-9)
    assert all(response.du.shape[-1] == 0 for response in simulated(kept, null=False))


def test_generalised_least_squares_alone_end_at_the_same_place_from_a_near_start(experiment):
    found = identify(experiment)
    assert found.state.generalised
    near = {name: 1.001 * found.parameters[name].value for name in found.parameters.free}
    values = experiment.model.parameters.with_values(near)
    other = identify(replace(experiment, model=replace(experiment.model, parameters=values)), estimator="generalised")
    assert other.state.status == "converged" and other.state.evaluations < found.state.evaluations
    for name in found.parameters.free:
        std = found.result["parameters"][name]["std"]
        assert abs(found.parameters[name].value - other.parameters[name].value) < 0.1 * std


def test_a_fit_to_a_copy_of_the_recording_simulates_nothing_where_first_order_tells_its_points(experiment, marches):
    found = identify(experiment)
    copy = thinned(experiment, JUDGEMENT, 3)
    values = experiment.model.parameters.with_values(found.parameters.as_values())
    copy = replace(copy, model=replace(copy.model, parameters=values), stages=())
    marches.clear()
    whole = identify(copy, found.local)
    assert len(marches) > 1
    marches.clear()
    foreseen = identify(copy, found.local, begun=found.path, foreseen=True)
    assert marches == [] and foreseen.state.status == "converged"
    assert foreseen.path.origin.values == found.path.values
    for name in found.parameters.free:
        std = found.result["parameters"][name]["std"]
        assert abs(foreseen.parameters[name].value - whole.parameters[name].value) < 0.05 * std
        assert abs(whole.parameters[name].value - found.parameters[name].value) > 0.1 * std  # the copy has other noise


def test_from_a_far_simulation_the_end_is_simulated(experiment, marches):
    found = identify(experiment)
    far = {name: 1.1 * found.parameters[name].value for name in found.parameters.free}
    values = experiment.model.parameters.with_values(far)
    far_experiment = replace(experiment, model=replace(experiment.model, parameters=values), stages=())
    marches.clear()
    foreseen = identify(far_experiment, foreseen=True)
    assert foreseen.state.status == "converged" and 1 < len(marches) < foreseen.state.evaluations
    for name in found.parameters.free:
        std = found.result["parameters"][name]["std"]
        assert abs(foreseen.parameters[name].value - found.parameters[name].value) < 0.1 * std


def test_the_simulation_behind_a_residual_foresees_motions_and_channels_of_a_fit_nearby(experiment):
    found = identify(experiment)
    values = {name: 1.0001 * value for name, value in found.parameters.as_values().items()}
    local = found.local + 1e-4 * np.arange(len(found.local))[:, None]
    fit = Fit("null", "null", "converged", values, {}, local, found.steps, None, None)
    model = FittedModel(SimpleNamespace(motion_error=None), fit, residual_evidence(found, light=False))
    states = found.forward.march(experiment.model.parameters.with_values(values), (), local)
    assert model.path.origin.values == found.parameters.as_values()
    for at, state in zip(model.path.frames, states, strict=True):
        np.testing.assert_allclose(at.u, state.u, atol=1e-7)
        np.testing.assert_allclose(at.channels, state.channels, rtol=1e-6, atol=1e-5)
