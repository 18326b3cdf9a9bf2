"""The camera: its conventions, the contract of cameras, and what a fixed pixel sees of its degrees of freedom."""

import numpy as np
import pytest
from camera_contract import CameraContract

from idic.errors import InputError
from idic.images import CAMERA_PARAMETERS, Camera

STEPS = {"pixel_size": 1e-6, "rotation_deg": 1e-4, "shift_col": 1e-3, "shift_row": 1e-3, "k1": 1e-11,
         "tilt_x": 1e-6, "tilt_y": 1e-6}
CAMERAS = {
    "plain": Camera.from_table(0.05, (317.1, 189.5)),
    "everything": Camera.from_table(0.05, (317.0, 189.0), ("-col", "-row"), 12.0, 3e-8, (300.0, 200.0)).with_parameters(
        {"tilt_x": 1e-3, "tilt_y": -2e-3, "shift_col": 3.0}),
    "swapped axes": Camera.from_table(0.1, (10.0, 20.0), ("+row", "+col"), -30.0),
    "mirrored matrix": Camera.from_matrix([[3.0, 20.0], [18.0, -1.0]], (5.0, 6.0), -2e-8, (20.0, 10.0)),
}
cameras = pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS.keys())
POINTS = np.random.default_rng(0).uniform(-5, 5, (30, 2))


def test_mesh_x_points_to_the_right_and_mesh_y_upwards_by_default():
    camera = Camera.from_table(0.5, (100.0, 50.0))
    assert np.allclose(camera.project(np.array([[0, 0], [1, 0], [0, 1]])), [[100, 50], [102, 50], [100, 48]])


def test_a_positive_rotation_turns_the_mesh_axes_counter_clockwise_as_seen():
    camera = Camera.from_table(1.0, (0.0, 0.0), rotation_deg=90.0)
    # x now points up (rows decrease), y to the left
    assert np.allclose(camera.project(np.array([[1.0, 0.0], [0.0, 1.0]])), [[0, -1], [-1, 0]])


def test_the_matrix_is_column_and_row_per_x_and_y():
    camera = Camera.from_matrix([[1.0, 2.0], [3.0, 4.0]], (10.0, 20.0))
    assert np.allclose(camera.project(np.array([[1.0, 0.0], [0.0, 1.0]])), [[11, 23], [12, 24]])


def test_a_solid_is_seen_along_z():
    camera = CAMERAS["everything"]
    assert np.array_equal(camera.project(np.column_stack([POINTS, POINTS[:, 0]])), camera.project(POINTS))


class TestTelecentric(CameraContract):
    cameras, parameters, points, steps = CAMERAS, tuple(CAMERA_PARAMETERS), POINTS, STEPS


@cameras
@pytest.mark.parametrize("name", CAMERA_PARAMETERS)
def test_the_sensitivity_at_a_fixed_pixel_is_a_difference_quotient(camera, name):
    """Both the material point that the pixel shows and its deformed image move with the parameter."""
    gradient = np.array([[1.2, 0.15], [-0.1, 0.9]])

    def displacement(x):  # affine plus a little curvature
        return x @ (gradient - np.eye(2)).T + 0.01 * np.column_stack([x[:, 0] * x[:, 1], x[:, 1] ** 2])

    def local_gradient(x):
        f = np.repeat(gradient[None], len(x), axis=0)
        f[:, 0, 0] += 0.01 * x[:, 1]
        f[:, 0, 1] += 0.01 * x[:, 0]
        f[:, 1, 1] += 0.02 * x[:, 1]
        return f

    pixels = camera.project(POINTS)

    def warped(cam):  # the deformed position of what the fixed reference pixels show
        x = cam.inverse(pixels)
        return cam.project(x + displacement(x))

    h, value = STEPS[name], camera.values()[name]
    ahead, behind = (warped(camera.with_parameters({name: value + s * h})) for s in (1, -1))
    quotient = (ahead - behind) / (2 * h)
    found = camera.fixed_pixel_sensitivity(POINTS, displacement(POINTS), local_gradient(POINTS), name)
    assert np.abs(quotient - found).max() < 1e-5 * max(np.abs(found).max(), 1.0)  # h^2 and rounding / h


@pytest.mark.parametrize("name", CAMERA_PARAMETERS)
def test_without_motion_no_camera_parameter_is_seen(name):
    rigid = np.broadcast_to(np.eye(2), (len(POINTS), 2, 2))
    still = CAMERAS["everything"].fixed_pixel_sensitivity(POINTS, 0 * POINTS, rigid, name)
    scale = np.abs(CAMERAS["everything"].parameter_jacobian(POINTS, name)).max()
    assert np.abs(still).max() < 1e-12 * scale  # rounding


def test_parameters_are_absolute_values():
    camera = Camera.from_table(0.05, (10.0, 20.0), rotation_deg=7.0)
    new = camera.with_parameters({"rotation_deg": 9.0, "pixel_size": 0.06})
    expected = Camera.from_table(0.06, (10.0, 20.0), rotation_deg=9.0)
    assert np.abs(new.project(POINTS) - expected.project(POINTS)).max() < 1e-11  # rounding


@pytest.mark.parametrize("make", [lambda: Camera.from_table(axes=("+col", "-col")), lambda: Camera.from_table(-1.0),
                                  lambda: Camera.from_matrix([[1, 2], [2, 4]])])
def test_an_impossible_camera_is_an_input_error(make):
    with pytest.raises(InputError):
        make()
