"""`idic calibrate` on rendered images of dots and chessboards, and on the real pairs of the shared data."""

import json
import os
import re
from pathlib import Path

import numpy as np
import pytest
import tifffile
from PIL import Image
from scipy.spatial.transform import Rotation
from target_images import TrueCamera, chessboard, dots, poses, render
from typer.testing import CliRunner

import idic.cli  # noqa: F401  (registers the commands)
from idic.cli.app import app
from idic.readers import find_target, read_calibration

SHARED = Path(os.environ.get("IDIC_SHARED_DATA", "../shared/data")) / "stereo"
needs_shared = pytest.mark.skipif(not SHARED.is_dir(), reason="the shared stereo data are not here")
TURN = Rotation.from_euler("y", 20, degrees=True).as_matrix()
LEFT = TrueCamera(3000.0, 3005.0, 245.0, 196.0, -0.12, 0.8, np.eye(3), np.zeros(3))
RIGHT = TrueCamera(3010.0, 3012.0, 236.0, 203.0, -0.08, 0.3, TURN,
                   np.array([0, 0, 400.0]) - TURN @ np.array([0, 0, 400.0]))
MARKED, PLAIN, BOARD = dots((14, 11), 4.0, 1.2,
                            ((4, 3), (9, 3), (4, 7))), dots((12, 9), 4.0, 1.2), chessboard((10, 7), 4.0)


def command(*words):
    done = CliRunner().invoke(app, ["calibrate", *map(str, words)])
    return done.exit_code, done.output


def one_image(surface, seed=0, tilt=30.0, noise=1.5, light=0.3):
    generator = np.random.default_rng(seed)
    pose = poses(3, 400.0, generator, tilt=tilt)[seed % 3]
    return render(LEFT, LEFT.rays(), pose, surface, noise, generator, light), pose


@pytest.fixture(scope="module")
def pairs(tmp_path_factory):
    """Seven pairs of the marked target, the names as a stereo system writes them."""
    folder, generator = tmp_path_factory.mktemp("pairs"), np.random.default_rng(11)
    rays = LEFT.rays(), RIGHT.rays()
    for k, pose in enumerate(poses(7, 400.0, generator)):
        for c, camera in enumerate((LEFT, RIGHT)):
            Image.fromarray(render(camera, rays[c], pose, MARKED, 1.5, generator,
                                   0.3)).save(folder / f"cal_{k:02d}_{c}.png")
    return folder


@pytest.mark.parametrize("seed", range(3))
def test_dots_are_found_to_a_hundredth_of_a_pixel_with_their_place(seed):
    image, pose = one_image(PLAIN, seed, tilt=1e-6)  # without tilt the centroid is the image of the centre
    view = find_target(image, "dots", (12, 9))
    true = LEFT.sees((np.column_stack([view.index * 4.0 - [22.0, 16.0], np.zeros(view.n)])) @ pose[0].T + pose[1])
    assert view.n >= 100  # dots at the border of the image are left out
    assert np.sqrt(((view.points_px - true) ** 2).mean()) < 0.01  # grey noise of 1 % of the contrast over 250 px


@pytest.mark.parametrize("dark", [True, False])
def test_markers_tell_the_place_of_a_part_of_the_target(dark):
    image, pose = one_image(MARKED, 1)
    image = image if dark else 255 - image
    view, part = (find_target(i, "dots", None) for i in (image, image[:, :380]))
    assert view.unique and part.unique and 40 < part.n < view.n
    where = {tuple(i): p for i, p in zip(view.index.tolist(), view.points_px)}
    # cutting the image moves the thresholds, not the dots
    assert max(np.abs(where[tuple(i)] - p).max() for i, p in zip(part.index.tolist(), part.points_px)) < 0.01
    quarter = find_target(np.rot90(image), "dots", None)
    assert {tuple(i) for i in quarter.index.tolist()} == set(where)


def test_corners_of_a_chessboard_are_found_to_a_hundredth_of_a_pixel():
    image, pose = one_image(BOARD, 2)
    view = find_target(image, "chessboard", (10, 7))
    true = LEFT.sees((np.column_stack([view.index * 4.0 - [18.0, 12.0], np.zeros(view.n)])) @ pose[0].T + pose[1])
    flipped = LEFT.sees((np.column_stack([[18.0, 12.0] - view.index * 4.0, np.zeros(view.n)])) @ pose[0].T + pose[1])
    # noise of 1 % of the contrast along edges of 30 px
    assert min(np.sqrt(((view.points_px - t) ** 2).mean()) for t in (true, flipped)) < 0.015


def test_an_image_without_a_target_has_none():
    noise = np.random.default_rng(0).integers(0, 255, (200, 240)).astype(np.uint8)
    assert find_target(noise, "dots", (12, 9)) is None
    assert find_target(noise, "chessboard", (10, 7)) is None
    assert find_target(np.full((200, 240), 90, np.uint8), "dots", None) is None


def test_a_pair_is_calibrated_from_images_and_the_file_is_read_again(pairs, tmp_path):
    code, text = command(pairs, "--spacing", 4, "--out", tmp_path / "rig.json")
    assert code == 0, text
    rig = read_calibration(tmp_path / "rig.json")
    assert rig.image_size_px == ((480, 400), (480, 400))
    assert rig.covariance.shape == (18, 18) and rig.std[0].t_x == 0.0 < rig.std[1].t_x
    for camera, true, std in zip(rig.cameras, (LEFT, RIGHT), rig.std):
        for name in ("fx", "fy", "cx", "cy", "k1", "k2"):
            assert abs(getattr(camera, name) - getattr(true, name)) < 3.5 * std.of(name), name
    turned = Rotation.from_matrix(rig.cameras[1].rotation @ RIGHT.rotation.T).as_rotvec(degrees=True)
    for k, axis in enumerate("xyz"):
        assert abs(turned[k]) < 3.5 * rig.std[1].of(f"rotation_{axis}")
        assert abs(rig.cameras[1].translation_mm[k] - RIGHT.shift[k]) < 3.5 * rig.std[1].of(f"t_{axis}")
    assert rig.std[0].fx < 0.3  # px of 3000
    assert json.loads((tmp_path / "rig.json").read_text())["rms_px"] < 0.012
    assert (tmp_path / "rig.png").read_bytes()[:4] == b"\x89PNG"
    assert "reprojection 0.0" in text and "camera 1" in text


def test_bad_input_ends_with_the_reason_and_writes_nothing(pairs, tmp_path):
    out = tmp_path / "rig.json"
    left = tmp_path / "left"
    left.mkdir()
    for k in range(4):
        Image.fromarray(np.full((400, 480), 90, np.uint8)).save(left / f"{k}.png")
    few, right = tmp_path / "few", tmp_path / "right"
    few.mkdir(), right.mkdir()
    for k in range(2):
        Image.open(pairs / f"cal_0{k}_0.png").save(few / f"{k}.png")
    for k in range(4):
        Image.open(pairs / f"cal_0{k}_0.png").crop((0, 0, 470 + k, 400)).save(right / f"{k}.png")
    for words, reason in (((left, "--grid", "10x7"), "no target in any image"), ((left,), "the target needs its grid"),
                          ((few,), "too few images"), ((left, few, "--grid", "10x7"), "different numbers of images"),
                          ((right,), "differ in size"), ((left, "--grid", "ten"), "not a grid"),
                          ((left, "--free", "fx,k9"), "not intrinsic values"), ((tmp_path / "none",), "no such file"),
                          ((left, few, right), "not one camera or two")):
        code, text = command(*words, "--spacing", 4, "--out", out)
        assert code == 2 and not out.exists(), text


@pytest.mark.slow
@needs_shared
def test_the_real_chessboard_pairs_agree_with_one_rig(tmp_path):
    folder = SHARED.resolve() / "calibration"
    for side in ("left", "right"):
        (tmp_path / side).mkdir()
        for k in range(0, 20, 2):
            (tmp_path / side / f"{k:02d}.tif").symlink_to(folder / f"img{side}" / f"image_{k:02d}.tif")
    code, text = command(tmp_path / "left", tmp_path / "right", "--spacing", 8, "--grid", "11x7", "--free",
                         "fx,fy,cx,cy,k1",
                         "--target-std", 0.05, "--out", tmp_path / "rig.json")
    assert code == 0, text
    rms = float(re.search(r"reprojection ([\d.]+) px", text)[1])
    assert rms < 0.05  # px; a flat board leaves 0.1
    first, second = read_calibration(tmp_path / "rig.json").cameras
    # square pixels
    assert first.fx == pytest.approx(first.fy, rel=3e-3) and second.fx == pytest.approx(second.fy, rel=3e-3)
    shape = tifffile.imread(folder / "imgleft" / "image_00.tif").shape
    for camera in (first, second):  # the centre of the image is that of the lens within 5 % of the width
        assert abs(camera.cx - (shape[1] - 1) / 2) < 30 and abs(camera.cy - (shape[0] - 1) / 2) < 30
