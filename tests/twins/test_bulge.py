"""The bulge test: height images of a section rendered without interpolation, and what is identified from them."""

import json

import numpy as np
import pytest
import tifffile

import idic
from idic.correlation import build_experiment_reference, view_of
from idic.experiment_file import load_experiment
from idic.model import build_forward
from idic_studies.examples.bulge import REDUCED_SIZE, Size, write_bulge
from idic_studies.examples.bulge_mesh import REDUCED, Columns
from idic_studies.examples.bulge_model import TRUTH
from idic.virtual_tests.section_images import Section, height_image, material_places
from idic.virtual_tests import roughness, simulate

SMALL = Size(1.328, (60, 192), 8, Columns(12, 10, 20), 5.0, 1, 3e-4)


def bent_section():
    x = np.array([[0.0, 20.0, 9.0], [20.0, 50.0, 35.0], [50.0, 130.0, 90.0]])
    return Section(x, 0.01 * x + 1e-6 * x**3, 80.0 - 2e-3 * x**2)


def test_a_column_shows_the_material_point_that_has_moved_there():
    section, xi = bent_section(), np.linspace(-1, 1, 11)
    shape = np.stack([0.5 * xi * (xi - 1), 0.5 * xi * (xi + 1), 1 - xi**2])
    x, u, h = ((field @ shape).ravel() for field in (section.x, section.u, section.h))
    for side in (1.0, -1.0):
        place, rise = material_places(section, side * (x + u))
        np.testing.assert_allclose(place, side * x, atol=1e-9)
        np.testing.assert_allclose(rise, h, atol=1e-9)
    assert np.isnan(material_places(section, np.array([-150.0, 150.0]))).all()
    one_sided = Section(section.x, section.u, section.h, mirrored=False)
    assert np.isnan(material_places(one_sided, np.array([-1.0]))).all()


def test_the_roughness_is_as_asked_for_and_its_sum_is_the_product_of_matrices():
    pattern = roughness(np.random.default_rng(0), 1.5, 3.0)
    x, y = np.arange(0.0, 400.0, 0.5), np.arange(0.0, 300.0, 0.7)
    f = pattern.heights(x, y)
    assert np.std(f) == pytest.approx(1.5, rel=0.05)
    lag = int(3.0 / 0.5)  # one correlation length: exp(-1)
    assert np.mean(f[:, lag:] * f[:, :-lag]) / np.var(f) == pytest.approx(np.exp(-1.0), abs=0.06)
    one = sum(pattern.amplitude * np.cos(k @ (x[7], y[11]) + p)
              for k, p in zip(pattern.wave, pattern.phase, strict=True))
    assert f[11, 7] == pytest.approx(one, abs=1e-9)


def test_an_undeformed_section_shows_the_roughness():
    still = Section(bent_section().x, np.zeros((3, 3)), np.zeros((3, 3)))
    pattern = roughness(np.random.default_rng(1), 1.5, 3.0)
    column, row = 2.0 * (np.arange(31) - 15.0), 2.0 * (9.5 - np.arange(20))
    image = height_image(still, pattern, column, row)
    np.testing.assert_allclose(image, pattern.heights(column, row), atol=1e-9)


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    return write_bulge(tmp_path_factory.mktemp("bulge") / "small", size=SMALL)


def residuals(experiment):
    """rms residual of every frame at the experiment's parameters, in its unit of height."""
    reference = build_experiment_reference(experiment, experiment.model.camera)
    view, forward = view_of(experiment, experiment.model.camera), build_forward(experiment)
    nodes = experiment.model.mesh.nodes
    rms = []
    for frame, state in enumerate(forward.march(experiment.model.parameters)):
        found = reference.compare_pixels(experiment, frame, view.motion(nodes, state.u), np.zeros(0))
        assert found.valid.mean() > 0.97
        rms.append(float(np.sqrt(np.mean(found.r[found.valid].astype(float) ** 2))))
    return np.array(rms)


def test_the_true_parameters_leave_nothing_in_the_images(small):
    """Sign of the height, units, mirrored half, camera: everything from the file to the residual."""
    rms = residuals(load_experiment(small, dict(TRUTH)))
    assert len(rms) == 9 and rms[0] < 2e-6
    assert rms.max() < 3e-4  # um; of 1.5 um of roughness: the spline's error at the strip's edge


def test_a_simulated_section_agrees_with_its_model(small, tmp_path):
    imitation = simulate(small, tmp_path / "imitation", noise_std_gv=0.0)
    rms = residuals(load_experiment(imitation))
    assert len(rms) == 9 and rms.max() < 1e-3  # um; a finer roughness than the example's
    assert residuals(load_experiment(imitation, {"strip.K": 400.0})).max() > 1e-2


def test_the_folder_is_complete_and_repeatable(small, tmp_path):
    folder = small.parent
    image = tifffile.imread(folder / "images" / "frame_008.tif")
    assert image.dtype == np.float32 and image.shape == SMALL.shape and 80.0 < image.mean() < 95.0
    truth = json.loads((folder / "truth.json").read_text())
    assert truth["parameters"] == TRUTH and truth["same_mesh"]
    started = load_experiment(small).model.parameters
    for name, value in TRUTH.items():
        assert started[name].free and started[name].shown == pytest.approx(1.3 * value, rel=1e-5)
    write_bulge(tmp_path / "again", size=SMALL)
    assert (tmp_path / "again/images/frame_005.tif").read_bytes() == (folder / "images/frame_005.tif").read_bytes()
    write_bulge(tmp_path / "loud", size=SMALL, noise=0.02)
    loud = tifffile.imread(tmp_path / "loud/images/frame_008.tif")
    assert np.std(loud - image) == pytest.approx(0.02 * 1.5, rel=0.03)


@pytest.mark.slow
def test_five_parameters_from_130_percent(tmp_path):
    write_bulge(tmp_path / "bulge", reduced=True)
    result = idic.identify(tmp_path / "bulge", tmp_path / "run")
    assert result["status"] == "converged" and result["iterations"] <= 7
    for name, tolerance in zip(TRUTH, (1e-5, 2e-3, 1e-4, 1e-3, 1e-3), strict=True):
        # no noise: what the spline makes of 1.3 um pixels, worst for the modulus of the thin strip
        assert result["parameters"][name]["value"] == pytest.approx(TRUTH[name], rel=tolerance), name


@pytest.mark.slow
def test_the_errors_lie_within_the_stated_standard_deviations(tmp_path):
    assert REDUCED_SIZE.columns == REDUCED
    write_bulge(tmp_path / "bulge", reduced=True, noise=0.01, seed=3)
    result = idic.identify(tmp_path / "bulge", tmp_path / "run")
    # the noise of the reference is in all frames: six seeds lie between 0.990 and 1.003, 0.5 % rms apart
    assert result["residual"]["image_chi2_dof"] == pytest.approx(1.0, abs=0.02)
    for name, value in TRUTH.items():
        entry = result["parameters"][name]
        assert abs(entry["value"] - value) < 4.0 * entry["std"], name
