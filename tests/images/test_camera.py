"""The camera: its conventions, the contract of cameras, and what a fixed pixel sees of its degrees of freedom."""

from dataclasses import replace

import numpy as np
import pytest
from camera_contract import CameraContract

from idic.errors import InputError
from idic.images import CAMERA_PARAMETERS, Camera, CameraMotion

STEPS = {"pixel_size": 1e-6, "rotation_deg": 1e-4, "shift_col": 1e-3, "shift_row": 1e-3, "k1": 1e-11,
         "tilt_x": 1e-6, "tilt_y": 1e-6}
CAMERAS = {
    "plain": Camera.from_table(0.05, (317.1, 189.5)),
    "everything": Camera.from_table(0.05, (317.0, 189.0), ("-col", "-row"), 12.0, 3e-8, (300.0, 200.0)).with_parameters(
        {"tilt_x": 1e-3, "tilt_y": -2e-3, "shift_col": 3.0}),
    "swapped axes": Camera.from_table(0.1, (10.0, 20.0), ("+row", "+col"), -30.0),
    "mirrored matrix": Camera.from_matrix([[3.0, 20.0], [18.0, -1.0]], (5.0, 6.0), -2e-8, (20.0, 10.0)),
}
BENT = {"bow_x_load": 2e-2, "arch_y_load": 5e-3, "buckle_y_drift": 1e-2, "lean_x_load": 1e-2}
AMPLITUDES = BENT | {"magnification_load": 2e-2, "turn_at[1]": 0.3, "col_at[1]": 0.7}
KINDS = {"turn_at[1]": "turn", "col_at[1]": "column"}


def moving(amplitudes):
    """The camera with everything before a sheet that bends, in a motion with these amplitudes."""
    motion = CameraMotion(tuple(amplitudes), tuple(KINDS.get(name, name.rpartition("_")[0]) for name in amplitudes),
                          np.array([[0.0, 0.7]] * len(amplitudes)), np.array([*amplitudes.values()]),
                          np.array([[-5.2, -4.2], [5.8, 3.8]]), lever=2.0)
    return replace(CAMERAS["everything"], motion=motion)


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


class TestBentSheet(CameraContract):
    """The camera of a frame in which the sheet bends along both axes and leans."""

    cameras, parameters, points, steps = {"bent": moving(BENT).at(1)}, tuple(CAMERA_PARAMETERS), POINTS, STEPS


@pytest.mark.parametrize("name", AMPLITUDES)
def test_the_derivative_by_every_motion_is_a_difference_quotient(name):
    ahead, behind = (moving(AMPLITUDES | {name: AMPLITUDES[name] + s * 1e-4}).at(1).project(POINTS) for s in (1, -1))
    slope = moving(AMPLITUDES).at(1).parameter_jacobian(POINTS, name)
    assert np.abs((ahead - behind) / 2e-4 - slope).max() < 1e-7 * np.abs(slope).max() + 1e-8  # rounding / 1e-4
    assert np.abs(slope).max() > 0.1


@pytest.mark.parametrize("name", CAMERA_PARAMETERS)
def test_a_moving_camera_has_the_derivatives_of_a_still_one(name):
    camera, step = moving(AMPLITUDES), STEPS[name]
    value = camera.values()[name]
    ahead, behind = (camera.with_parameters({name: value + s * step}).at(1).project(POINTS) for s in (1, -1))
    slope = camera.at(1).parameter_jacobian(POINTS, name)
    assert np.abs((ahead - behind) / (2 * step) - slope).max() < 1e-6 * np.abs(slope).max() + 1e-7  # as the contract


def test_a_bent_sheet_is_seen_as_a_pinhole_sees_it():
    """Points of the face in space, half a thickness in front of the bent middle plane, projected from its centre."""
    distance, thickness, top = 50.0, 0.4, 0.05  # mm
    motion = CameraMotion(("bow_x_load",), ("bow_x",), np.array([[0.0, 1.0]]), np.array([top / distance]),
                          np.array([[-5.0, -4.0], [5.0, 4.0]]), lever=0.5 * distance * thickness)
    camera = replace(CAMERAS["plain"], centre_px=np.array([320.0, 190.0]), motion=motion)
    x, y = POINTS.T
    slope = -2.0 * top * x / 25.0
    normal = np.column_stack([-slope, 0.0 * x, np.ones(len(x))]) / np.hypot(1.0, slope)[:, None]
    face = np.column_stack([x, y, top * (1.0 - (x / 5.0) ** 2)]) + 0.5 * thickness * (normal - [0.0, 0.0, 1.0])
    axis = (camera.centre_px - camera.origin_px) * [0.05, -0.05]  # mm
    seen = axis + (face[:, :2] - axis) * (distance / (distance - face[:, 2]))[:, None]
    # second order: (w / Z)^2 of 100 px
    assert np.abs(camera.at(1).project(POINTS) - camera.project(seen)).max() < 2e-4
    assert np.abs(camera.at(1).project(POINTS) - camera.project(POINTS)).max() > 0.05
    assert np.array_equal(camera.at(0).project(POINTS), camera.project(POINTS))


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
