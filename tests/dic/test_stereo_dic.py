"""Free stereo FE-DIC: a known motion in space comes back within the noise that it states; what it passes unchanged."""

from dataclasses import replace

import numpy as np
import pytest

from idic.correlation import in_space
from idic.measure import surface_motion
from idic.measure.dic.surface_smoothing import surface_smoother
from idic.errors import InputError
from idic.experiment_file import load_experiment
from idic.fe import face_cells
from idic.virtual_tests.stereo_plate import PlateTest, Size, plate, write_plate
from idic.virtual_tests.ray_tracing import Scene
from idic.virtual_tests.stereo_rig import rig

SIZE = Size(0.16, (125, 195), (1, 1, 1), (2, 3, 2, 1), (3, 4, 2, 1))


def motion(nodes, amount):
    """Strain of 1 %, a shear, a bend out of the plane of 0.3 mm and a rigid motion."""
    x, y, z = nodes.T
    bend = 0.3 * np.sin(np.pi * x / 28.0) * np.cos(np.pi * y / 40.0)
    return amount * np.column_stack([0.01 * x + 0.004 * y + 0.2, -0.004 * y - 0.1 + 0.001 * x, bend + 0.15 + 0.005 * x])


@pytest.fixture(scope="module")
def experiment(tmp_path_factory):
    true = plate(*SIZE.true)
    scene = Scene(true.nodes, face_cells(true, true.edge_sets["FRONT"]), face_cells(true, true.edge_sets["REST"]))
    frames = np.array([0.0, 0.0, 1.0])
    test = PlateTest(scene, np.array([motion(true.nodes, amount) for amount in frames]), 0.0 * frames, 0.0 * frames,
                     rig(SIZE.shape, SIZE.pixel, SIZE.distance, (-15.0, 15.0)), plate(*SIZE.user), SIZE)
    folder = tmp_path_factory.mktemp("stereo") / "test"
    folder.mkdir()
    return load_experiment(write_plate(folder, test))


def test_a_motion_in_space_comes_back_within_its_noise(experiment):
    found = surface_motion(experiment)
    nodes = experiment.model.mesh.nodes[found.nodes]
    assert np.abs(nodes[:, 2]).max() < 1e-9 and len(nodes) > 60  # the front alone
    still = found.u_mm[1] / found.noise_mm  # a frame at rest
    assert 0.7 < np.sqrt(np.mean(still**2)) < 1.4  # 250 correlated scores, interpolation
    inner = np.hypot(nodes[:, 0], nodes[:, 1]) > 4.0  # faces of 30 degrees leave the round of the hole
    error = found.u_mm[2] - motion(nodes, 1.0)
    # the bend is quadratic over linear faces of 5 mm, 1/8 (pi 5 / 28)^2 0.3 = 0.012 mm at their middles
    assert np.sqrt(np.mean(error[inner, :2] ** 2)) < 0.004
    assert np.sqrt(np.mean(error[inner, 2] ** 2)) < 0.02
    # the axis of sight is seen under 15 degrees: its noise is larger by 1/tan, less what the smoothing takes
    ratio = np.median(found.noise_mm[:, 2]) / np.median(found.noise_mm[:, 1])
    assert 1.5 < ratio < 1.0 / np.tan(np.radians(15.0)) * 1.3
    assert np.abs(found.rms_gv[2] / found.rms_gv[1] - 1.0).max() < 0.2


def test_one_camera_is_not_enough(experiment):
    with pytest.raises(InputError, match="two cameras"):
        surface_motion(replace(experiment, cameras=()))


def test_every_affine_motion_passes_the_smoothing_on_a_curved_surface():
    angle, y = np.meshgrid(np.linspace(0.0, 1.5, 7), np.linspace(0.0, 4.0, 5), indexing="ij")
    nodes = np.column_stack([5 * np.sin(angle.ravel()), y.ravel(), 5 * np.cos(angle.ravel())])
    at = np.arange(35).reshape(7, 5)
    faces = np.zeros((24, 8), int)
    faces[:, :4] = np.stack([at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, 1:]], axis=-1).reshape(-1, 4)
    smoother = surface_smoother(nodes, [(faces, np.ones(24, int))])
    affine = in_space(nodes) @ np.random.default_rng(0).normal(size=(3, 3)) + [1.0, 2.0, 3.0]
    assert np.abs(smoother.operator @ affine).max() < 1e-9 * np.abs(smoother.operator).max() * 100  # rounding
    assert smoother.area_mm2 == pytest.approx(5 * 1.5 * 4, rel=0.01)  # chords of 14 degrees
    wave = np.sin(3.0 * nodes[:, 1])[:, None]
    assert np.abs(smoother.operator @ wave).max() > 0.1
