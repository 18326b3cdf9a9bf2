"""A camera that was turned about its own centre: what the degrees of freedom mean, and the contract of cameras."""

import numpy as np
import pytest
from camera_contract import CameraContract

from idic.images import PLACED_TURNS, PinholeCamera, PlacedCamera, rotation_of

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


class TestPlaced(CameraContract):
    cameras = {"aimed": CAMERA,
               "turned": CAMERA.with_parameters(dict(zip(PLACED_TURNS, (3.0, -8.0, 5.0), strict=True)))}
    parameters, points = tuple(CAMERA.values()), POINTS


def test_values_set_to_themselves_change_nothing():
    camera = CAMERA.with_parameters({"turn_y": 0.3})
    assert camera.key != CAMERA.key
    assert camera.with_parameters(camera.values()).key == camera.key
