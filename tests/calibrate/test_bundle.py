"""Bundle adjustment on exact and noisy points: derivatives, OpenCV's result, standard deviations that hold."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from idic.calibrate import Lens, calibrate
from idic.calibrate.projection import derivatives, dot_shift, in_camera_0, moved, n_unknowns
from idic.calibrate.records import Pose, State
from idic.calibrate.shape import out_of_plane
from idic.errors import InputError
from idic.images import PinholeCamera
from idic.readers import TargetView
from target_images import TrueCamera, poses

GRID, SPACING, SIZE = (9, 7), 5.0, (480, 400)
INDEX = np.array([(i, j) for j in range(GRID[1]) for i in range(GRID[0])])
POINTS = np.column_stack([INDEX * SPACING, np.zeros(len(INDEX))])
MIDDLE = POINTS - POINTS.mean(axis=0)
TURN = Rotation.from_euler("xyz", [2, 20, -1], degrees=True).as_matrix()
LEFT = TrueCamera(2400.0, 2404.0, 246.0, 195.0, -0.12, 0.9, np.eye(3), np.zeros(3))
RIGHT = TrueCamera(2420.0, 2418.0, 236.0, 203.0, -0.08, 0.4, TURN,
                   np.array([0, 0, 300.0]) - TURN @ np.array([0, 0, 300.0]))


def seen_points(camera, pose, noise, generator, unique=True, shape=MIDDLE):
    pixels = camera.sees(shape @ pose[0].T + pose[1])
    return TargetView(INDEX, pixels + generator.normal(0, 1, pixels.shape) * noise, unique=unique)


def stereo_views(noise, seed, n=8, unique=True, shape=MIDDLE):
    generator = np.random.default_rng(seed)
    return tuple(tuple(seen_points(camera, pose, noise, generator, unique, shape) for camera in (LEFT, RIGHT))
                 for pose in poses(n, 300.0, np.random.default_rng(5)))


def errors(result):
    """Identified minus true values, in the order of the covariance."""
    found = []
    for name in result.rig.names:
        number, key = int(name[0]), name[2:]
        camera, true = result.rig.cameras[number], (LEFT, RIGHT)[number]
        if key.startswith("rotation"):
            turn = Rotation.from_matrix(camera.rotation @ true.rotation.T).as_rotvec(degrees=True)
            found.append(turn["xyz".index(key[-1])])
        elif key.startswith("t_"):
            found.append((camera.translation_mm - true.shift)["xyz".index(key[-1])])
        else:
            found.append(getattr(camera, key) - getattr(true, key))
    return np.array(found)


def test_every_derivative_of_the_projection_is_its_difference_quotient():
    lens = Lens(("fx", "cx", "k1", "p2"))
    cameras = (PinholeCamera(2400, 2400, 240, 200, k1=-0.1, k2=0.3),
               PinholeCamera(2410, 2410, 240, 200, p1=1e-3, rotation=RIGHT.rotation, translation_mm=RIGHT.shift))
    target = replace(out_of_plane(MIDDLE), point_std_mm=0.1)
    state = State(cameras, tuple(Pose(*pose) for pose in poses(2, 300.0, np.random.default_rng(5))), MIDDLE,
                  np.zeros(target.n_unknowns))
    chosen, n = np.array([3, 20, 41]), n_unknowns(state, lens, target)
    step = np.random.default_rng(1).normal(0, 0.01, n)

    def place(step, view, number):
        now = moved(state, lens, step, target)
        return now.cameras[number].project(in_camera_0(now.poses[view], now.points_mm[chosen])).ravel()

    for view, number in ((1, 0), (0, 1)):
        slopes = derivatives(moved(state, lens, step, target), lens, step, target, number, np.full(3, view), chosen)
        by_step = np.zeros((3, 2, n))
        by_step[:, :, slopes.columns] = slopes.common
        pose = n - target.n_unknowns - 6 * (2 - view)
        by_step[:, :, pose : pose + 6] = slopes.pose
        for k, point in enumerate(chosen):
            at = n - target.n_unknowns + target.n_modes + 3 * point
            by_step[k, :, at : at + 3] = slopes.by_point[k]
        for k in range(n):
            side = 1e-5 * np.eye(n)[k]
            quotient = (place(step + side, view, number) - place(step - side, view, number)) / 2e-5
            # 1e-5 px of rounding over the step, and the third derivative of rotations of 500 px arm
            assert np.allclose(by_step[:, :, k].ravel(), quotient, rtol=1e-6, atol=2e-5)


def test_exact_points_give_the_exact_rig():
    result = calibrate(stereo_views(0.0, 0), (SIZE, SIZE), SPACING)
    assert result.rms_px < 1e-6  # the tolerance of the adjustment
    assert np.abs(errors(result)
                  / [1e3, 1e3, 1e2, 1e2, 1, 1, 1e3, 1e3, 1e2, 1e2, 1, 1, 1, 1, 1, 1e2, 1e2, 1e2]).max() < 1e-5


def test_one_camera_agrees_with_opencv_on_the_same_points():
    views = tuple((row[0],) for row in stereo_views(0.1, 3, n=6))
    result = calibrate(views, (SIZE,), SPACING, Lens(("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2")),
                       target_std_mm=0.0)
    rms, matrix, distortion, _, _, std, _, _ = cv2.calibrateCameraExtended(
        [POINTS.astype(np.float32)] * 6, [row[0].points_px.astype(np.float32) for row in views], SIZE, None, None,
        flags=cv2.CALIB_FIX_K3, criteria=(cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 200, 1e-14))
    camera, own = result.rig.cameras[0], result.rig.std[0]
    assert result.n_left_out == 0
    assert result.rms_px == pytest.approx(rms, rel=1e-5)  # OpenCV takes points in single precision
    found = np.array([camera.fx, camera.fy, camera.cx, camera.cy, camera.k1, camera.k2, camera.p1, camera.p2])
    stds = np.array([own.of(name) for name in ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2")])
    other = np.array([matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2], *distortion.ravel()[:4]])
    assert np.abs((found - other) / stds).max() < 1e-2  # both stop long before a deviation
    assert np.allclose(stds, std.ravel()[:8], rtol=0.02)  # OpenCV counts degrees of freedom a little differently


@pytest.mark.slow
def test_errors_over_their_deviations_are_unit_normal_over_many_draws():
    squares, chi2 = [], []
    for seed in range(40):
        result = calibrate(stereo_views(0.05, seed), (SIZE, SIZE), SPACING)
        error = errors(result)
        squares.append(error**2 / np.diag(result.rig.covariance))
        chi2.append(error @ np.linalg.solve(result.rig.covariance, error) / len(error))
    mean = np.mean(squares, axis=0)
    assert 0.5 < mean.min() and mean.max() < 1.7  # chi-square of 40 draws: 1 +- 0.22, three deviations, 18 values
    assert np.mean(chi2) == pytest.approx(1.0, abs=0.16)  # 18 values, 40 draws: 0.053, three deviations


def test_errors_of_one_draw_are_within_their_deviations():
    result = calibrate(stereo_views(0.05, 17), (SIZE, SIZE), SPACING)
    error = errors(result)
    chi2 = error @ np.linalg.solve(result.rig.covariance, error)
    assert 5 < chi2 < 45  # chi-square of 18: 0.1 % on either side
    assert result.noise_px == pytest.approx(0.05, rel=0.06)  # 2016 coordinates: 1.6 %


def test_a_target_that_looks_the_same_from_two_sides_is_counted_alike_by_both_cameras():
    views = [list(row) for row in stereo_views(0.02, 2, unique=False)]
    for v in (1, 2, 5):  # as a detector may number them
        seen = views[v][1]
        views[v][1] = TargetView(np.array(GRID) - 1 - seen.index, seen.points_px)
    result = calibrate(tuple(map(tuple, views)), (SIZE, SIZE), SPACING)
    assert result.rms_px < 0.04
    assert np.abs(errors(result)[-3:]).max() < 1.0  # mm of 300; a turned target would put the camera elsewhere


def test_a_view_of_one_camera_alone_counts_too():
    views = [list(row) for row in stereo_views(0.05, 4)]
    views[0][0], views[3][1] = None, None
    result = calibrate(tuple(map(tuple, views)), (SIZE, SIZE), SPACING)
    assert result.residuals_px[0][0] is None and len(result.residuals_px[0][1]) == len(INDEX)
    assert np.abs(errors(result) / np.sqrt(np.diag(result.rig.covariance))).max() < 4.0


BENT = MIDDLE + np.column_stack([0 * MIDDLE[:, :2], 0.15 * (MIDDLE[:, 0] / MIDDLE[:, 0].max()) ** 2])
# points are numbered by column, then row
NUMBERED = np.lexsort((INDEX[:, 1], INDEX[:, 0]))


def out_of_plane_error(points_mm, shape_mm):
    """z of identified minus true points, about the best plane  # (n,) mm"""
    z = points_mm[:, 2] - shape_mm[NUMBERED, 2]
    plane = np.column_stack([np.ones(len(z)), points_mm[:, :2]])
    return z - plane @ np.linalg.lstsq(plane, z, rcond=None)[0]


def test_a_bend_of_the_target_is_identified_within_its_deviations():
    result = calibrate(stereo_views(0.02, 6, shape=BENT), (SIZE, SIZE), SPACING)
    score = out_of_plane_error(result.points_mm, BENT) / result.shape.std_mm[:, 2]
    assert np.sqrt((score**2).mean()) < 2.0 and np.abs(score).max() < 4.5  # 12 modes, chi-square to 0.1 %: 1.7
    assert result.shape.std_mm[:, 2].max() < 0.01  # of 0.15 mm
    assert np.abs(errors(result) / np.sqrt(np.diag(result.rig.covariance))).max() < 4.0
    (note,) = [note for note in result.notes if "the target is bent" in note]
    assert "mm behind and column" in note and "before its mean plane" in note
    assert not result.shape.is_distorted and not result.between.all_views.is_significant


def test_a_flat_target_has_no_shape():
    result = calibrate(stereo_views(0.02, 6), (SIZE, SIZE), SPACING)
    assert not result.shape.is_bent and not result.shape.is_distorted
    assert not any("bent" in note or "print" in note for note in result.notes)
    assert np.abs(result.shape.displacement_mm).max() < 4.5 * result.shape.std_mm.max() < 0.05


def test_a_bent_target_that_is_said_to_be_flat_is_told():
    result = calibrate(stereo_views(0.02, 6, shape=BENT), (SIZE, SIZE), SPACING, target_std_mm=0.0)
    assert any("residuals repeat on the points" in note and "leave out --target-std" in note for note in result.notes)
    assert np.abs(errors(result) / np.sqrt(np.diag(result.rig.covariance))).max() > 4.0


def test_a_print_with_other_spacings_along_both_axes_is_identified():
    stretched = MIDDLE * [1.001, 0.999, 1.0]
    result = calibrate(stereo_views(0.02, 6, shape=stretched), (SIZE, SIZE), SPACING)
    assert result.shape.is_distorted and not result.shape.is_bent
    assert np.abs(errors(result) / np.sqrt(np.diag(result.rig.covariance))).max() < 4.0
    assert any("within a row the points are 0.20% farther apart" in note for note in result.notes)


def test_scattered_points_are_told_and_identified():
    scattered = BENT + np.random.default_rng(3).normal(0, 0.02, BENT.shape)
    views = stereo_views(0.02, 6, shape=scattered)
    assert any("--target-std 0.02 identifies" in note for note in calibrate(views, (SIZE, SIZE), SPACING).notes)
    free = calibrate(views, (SIZE, SIZE), SPACING, target_std_mm=0.02)
    assert free.noise_px == pytest.approx(0.02, rel=0.1) and free.shape.is_bent
    score = out_of_plane_error(free.points_mm, scattered) / free.shape.std_mm[:, 2]
    assert 0.7 < np.sqrt((score**2).mean()) < 1.3  # 63 points
    assert np.abs(errors(free) / np.sqrt(np.diag(free.rig.covariance))).max() < 4.0


def test_pairs_in_another_order_are_refused():
    views = stereo_views(0.02, 6)
    shifted = tuple((a[0], b[1]) for a, b in zip(views, views[1:] + views[:1]))
    with pytest.raises(InputError, match="different poses"):
        calibrate(shifted, (SIZE, SIZE), SPACING)


def test_the_shift_of_a_dot_is_the_centroid_of_its_outline():
    camera = PinholeCamera(2400, 2400, 240, 200, k1=-0.1, k2=3.0)
    pose = Pose(Rotation.from_euler("xy", [40, 10], degrees=True).as_matrix(), np.array([4.0, -3.0, 150.0]))
    angle, radius, centre = np.linspace(0, 2 * np.pi, 4000, endpoint=False), 2.0, np.array([[7.0, 5.0, 0.0]])
    circle = centre + radius * np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    x, y = camera.project(in_camera_0(pose, circle)).T
    cross = x * np.roll(y, -1) - np.roll(x, -1) * y
    centroid = np.array([((x + np.roll(x, -1)) * cross).sum(),
                         ((y + np.roll(y, -1)) * cross).sum()]) / (3 * cross.sum())
    expected = centroid - camera.project(in_camera_0(pose, centre))[0]
    assert np.linalg.norm(expected) > 0.05
    # the quadrature is exact to the fifth order in radius over distance
    assert np.allclose(dot_shift(camera, pose, centre, radius)[0], expected, atol=1e-4)


def test_too_few_views_are_refused():
    with pytest.raises(InputError, match="too few images show the target"):
        calibrate(stereo_views(0.02, 6)[:2], (SIZE, SIZE), SPACING)


def test_views_of_a_small_tilt_are_told():
    generator = np.random.default_rng(0)
    views = tuple((seen_points(LEFT, pose, 0.02, generator),) for pose in poses(8, 300.0, generator, tilt=6.0))
    assert any("hardly separated" in note for note in calibrate(views, (SIZE,), SPACING).notes)
