"""Two steps: a measured motion, then the law fitted to it, weighted by the matrix of the FE-DIC or not."""

from dataclasses import replace

import numpy as np
import pytest
from twin_runs import ELASTIC, FORCE, GRIPS, SHAPE, Twin, clean_images, identify, write_folder

from idic.correlation import MeasuredReference, build_experiment_reference
from idic.errors import InputError
from idic.experiment_file import load_experiment
from idic.identification import in_memory, measured_reference
from idic.identification.free_motion.two_step import measure
from idic.images import ArrayStack, lowpass
from idic.model import build_forward, solve
from idic.report import render_page
from idic.run.reporting.write import load_record
from idic.virtual_tests import Sensor, record

METHODS = ("two_step", "two_step_unweighted")
PLATE = ELASTIC + GRIPS + FORCE


def with_options(experiment, **values):
    return replace(experiment, options=replace(experiment.options, **values))


@pytest.fixture(scope="module")
def clean():
    return clean_images(Twin())


@pytest.fixture(scope="module")
def plate(tmp_path_factory, clean):
    """A noisy recording of a plate, truth on a mesh twice as fine."""
    return load_experiment(write_folder(tmp_path_factory.mktemp("two") / "test", Twin(), PLATE, clean))


def at_truth(experiment):
    return experiment.model.parameters.with_values({f"BODY.{name}": value for name, value in Twin().truth.items()})


# theory -------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("method", METHODS)
def test_exact_displacements_give_the_exact_law(plate, method):
    experiment = with_options(plate, method=method, tolerance=1e-6)
    simulated = solve(build_forward(experiment), at_truth(experiment))
    camera, nodes = experiment.model.camera, experiment.model.mesh.nodes
    motion = np.array([camera.project(nodes + u) - camera.project(nodes) for u in simulated.u])
    force = replace(experiment.model.channels[0], values=simulated.channels[:, 0])
    found = in_memory.identify(replace(experiment, model=replace(experiment.model, channels=(force,))),
                               motion={"camera": motion})
    assert found.state.status == "converged"
    for name, value in Twin().truth.items():  # steps below a millionth of a standard deviation (0.2 %) end it
        assert found.parameters[f"BODY.{name}"].value == pytest.approx(value, rel=1e-6)


def test_the_weighted_share_is_the_quadratic_form_of_the_hessian_without_brightness(plate):
    experiment = with_options(plate, method="two_step")
    image = build_experiment_reference(experiment, experiment.model.camera)
    motion = measure(experiment)
    reference = measured_reference(experiment, image, motion)
    u = 0.9 * reference.filled(3)
    share = reference.compare(experiment, 3, u)
    whole = image.compare(experiment, 3, reference.filled(3))
    H, B = whole.H.toarray(), whole.hb.toarray()
    H -= B @ np.linalg.inv(whole.bb) @ B.T
    known = np.repeat(reference.measured(3), 2)
    H[~known], H[:, ~known] = 0.0, 0.0
    gap = (reference.filled(3) - u).ravel()
    fields = np.random.default_rng(0).normal(size=(len(gap), 3))
    found = share.gram(fields)
    assert np.allclose(found.matrix[:3, :3], fields.T @ H @ fields, rtol=1e-9)
    assert np.allclose(found.rhs[:3], fields.T @ H @ gap, rtol=1e-6)
    assert np.allclose(found.matrix[:3, 3:], 0.0)


def test_weighted_by_the_matrix_noise_enters_as_it_enters_images(plate):
    """c = A^-1 H phi = phi: the covariance is that of the integrated method."""
    image = build_experiment_reference(plate, plate.model.camera)
    still = image.compare(plate, 0, np.zeros((plate.model.mesh.n_nodes, 2)))
    n = 2 * plate.model.mesh.n_nodes
    motion = np.where(still.H.diagonal().reshape(-1, 2).min(axis=1)[:, None] > 0, np.zeros(2), np.nan)
    reference = MeasuredReference(image, np.stack([motion] * 2), None, 0.0 * still.H.tocsc())
    share = reference.compare(plate, 1, np.zeros((plate.model.mesh.n_nodes, 2)))
    x, y = plate.model.mesh.nodes.T
    fields = np.column_stack([np.stack([x, y], axis=1).ravel(), np.stack([y * x, -y], axis=1).ravel()])
    fields = np.where(np.repeat(np.isfinite(motion).all(axis=1), 2)[:, None], fields, 0.0)
    c, bright, gram = share.noise(fields)
    assert c.shape == (n, 2) and bright.shape == (2, 2)
    assert np.allclose(gram, share.gram(fields).matrix[:2, :2], rtol=1e-6)


# twins --------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("regularisation", ["none", "mechanical"])
@pytest.mark.parametrize("method", METHODS)
def test_a_noisy_recording_gives_the_law_within_its_error_bars(plate, method, regularisation):
    found = in_memory.identify(with_options(plate, method=method, dic_regularisation=regularisation)).result
    assert found["status"] == "converged" and found["method"] == method and found["estimator"] == "ordinary"
    for name, value in Twin().truth.items():
        entry = found["parameters"][f"BODY.{name}"]
        assert abs(entry["value"] - value) < 4.0 * entry["std"]  # and the mesh's bias, about a tenth of it here


def test_weighted_two_step_identification_agrees_with_the_integrated_one_and_unweighted_scatters_more(plate):
    one = in_memory.identify(with_options(plate, estimator="ordinary")).result["parameters"]
    two, plain = (in_memory.identify(with_options(plate, method=method)).result["parameters"] for method in METHODS)
    for name in ("BODY.E", "BODY.nu"):
        assert abs(two[name]["value"] - one[name]["value"]) < 0.5 * one[name]["std"]
        assert two[name]["std"] == pytest.approx(one[name]["std"], rel=0.1)
        assert plain[name]["std"] > 1.1 * one[name]["std"]


def noise_seen(image, lowpass_px):
    """What a low-pass leaves of the noise that sums against the slopes of a pattern see, in standard deviations.

    The stated standard deviations leave it out: they are too large by as much, at most (a force counts as it is).
    """
    slopes = np.array(np.gradient(lowpass(image.astype(float), lowpass_px)))
    blurred = np.array([lowpass(slope, lowpass_px) for slope in slopes])
    return np.sqrt(np.sum(blurred**2) / np.sum(slopes**2))


@pytest.mark.slow
@pytest.mark.parametrize("method, regularisation", [("two_step", "none"), ("two_step_unweighted", "none"),
                                                    ("two_step_unweighted", "mechanical")])
def test_errors_over_standard_deviations_are_unit_normal(plate, clean, method, regularisation):
    experiment = with_options(plate, method=method, dic_regularisation=regularisation)
    images, force = clean
    scores = []
    for seed in range(100):
        rng = np.random.default_rng(5000 + seed)
        sensor = Sensor(SHAPE, noise_std=Twin().noise, background=25.0)
        stack = ArrayStack(np.array([record(image, sensor, rng) for image in images]))
        channel = replace(experiment.model.channels[0], values=force + rng.standard_normal(len(force)))
        found = in_memory.identify(replace(experiment, recording=replace(experiment.recording, stack=stack),
                                           model=replace(experiment.model, channels=(channel,)))).result["parameters"]
        scores.append([(found[f"BODY.{name}"]["value"] - value) / found[f"BODY.{name}"]["std"]
                       for name, value in Twin().truth.items()])
    z, chance = np.array(scores), 3.0 / np.sqrt(200)
    spread, seen = z.std(axis=0, ddof=1), noise_seen(images[0], experiment.options.lowpass_px)
    assert np.all((seen * (1.0 - chance) < spread) & (spread < 1.0 + chance)), (spread, seen)
    assert np.all(np.abs(z.mean(axis=0)) < 0.3 + 0.3), z.mean(axis=0)  # of 100 draws, and the mesh's bias


# as a run -----------------------------------------------------------------------------------------------
def test_a_run_of_two_steps_has_the_result_of_the_call_and_its_fit_to_the_images(plate, tmp_path):
    path, run = plate.folder, tmp_path / "run"
    state, result = identify(path, run, options__method="two_step")
    called = in_memory.identify(load_experiment(path, {"options.method": "two_step"})).result
    assert state.status == "converged" and result["method"] == "two_step"
    for name in ("BODY.E", "BODY.nu"):
        assert result["parameters"][name]["value"] == pytest.approx(called["parameters"][name]["value"], rel=1e-9)
    assert 0.9 < result["residual"]["image_chi2_dof"] < 1.2
    assert all(frame["status"] == "ok" for frame in result["frames"])
    page = render_page(load_record(run), ())  # without figures
    assert "weighted by the matrix of the FE-DIC" in page


def test_a_camera_that_is_unknown_is_refused(plate):
    path = plate.folder
    overrides = {"options.method": "two_step", "dof": [{"name": "camera.rotation_deg", "value": 0.0}]}
    with pytest.raises(InputError, match="two steps"):
        in_memory.identify(load_experiment(path, overrides))
