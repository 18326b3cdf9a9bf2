"""Standard deviations count what the model leaves unexplained, and nothing where it is right."""

from dataclasses import replace

import numpy as np
import pytest

import idic
from idic.experiment_file import load_experiment
from idic.identification import Analysis, Component, DiscrepancySystem, identify, joined, reason_against
from idic.identification.discrepancy.variances import estimate
from idic.virtual_tests import write_images
from idic_studies.cases.misfit import DISTURBANCE, NOISE_GV
from idic_studies.cases.realisation import realisation
from idic_studies.examples.misfit_worlds import draw, virtual_test
from idic_studies.examples.open_hole_strip import write_clean


def recorded(folder, world, seed):
    """A draw of a world as the laboratory records it, and its truth in the user's units."""
    drawn = draw(world, seed)
    test = virtual_test(drawn)
    experiment = load_experiment(folder, drawn.overrides, stack=write_clean(folder, test))
    return realisation(experiment, NOISE_GV[drawn.elastic], DISTURBANCE, 7 + seed), test.truth, drawn


@pytest.fixture(scope="module")
def wrong(tmp_path_factory):
    """A strip of 2 mm that is three-dimensional, identified in plane stress."""
    experiment, truth, _ = recorded(tmp_path_factory.mktemp("solid"), "solid", 0)
    found = identify(experiment)
    return found, found.result, truth


@pytest.fixture(scope="module")
def right(tmp_path_factory):
    """The same strip where the model differs by the mesh alone."""
    experiment, truth, _ = recorded(tmp_path_factory.mktemp("metal"), "metal", 0)
    found = identify(experiment)
    return found, found.result, truth


def test_a_wrong_model_has_wider_intervals_that_hold_the_truth(wrong):
    _, result, truth = wrong
    z_noise = {name: (result["parameters"][name]["value"] - value) / result["parameters"][name]["std_noise"]
               for name, value in truth.items()}
    assert result["discrepancy"]["significant"]
    assert max(abs(z) for z in z_noise.values()) > 4.0  # by noise alone the yield stress is excluded
    for name, value in truth.items():
        low, high = result["parameters"][name]["ci95"]
        assert low < value < high, name


def test_the_standard_deviation_is_that_of_noise_and_model_together(wrong):
    for entry in wrong[1]["parameters"].values():
        assert entry["std_model"] > 0.0
        assert entry["std"] == pytest.approx(np.hypot(entry["std_noise"], entry["std_model"]), rel=1e-12)


def test_a_right_model_keeps_the_standard_deviations_of_noise(right):
    _, result, _ = right
    assert not result["discrepancy"]["significant"]
    for entry in result["parameters"].values():
        assert entry["std_model"] == 0.0 and entry["std"] == entry["std_noise"]


def test_the_parameters_part_of_the_sums_is_that_of_the_identification(wrong):
    """The fields are further columns: they change nothing of the others."""
    found = wrong[0]
    system, point = found.discrepancy, found.point
    n = system.n
    scaled = Analysis(found.experiment, found.parameters, point, found.weights.image_noise).scaled
    np.testing.assert_allclose(system.M[:n, :n], point.system.M, rtol=1e-12)
    inside = scaled.slopes[:, None] * system.noise[:n, :n] * scaled.slopes
    np.testing.assert_allclose(inside, scaled.noise, rtol=1e-9)  # no priors here; sums in another order


def test_the_values_do_not_depend_on_the_discrepancy(wrong):
    found = wrong[0]
    entries = wrong[1]["parameters"]
    assert all(entries[name]["value"] == found.parameters[name].shown for name in entries)


@pytest.mark.slow  # 10 s of CPU time
def test_a_run_states_the_same_standard_deviations_as_memory(tmp_path):
    drawn = draw("solid", 3)
    test = virtual_test(drawn)
    (tmp_path / "experiment" / "images").mkdir(parents=True)
    stack = write_clean(tmp_path / "experiment", test)
    clean = load_experiment(tmp_path / "experiment", drawn.overrides, stack=stack)
    experiment = realisation(clean, 2.0, DISTURBANCE, 1)
    images = [np.clip(np.rint(experiment.recording.stack.frame(k)), 0, 255).astype(np.uint8)
              for k in range(stack.n_frames)]
    write_images(tmp_path / "experiment", images)
    overrides = drawn.overrides | {"camera.noise_std_gv": 2.02}
    result = idic.identify(tmp_path / "experiment", tmp_path / "run", overrides=overrides)
    written = type(stack)(np.array(images, dtype=np.float32))
    memory = identify(load_experiment(tmp_path / "experiment", overrides, stack=written)).result
    assert result["discrepancy"]["significant"]
    for name, entry in result["parameters"].items():
        assert entry["std_model"] > entry["std_noise"] > 0.0
        # the last steps differ by less
        assert entry["std"] == pytest.approx(memory["parameters"][name]["std"], rel=1e-3)


def test_height_images_say_that_noise_alone_is_counted(right):
    found = right[0]
    assert "noise alone" in reason_against(replace(found.experiment, recording=replace(found.experiment.recording,
                                                                                       quantity="height")), found.point)
    assert reason_against(found.experiment, found.point) == ""


# variances -------------------------------------------------------------------------------------------
N, Q, ROWS = 3, 30, 400


def random_problem(rng, std, scatter=1.0, reach=1.0):
    """Normal equations of a linear problem whose discrepancy has this standard deviation, and the true parameters'
    error. The data scatter by `scatter` times their stated noise; the fields move them by 1 to `reach` per unit."""
    J = rng.standard_normal((ROWS, N + Q)) @ (np.eye(N + Q) + 0.5 * rng.standard_normal((N + Q, N + Q))
                                              / np.sqrt(N + Q))
    J[:, N:] *= np.geomspace(1.0, reach, Q)
    J[:, :N] += 0.5 * J[:, N:2 * N]  # the parameters absorb a part of it
    root = np.linalg.cholesky(0.5 * np.eye(Q) + 0.5)
    amplitudes = std * root @ rng.standard_normal(Q)
    data = J[:, N:] @ amplitudes + scatter * rng.standard_normal(ROWS)
    M, b = J.T @ J, J.T @ data
    P = np.linalg.inv(M[:N, :N])
    error = P @ b[:N]  # of the estimate of parameters that are zero
    b = b - M[:, :N] @ error
    system = DiscrepancySystem(("a", "b", "c"), M, b, M, (Component("motion", root),), {"motion": 1.0})
    return system, P, error


def test_restricted_likelihood_finds_the_variance_that_parameters_have_partly_absorbed():
    rng = np.random.default_rng(1)
    std, found, inside = 0.3, [], []
    for _ in range(60):
        system, P, error = random_problem(rng, std)
        variances = estimate(system, P, np.ones(N), system.b[:N])
        found.append(variances.std["motion"])
        covariance = P + P @ variances.covariance @ P
        inside.append(np.abs(error) < 1.96 * np.sqrt(np.diagonal(covariance)))
    # one common and thirty own amplitudes: a standard deviation is known to 13 % from one draw, 2 % from 60
    assert np.mean(found) == pytest.approx(std, rel=0.08)
    assert 0.90 <= np.mean(inside) <= 0.99  # 180 intervals, alike in threes: 95 % to 2.5 %


def test_what_is_finer_than_the_fields_is_not_taken_for_a_smooth_discrepancy():
    rng = np.random.default_rng(4)
    scatter, found, widths, inside = 3.0, [], [], []
    for _ in range(40):
        system, P, error = random_problem(rng, 0.0, scatter, reach=30.0)
        variances = estimate(system, P, np.ones(N), system.b[:N])
        found.append(np.hypot(1.0, variances.std["rough"]))
        std = np.sqrt(np.diagonal(P + P @ variances.covariance @ P))
        widths.append(std / np.sqrt(np.diagonal(P)))
        inside.append(np.abs(error) < 1.96 * std)
    # thirty directions know a standard deviation to 13 %, of 40 draws to 2 %; a part of it may go to the smooth field
    assert np.mean(found) == pytest.approx(scatter, rel=0.08)
    assert np.mean(widths) < 1.2 * scatter
    assert 0.89 <= np.mean(inside) <= 1.0  # 120 intervals: 95 % to 2 %, three times that


def test_a_known_error_of_the_mesh_is_no_discrepancy_and_counts_with_its_size():
    """Beside the noise the data hold one known field, which the parameters and the smooth fields take in part."""
    rng = np.random.default_rng(6)
    without, known, inside = 0, 0, []
    for _ in range(40):
        J = rng.standard_normal((ROWS, N + Q))
        mesh = 0.5 * J @ rng.standard_normal(N + Q) + 0.5 * rng.standard_normal(ROWS)
        data, M = mesh + rng.standard_normal(ROWS), J.T @ J
        P = np.linalg.inv(M[:N, :N])
        error = P @ (J.T @ data)[:N]
        system = DiscrepancySystem(("a", "b", "c"), M, J.T @ data - M[:, :N] @ error, M,
                                   (Component("motion", np.eye(Q)),), {"motion": 1.0})
        told = replace(system, mesh_error=J.T @ mesh)
        without += estimate(system, P, np.ones(N), system.b[:N]).significant
        variances = estimate(told, P, np.ones(N), system.b[:N])
        known += variances.significant
        covariance = P + P @ variances.covariance @ P
        inside.append(np.abs(error) < 1.96 * np.sqrt(np.diagonal(covariance)))
    assert without == 40 and known <= 3  # by noise alone in about one of a hundred
    assert np.mean(inside) > 0.9  # 120 intervals


@pytest.mark.parametrize("size, counts", [(0.5, False), (0.01, True)])
def test_an_error_of_the_mesh_that_the_recording_contradicts_is_not_counted(size, counts):
    """The data hold noise alone; an error that noise hides cannot be contradicted and stays counted."""
    rng = np.random.default_rng(7)
    for _ in range(20):
        J = rng.standard_normal((ROWS, N + Q))
        mesh, M = size * (J @ rng.standard_normal(N + Q) + rng.standard_normal(ROWS)), J.T @ J
        P = np.linalg.inv(M[:N, :N])
        data = rng.standard_normal(ROWS)
        system = DiscrepancySystem(("a", "b", "c"), M, J.T @ data - M[:, :N] @ (P @ (J.T @ data)[:N]), M,
                                   (Component("motion", np.eye(Q)),), {"motion": 1.0}, None, J.T @ mesh)
        variances = estimate(system, P, np.ones(N), system.b[:N])
        beta = P @ (J.T @ mesh)[:N]
        added = P @ variances.covariance @ P
        assert variances.mesh is counts
        if not variances.significant:
            np.testing.assert_allclose(added, np.outer(beta, beta) if counts else 0.0, atol=1e-12)


def test_an_error_of_the_mesh_known_in_size_alone_counts_whatever_its_sign():
    """The recording holds the opposite of what is told, which it would contradict otherwise."""
    rng = np.random.default_rng(8)
    inside = []
    for _ in range(20):
        J = rng.standard_normal((ROWS, N + Q))
        mesh, M = 0.5 * J @ rng.standard_normal(N + Q) + 0.5 * rng.standard_normal(ROWS), J.T @ J
        data, P = rng.standard_normal(ROWS) - mesh, np.linalg.inv(M[:N, :N])
        error, beta = P @ (J.T @ data)[:N], P @ (J.T @ mesh)[:N]
        told = DiscrepancySystem(("a", "b", "c"), M, J.T @ data - M[:, :N] @ error, M,
                                 (Component("motion", np.eye(Q)),), {"motion": 1.0}, None, J.T @ mesh)
        assert not estimate(told, P, np.ones(N), told.b[:N]).mesh
        variances = estimate(replace(told, mesh_size_only=True), P, np.ones(N), told.b[:N])
        added = P @ variances.covariance @ P
        assert variances.mesh and np.all(np.diagonal(added) >= beta**2)
        inside.append(np.abs(error) < 1.96 * np.sqrt(np.diagonal(P + added)))
    assert np.mean(inside) > 0.9  # 60 intervals


def test_noise_alone_is_rarely_taken_for_a_discrepancy():
    rng = np.random.default_rng(2)
    alarms = 0
    for _ in range(150):
        system, P, _ = random_problem(rng, 0.0)
        variances = estimate(system, P, np.ones(N), system.b[:N])
        alarms += variances.significant
        assert variances.significant or not variances.covariance.any()
    assert alarms <= 6  # one in a hundred by design; seven of 150 have a probability of 0.0008


def test_experiments_share_parameters_and_keep_their_own_discrepancy():
    rng = np.random.default_rng(3)
    one, other = (random_problem(rng, 0.1)[0] for _ in range(2))
    names = {"x": {"a": "E", "b": "nu", "c": "x.camera"}, "y": {"a": "E", "b": "nu", "c": "y.camera"}}
    whole = joined({"x": one, "y": other}, ("E", "nu", "x.camera", "y.camera"), names)
    np.testing.assert_allclose(whole.M[:2, :2], one.M[:2, :2] + other.M[:2, :2])
    assert whole.M[2, 3] == 0.0 and not whole.M[4:4 + Q, 4 + Q:].any()
    np.testing.assert_array_equal(whole.M[4:4 + Q, :3], one.M[N:, :N])
    assert [c.name for c in whole.components] == ["x.motion", "y.motion"]
    assert joined({"x": one, "y": "height images"}, ("E",), names) == "y: height images"
