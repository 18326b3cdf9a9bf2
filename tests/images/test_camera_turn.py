"""A camera that was turned about its own centre: what the degrees of freedom mean, and their derivatives."""

import numpy as np
import pytest

from idic.images import PLACED_TURNS, PinholeCamera, PlacedCamera, RIGID, rotation_of

LENS = PinholeCamera(2468.5, 2471.2, 638.9, 407.3, skew=-0.4, k1=-0.12, p1=1.5e-3,
                     rotation=rotation_of([3.0, 14.0, 1.0]), translation_mm=[-70.0, 3.0, 20.0],
                     turned_deg=[0.0, 0.2, -0.1])
CAMERA = PlacedCamera(LENS, rotation=rotation_of([178.0, 2.0, 5.0]), translation_mm=[1.0, -2.0, 250.0],
                      placement=[0.3, -0.2, 0.1, 0.2, 0.1, -0.3], pivot_mm=[1.0, 2.0, 0.0])
POINTS = np.random.default_rng(3).uniform([-15, -12, -4], [15, 12, 4], (60, 3))


def test_the_centre_stays_and_the_view_turns():
    turned = CAMERA.with_parameters(dict(zip(PLACED_TURNS, (0.4, -1.5, 0.7), strict=True)))
    before, after = CAMERA.effective, turned.effective
    np.testing.assert_allclose(after.centre_mm, before.centre_mm, atol=1e-10)  # rounding of 300 mm
    np.testing.assert_allclose(after.rotation, rotation_of([0.4, -1.5, 0.7]) @ before.rotation, atol=1e-14)
    np.testing.assert_array_equal(turned.lens.translation_mm, LENS.translation_mm)  # the calibration's, as before


def test_the_rotation_of_the_calibration_moves_the_centre():
    moved = CAMERA.with_parameters({"rotation_y": LENS.turned_deg[1] + 0.1}).effective.centre_mm
    distance = np.linalg.norm(moved - CAMERA.effective.centre_mm)
    assert distance == pytest.approx(np.radians(0.1) * np.hypot(70.0, 20.0), rel=0.01)  # about the origin of the rig


@pytest.mark.parametrize("turned", [(0.0, 0.0, 0.0), (3.0, -8.0, 5.0)])
@pytest.mark.parametrize("name", ["fx", "cx", "k1", "rotation_x", "rotation_z", "t_x", "t_z", *PLACED_TURNS,
                                  f"placement.{RIGID[1]}", f"placement.{RIGID[5]}"])
def test_derivatives_of_a_turned_camera_are_difference_quotients(name, turned):
    camera = CAMERA.with_parameters(dict(zip(PLACED_TURNS, turned, strict=True)))
    value, step = camera.values()[name], 1e-4
    higher, lower = (camera.with_parameters({name: value + sign * step}).project(POINTS) for sign in (1, -1))
    slope = camera.parameter_jacobian(POINTS, name)
    # central differences: step² of the third derivative; rounding 1e-12 px over the step
    np.testing.assert_allclose(slope, (higher - lower) / (2 * step), atol=1e-6 * np.abs(slope).max() + 1e-7)
    assert np.abs(slope).max() > 0.0


def test_values_set_to_themselves_change_nothing():
    camera = CAMERA.with_parameters({"turn_y": 0.3})
    assert camera.key != CAMERA.key
    assert camera.with_parameters(camera.values()).key == camera.key
