"""Free stereo FE-DIC: a known motion in space comes back within the noise that it states; what it passes unchanged."""

from dataclasses import replace

import numpy as np
import pytest

from idic.correlation import CorrelationContext, Weights, build_experiment_reference, in_space
from idic.measure import SeenInSpace, surface_motion
from idic.measure.dic.surface_smoothing import surface_smoother
from idic.errors import InputError
from idic.experiment_file import load_experiment
from idic.parameters import Parameter, ParameterSet
from idic.virtual_tests import PlateSize, PlateTest, Rig, Scene

SIZE = PlateSize(0.16, (125, 195), (1, 1, 1), (2, 3, 2, 1), (3, 4, 2, 1))


def motion(nodes, amount):
    """Strain of 1 %, a shear, a bend out of the plane of 0.3 mm and a rigid motion."""
    x, y, z = nodes.T
    bend = 0.3 * np.sin(np.pi * x / 28.0) * np.cos(np.pi * y / 40.0)
    return amount * np.column_stack([0.01 * x + 0.004 * y + 0.2, -0.004 * y - 0.1 + 0.001 * x, bend + 0.15 + 0.005 * x])


@pytest.fixture(scope="module")
def experiment(tmp_path_factory):
    true = SIZE.true_mesh
    scene = Scene(true.nodes, true.face_cells(true.edge_sets["FRONT"]), true.face_cells(true.edge_sets["REST"]))
    frames = np.array([0.0, 0.0, 1.0])
    test = PlateTest(scene, np.array([motion(true.nodes, amount) for amount in frames]), 0.0 * frames, 0.0 * frames,
                     Rig.around(SIZE.shape, SIZE.pixel, SIZE.distance, (-15.0, 15.0)), SIZE.user_mesh, SIZE)
    folder = tmp_path_factory.mktemp("stereo") / "test"
    folder.mkdir()
    return load_experiment(test.write(folder))


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


def contexts(experiment):
    """The cameras of a point, as a report has them."""
    weights = Weights(1.0, 1.0, np.zeros(0), np.zeros(0))
    return [CorrelationContext(view, view.model.parameters, (), (), view.model.camera,
                               build_experiment_reference(view, view.model.camera), weights, np.zeros((0, 0)))
            for view in experiment.views]


def test_the_fields_of_a_report_are_this_measurement_with_draws_of_its_noise(experiment):
    cameras = contexts(experiment)
    seen, whole = SeenInSpace.of(cameras), surface_motion(experiment)
    true = motion(experiment.model.mesh.nodes, 1.0)
    measured = seen.motion((0, 2), lambda frame: true)
    assert (measured[0, whole.nodes] == 0.0).all()
    # another start of the same equations: within the last step
    assert np.nanmax(np.abs(measured[1, whole.nodes] - whole.u_mm[2])) < 0.2 * np.nanmedian(whole.noise_mm)
    unseen = np.setdiff1d(np.arange(len(true)), whole.nodes)
    assert len(unseen) and np.isnan(measured[1, unseen]).all()
    draws = seen.noise_samples(400)[:, whole.nodes]
    ratio = np.std(draws, axis=0) / whole.noise_mm  # of 400 draws: 3.5 %; frame 2 is strained by 1 %, the draws are not
    assert abs(np.median(ratio) - 1.0) < 0.02 and np.abs(ratio - 1.0).max() < 0.25
    neighbours = np.corrcoef(draws[:, 0, 2], draws[:, 1, 2])[0, 1]
    assert abs(neighbours) > 0.2  # smoothing ties what is side by side
    offset = Parameter(cameras[1].experiment.time_offset, 0.1, "s")
    late = replace(cameras[1], parameters=ParameterSet([*cameras[1].parameters.values(), offset]))
    assert SeenInSpace.of(cameras[:1]) is None and SeenInSpace.of([cameras[0], late]) is None


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
