"""The pinhole camera: against OpenCV, the contract of cameras, there and back."""

import cv2
import numpy as np
import pytest
from camera_contract import CameraContract

from idic.errors import InputError
from idic.images import PinholeCamera, rotation_of

RNG = np.random.default_rng(25)
POINTS = RNG.uniform([-30, -25, -8], [30, 25, 8], (200, 3))
CAMERA = PinholeCamera(2468.5, 2471.2, 638.9, 407.3, skew=-0.4, k1=-0.12, k2=0.3, k3=-0.2, p1=1.5e-3, p2=-8e-4,
                       rotation=rotation_of([178.0, 9.0, 12.0]), translation_mm=[-2.0, 3.0, 240.0])


def test_without_skew_the_projection_is_that_of_opencv():
    camera = CAMERA.with_parameters({"skew": 0.0})
    theirs, _ = cv2.projectPoints(POINTS, cv2.Rodrigues(camera.rotation)[0], camera.translation_mm, camera.matrix,
                                  np.array([camera.k1, camera.k2, camera.p1, camera.p2, camera.k3]))
    # rounding of 1000 px is 1e-13; theirs goes through a rotation vector near 180 degrees
    assert np.abs(camera.project(POINTS) - theirs[:, 0]).max() < 1e-9


def test_skew_moves_columns_by_the_normalised_row():
    plain = CAMERA.with_parameters({"skew": 0.0})
    moved = CAMERA.project(POINTS) - plain.project(POINTS)
    expected = -0.4 * (plain.project(POINTS)[:, 1] - CAMERA.cy) / CAMERA.fy
    np.testing.assert_allclose(moved[:, 0], expected, atol=1e-12 * 1000)
    assert np.all(moved[:, 1] == 0.0)


def turned(*degrees):
    """The camera as it was calibrated, at a rotation by the degrees of freedom."""
    return PinholeCamera(**{name: getattr(CAMERA, name) for name in PinholeCamera.intrinsics},
                         rotation=rotation_of(degrees), turned_deg=degrees, translation_mm=CAMERA.translation_mm)


class TestPinhole(CameraContract):
    cameras = {"calibrated": CAMERA, "slightly turned": turned(0.3, -0.2, 0.5), "turned": turned(20.0, -35.0, 50.0)}
    parameters, points = PinholeCamera.parameters, POINTS


def test_undistortion_returns_to_the_pixel_within_1e_10():
    columns, rows = np.meshgrid(np.linspace(0, 1279, 41), np.linspace(0, 799, 31))
    pixels = np.column_stack([columns.ravel(), rows.ravel()])
    for z in (-5.0, 0.0, 7.0):
        points = np.column_stack([CAMERA.inverse(pixels, z), np.full(len(pixels), z)])
        assert np.abs(CAMERA.project(points) - pixels).max() < 1e-10


def test_rays_start_at_the_centre_and_hit_the_points_that_the_pixels_show():
    centre, direction = CAMERA.rays(CAMERA.project(POINTS))
    away = POINTS - centre
    along = (away * direction).sum(axis=1)
    assert (along > 0).all()
    assert np.abs(away - along[:, None] * direction).max() < 1e-10  # mm


def test_where_the_distortion_folds_back_there_is_no_point():
    barrel = PinholeCamera(1000.0, 1000.0, 0.0, 0.0, k1=-0.5)  # radius a (1 - a²/2) has its maximum 0.544 at a = 0.816
    ideal = barrel.normalised(np.array([[540.0, 0.0], [600.0, 0.0]]))
    assert np.isfinite(ideal[0]).all() and ideal[0, 0] < 0.8165
    assert np.isnan(ideal[1]).all()


def test_parameters_set_to_their_own_values_change_no_bit():
    turned = CAMERA.with_parameters({"rotation_x": 0.4, "t_z": 250.0})
    again = turned.with_parameters(turned.values())
    assert np.array_equal(again.project(POINTS), turned.project(POINTS))
    back = turned.with_parameters({"rotation_x": 0.0, "t_z": 240.0})
    assert np.abs(back.project(POINTS) - CAMERA.project(POINTS)).max() < 1e-9


def test_a_far_camera_with_a_long_lens_is_telecentric():
    from idic.images import Camera

    plane = POINTS * [1.0, 1.0, 0.0]
    flat = Camera.from_table(0.05, (600.0, 400.0), ("+col", "-row"))
    facing = np.diag([1.0, -1.0, -1.0])
    for distance in (1e3, 1e5):
        f = distance / 0.05
        camera = PinholeCamera(f, f, 600.0, 400.0, rotation=facing, translation_mm=[0.0, 0.0, distance])
        assert np.abs(camera.project(plane) - flat.project(plane)).max() < 1e-8  # a plane at right angles: the same
        seen = np.abs(camera.project(POINTS) - flat.project(POINTS)).max()
        assert 0.5 * 39 * 8 / 0.05 / distance < seen < 1.01 * 39.1 * 8 / 0.05 / (distance - 8)


def test_a_mesh_behind_the_camera_is_refused():
    with pytest.raises(InputError, match="behind the camera"):
        CAMERA.placed(CAMERA.rotation, [0.0, 0.0, -240.0]).project(POINTS)


@pytest.mark.parametrize("change", [{"fx": -1.0}, {"cx": np.nan}, {"rotation": np.diag([1.0, 1.0, -1.0])},
                                    {"rotation": 2 * np.eye(3)}, {"translation_mm": [0.0, 1.0]}])
def test_impossible_values_are_refused_by_name(change):
    values = {"fx": 1000.0, "fy": 1000.0, "cx": 0.0, "cy": 0.0} | change
    with pytest.raises(InputError, match=next(iter(change))):
        PinholeCamera(**values)
