"""Cameras with a lens in experiment.toml: values and files, placement by clicked points, and what is refused."""

import json

import numpy as np
import pytest
import tifffile
from small_experiment import TOML, write_experiment

from idic.correlation import FrameResponse, turned_response
from idic.errors import InputError
from idic.experiment_file import load_experiment
from idic.images import PinholeCamera, rotation_of
from idic.model import build_forward, solve
from idic.virtual_tests import Rig

SIZE = (50, 60)  # rows, columns of the images of the small experiment
ROTATION = rotation_of([3.0, -8.0, 2.0]) @ np.diag([1.0, -1.0, -1.0])
LEFT = PinholeCamera(2000.0, 2010.0, 29.0, 24.0, k1=-0.1, rotation=ROTATION, translation_mm=[-2.0, 1.5, 200.0])
RIGHT = PinholeCamera(2020.0, 2030.0, 31.0, 25.0, k1=-0.12, rotation=rotation_of([0.0, 15.0, 0.0]) @ ROTATION,
                      translation_mm=[-1.9, 1.4, 201.0])
CORNERS = np.array([[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [4.0, 3.0, 0.0], [0.0, 3.0, 0.0], [2.0, 1.0, 0.0]])
POSE = f"rotation = {ROTATION.tolist()}\ntranslation_mm = [-2.0, 1.5, 200.0]\n"
TELECENTRIC = TOML[TOML.index("[camera]"):TOML.index("[material")]


def written(folder, table, further="", cameras=(LEFT, RIGHT), deviations=None, size=SIZE):
    text = TOML.replace(TELECENTRIC, table + "\n" + further)
    write_experiment(folder, text)
    Rig(tuple(cameras), size).write_calibration(folder / "cal.json", deviations)
    return folder


def main(more=POSE, name="left"):
    return f'[[camera]]\nname = "{name}"\nmodel = "pinhole"\ncalibration = "cal.json"\nnoise_std_gv = 2.0\n{more}'


def other(folder, more="", seed=9):
    (folder / "right").mkdir(parents=True)
    rng = np.random.default_rng(seed)
    for k in range(4):
        tifffile.imwrite(folder / "right" / f"f{k}.tif", rng.integers(0, 256, SIZE, dtype=np.uint8))
    return ('[[camera]]\nname = "right"\nmodel = "pinhole"\ncalibration = "cal.json"\nimages = "right/*.tif"\n'
            f"noise_std_gv = 2.0\n{more}")


def clicks(camera, rng=None, points=CORNERS):
    at = camera.project(points) + (0.0 if rng is None else 0.3 * rng.standard_normal((len(points), 2)))
    return f"alignment = {{ points_mm = {points.tolist()}, points_px = {at.tolist()} }}\n"


def test_values_of_the_table_win_over_those_of_the_file(tmp_path):
    experiment = load_experiment(written(tmp_path, main(POSE + "fx_px = 2100.0\nk1 = -0.2\n")))
    lens = experiment.model.camera.lens
    assert (lens.fx, lens.fy, lens.k1, lens.p1) == (2100.0, LEFT.fy, -0.2, LEFT.p1)


def test_without_a_file_the_values_and_the_pose_are_enough(tmp_path):
    table = '[camera]\nmodel = "pinhole"\nfx_px = 2000\nfy_px = 2010\ncx_px = 29\ncy_px = 24\nk1 = -0.1\n' + POSE
    experiment = load_experiment(written(tmp_path, table))
    np.testing.assert_allclose(experiment.model.camera.project(CORNERS), LEFT.project(CORNERS), atol=1e-9)  # rounding


def test_the_second_camera_of_a_file_follows_the_pose_that_the_first_is_given(tmp_path):
    experiment = load_experiment(written(tmp_path, main(), other(tmp_path)))
    assert [camera.name for camera in experiment.cameras] == ["right"]
    np.testing.assert_allclose(experiment.model.camera.project(CORNERS), LEFT.project(CORNERS), atol=1e-9)
    np.testing.assert_allclose(experiment.cameras[0].camera.project(CORNERS), RIGHT.project(CORNERS), atol=1e-9)


@pytest.mark.parametrize("both", [False, True])
def test_clicked_points_place_the_mesh(tmp_path, both):
    """Exact clicks give the pose back; clicks of 0.3 px give it within what five points allow."""
    rng = np.random.default_rng(4)
    further = other(tmp_path / "exact", clicks(RIGHT) if both else "")
    exact = load_experiment(written(tmp_path / "exact", main(clicks(LEFT)), further))
    for seen, camera in ((exact.model.camera, LEFT), (exact.cameras[0].camera, RIGHT)):
        np.testing.assert_allclose(seen.project(CORNERS), camera.project(CORNERS), atol=1e-6)  # of the fit
    further = other(tmp_path / "rough", clicks(RIGHT, rng) if both else "")
    rough = load_experiment(written(tmp_path / "rough", main(clicks(LEFT, rng)), further))
    assert np.abs(rough.model.camera.project(CORNERS) - LEFT.project(CORNERS)).max() < 1.0
    assert any("clicked points" in note for note in rough.notes)
    if both:  # depth from two directions: the second image agrees as well
        assert np.abs(rough.cameras[0].camera.project(CORNERS) - RIGHT.project(CORNERS)).max() < 1.0


def test_deviations_of_the_file_are_priors_of_the_values(tmp_path):
    deviations = {"0.fx": 3.0, "1.fx": 4.0, "1.rotation_y": 0.05, "1.t_z": 0.2}
    dof = '[[dof]]\nname = "right.fx"\n'
    folder = written(tmp_path, main("identify_calibration = false\n" + POSE), other(tmp_path), deviations=deviations)
    text = (folder / "experiment.toml").read_text()
    (folder / "experiment.toml").write_text(text + dof)
    prior = load_experiment(folder).model.parameters.joint[0]
    assert prior.names == ("left.fx", "right.fx", "right.rotation_y", "right.t_z")
    np.testing.assert_allclose(np.sqrt(np.diag(prior.covariance)), [3.0, 4.0, 0.05, 0.2])
    at, mean, precision = prior.precision(load_experiment(folder).model.parameters.free)
    assert mean == pytest.approx([RIGHT.fx]) and precision.ravel() == pytest.approx([1 / 16.0])
    (folder / "experiment.toml").write_text(text.replace("identify_calibration = false", "identify_calibration = true"))
    free = load_experiment(folder).model.parameters.free
    assert {"left.fx"} <= set(free) and "right.fx" not in free  # each table for its own camera


def test_amplitudes_of_a_rigid_motion_are_degrees_of_freedom(tmp_path):
    experiment = load_experiment(written(tmp_path, main(POSE + 'motion = "free"\nmotion_column = "grip_um"\n')))
    names = experiment.model.parameters.free
    assert "placement.t_z_at[2]" in names and "placement.rotation_x_at[3]" in names
    assert "placement.t_z_at[0]" not in names  # the reference
    fewer = load_experiment(tmp_path, {"experiment.reference": 1,
                                       "experiment.exclude_frames": [3]}).model.parameters.free
    assert [name for name in fewer if name.startswith("placement.t_z_at")] == ["placement.t_z_at[2]"]


@pytest.mark.parametrize("table, words", [
    ('[camera]\nmodel = "pinhole"\npixel_size_mm = 0.1\ncalibration = "cal.json"\n', "another camera model"),
    ('[camera]\npixel_size_mm = 0.1\norigin_px = [10, 40]\ncalibration = "cal.json"\n', 'model = "pinhole"'),
    ('[camera]\npixel_size_mm = 0.1\norigin_px = [10, 40]\nl1 = -0.1\n', 'leave out l1, or write model = "division"'),
    ('[camera]\nmodel = "pinhole"\n' + POSE, "without its calibration"),
    ('[camera]\nmodel = "division"\nfx_px = 2000\nfy_px = 2010\ncx_px = 29\ncy_px = 24\nl1 = -0.1\n',
     "a division camera without a pose"),
    ('[camera]\nmodel = "pinhole"\ncalibration = "cal.json"\ncalibration_camera = 2\n' + POSE, "0 … 1"),
    ('[camera]\nmodel = "pinhole"\ncalibration = "cal.json"\nrotation = [[1,0,0],[0,1,0],[0,0,1]]\n', "half of a pose"),
    ('[camera]\nmodel = "pinhole"\ncalibration = "cal.json"\nidentify_calibration = true\n' + POSE, "deviations"),
    ('[camera]\nmodel = "pinhole"\ncalibration = "cal.json"\n' + POSE.replace("200.0", "-200.0"), "behind the camera"),
    ('[camera]\nmodel = "pinhole"\ncalibration = "cal.json"\n' + POSE.replace("[-2.0, ", "[90.0, "),
     "outside the image"),
    ('[camera]\nmodel = "pinhole"\ncalibration = "cal.json"\nalignment = { points_mm = [[0,0],[1,0],[2,0]], '
     "points_px = [[1,1],[2,2],[3,3]] }\n", "on a line"),
    ('[camera]\nmodel = "pinhole"\ncalibration = "cal.json"\nalignment = { points_mm = [[0,0],[4,0],[4,3],[0,3]], '
     "points_px = [[10,10],[50,12],[12,40],[48,41]] }\n", "do not fit"),
])
def test_bad_tables_are_refused_with_the_reason(tmp_path, table, words):
    with pytest.raises(InputError) as found:
        load_experiment(written(tmp_path, table))
    assert words in str(found.value)


def test_a_calibration_of_images_of_another_size_is_refused(tmp_path):
    with pytest.raises(InputError, match="another size"):
        load_experiment(written(tmp_path, main(), size=(100, 120)))
    folder = written(tmp_path / "cropped", main())
    entries = json.loads((folder / "cal.json").read_text())
    entries.pop("image_size")
    entries["K1"][0][2] = 400.0
    (folder / "cal.json").write_text(json.dumps(entries))
    with pytest.raises(InputError, match="principal point"):
        load_experiment(folder)


def test_another_number_of_images_is_refused(tmp_path):
    further = other(tmp_path)
    (tmp_path / "right" / "f3.tif").unlink()
    with pytest.raises(InputError, match="different numbers of images"):
        load_experiment(written(tmp_path, main(), further))


def test_clicks_of_swapped_cameras_are_refused_where_the_points_lie_at_several_depths(tmp_path):
    """Of points in a plane they are not: a plane that leans the other way fits as well."""
    deep = CORNERS + np.array([0.0, 0.0, 12.0]) * np.array([[0], [1], [0], [1], [1]])
    further = other(tmp_path, clicks(LEFT, points=deep))
    with pytest.raises(InputError, match=": .*swapped"):
        load_experiment(written(tmp_path, main(clicks(RIGHT, points=deep)), further))


def test_the_texture_of_a_camera_is_named_and_what_it_shares_is_said(tmp_path):
    experiment = load_experiment(written(tmp_path, main(), other(tmp_path, 'texture = "left"\n')))
    assert experiment.cameras[0].texture == "left"
    assert any("texture of left" in note and "% of the pixels" in note for note in experiment.notes)
    assert any("until the search reaches it" in note for note in experiment.notes)  # two images of noise


@pytest.mark.parametrize("first, second, words", [
    ('texture = "right"\n', "", "what others are compared with"),
    ("", 'texture = "right"\n', "the name of another camera"),
    ("", 'texture = "top"\n', "write one of left"),
    ("", 'texture = "left"\n[options]\nmethod = "two_step"\n', "two steps compare no texture"),
])
def test_a_texture_without_a_second_image_is_refused(tmp_path, first, second, words):
    with pytest.raises(InputError) as found:
        load_experiment(written(tmp_path, main(POSE + first), other(tmp_path, second)))
    assert words in str(found.value)


def test_one_camera_or_telecentric_ones_have_no_common_texture(tmp_path):
    with pytest.raises(InputError, match="two cameras with a lens"):
        load_experiment(written(tmp_path / "one", main(POSE + 'texture = "left"\n')))
    telecentric = TELECENTRIC.replace("[camera]", '[[camera]]\nname = "left"')
    further = other(tmp_path / "two", 'texture = "left"\n').replace('model = "pinhole"\ncalibration = "cal.json"\n',
                                                                  "pixel_size_mm = 0.1\norigin_px = [10, 40]\n")
    with pytest.raises(InputError, match=": .*telecentric"):
        load_experiment(written(tmp_path / "two", telecentric, further))


def test_a_chain_of_textures_that_closes_is_refused(tmp_path):
    further = other(tmp_path, 'texture = "top"\n')
    third = further.replace('"right"\nmodel', '"top"\nmodel').replace('"top"\n', '"right"\n').replace(
        'name = "right"', 'name = "top"')
    with pytest.raises(InputError, match="compared twice"):
        load_experiment(written(tmp_path, main(), further + third))


def test_cameras_that_see_two_ends_of_a_sheet_share_no_texture(tmp_path):
    away = PinholeCamera(2020.0, 2030.0, 31.0, 25.0, rotation=ROTATION, translation_mm=[-6.0, 1.5, 200.0])
    near = PinholeCamera(2000.0, 2010.0, 29.0, 24.0, rotation=ROTATION, translation_mm=[1.0, 1.5, 200.0])
    pose = f"rotation = {ROTATION.tolist()}\ntranslation_mm = {near.translation_mm.tolist()}\n"
    with pytest.raises(InputError, match="different parts of the surface"):
        load_experiment(written(tmp_path, main(pose), other(tmp_path, 'texture = "left"\n'), cameras=(near, away)))


def test_a_mesh_file_in_px_is_refused_before_a_lens(tmp_path):
    """One px was one mm."""
    folder = written(tmp_path, main())
    file = folder / "experiment.toml"
    file.write_text(file.read_text().replace('mesh_unit = "mm"', 'mesh_unit = "px"'))
    with pytest.raises(InputError, match="a mesh in px before a camera with a lens"):
        load_experiment(folder)


def test_a_sheet_that_becomes_thinner_recedes_from_cameras_on_both_sides(tmp_path):
    """The one behind it saw the change of thickness with the sign of the one in front."""
    turned = np.diag([-1.0, 1.0, -1.0]) @ ROTATION  # about the vertical axis of the camera
    behind = PinholeCamera(2000.0, 2010.0, 29.0, 24.0, rotation=turned, translation_mm=[2.0, 1.5, 200.0])
    experiment = load_experiment(written(tmp_path, main(), other(tmp_path), cameras=(LEFT, behind)))
    assert not any("different grey values" in note for note in experiment.notes)  # two sides, two patterns
    front, back = experiment.views
    assert (front.model.camera.side, back.model.camera.side, experiment.surface_side) == (1, -1, 1)
    found = solve(build_forward(experiment), experiment.model.parameters)
    none = np.zeros((*found.u[3].shape, 0))
    last = FrameResponse(3, found.u[3], np.zeros(0), none, np.zeros((0, 0)), none, np.zeros((0, 0)))
    nodes = experiment.model.mesh.nodes
    for view in (front, back):
        u = turned_response(view.model, last).u
        np.testing.assert_array_equal(u[:, :2], found.u[3][:, :2])
        sheet = np.column_stack([nodes + u[:, :2], 0.0 * u[:, 2]])
        recedes = view.model.camera.depths(sheet + u * [0, 0, 1]) - view.model.camera.depths(sheet)
        assert recedes.min() > 0.0
        np.testing.assert_allclose(recedes, -found.u[3][:, 2] * abs(view.model.camera.effective.rotation[2, 2]),
                                   rtol=1e-6)


def test_square_pixels_of_a_calibration_stay_square(tmp_path):
    """Without a free fy idic calibrate writes one deviation for both: as a prior it left fx - fy open."""
    written(tmp_path, main("identify_calibration = true\n" + POSE))
    file = tmp_path / "cal.json"
    entries = json.loads(file.read_text())
    matrix = np.array([[9.0, 9.0, 0.0], [9.0, 9.0, 0.0], [0.0, 0.0, 0.0]])  # k2 was held
    entries["covariance"] = {"names": ["0.fx", "0.fy", "0.k2"], "matrix": matrix.tolist()}
    file.write_text(json.dumps(entries))
    parameters = load_experiment(tmp_path).model.parameters
    names = tuple(name for name in parameters.free if name.startswith("left."))
    assert names == ("left.fx", "left.fy")  # a value of no deviation is no degree of freedom
    at, _, precision = parameters.joint[0].precision(names)
    covariance = np.linalg.inv(precision)
    assert at == [0, 1] and np.sqrt(np.diag(covariance)) == pytest.approx([3.0, 3.0], rel=1e-3)
    apart = np.array([1.0, -1.0])
    assert np.sqrt(apart @ covariance @ apart) < 0.01  # px


def test_cameras_of_two_calibration_files_keep_the_deviations_of_both(tmp_path):
    further = other(tmp_path, f"identify_calibration = true\nrotation = {RIGHT.rotation.tolist()}\n"
                              f"translation_mm = {RIGHT.translation_mm.tolist()}\n")
    written(tmp_path, main("identify_calibration = true\n" + POSE),
            further.replace('"cal.json"', '"own.json"'), deviations={"0.fx": 3.0, "0.k1": 0.01})
    Rig((RIGHT,), SIZE).write_calibration(tmp_path / "own.json", {"0.fx": 4.0})
    parameters = load_experiment(tmp_path).model.parameters
    assert {"left.fx", "left.k1", "right.fx"} <= set(parameters.free)
    prior = parameters.joint[0]
    assert prior.names == ("left.fx", "left.k1", "right.fx")
    np.testing.assert_allclose(prior.covariance, np.diag([9.0, 1e-4, 16.0]))
    assert prior.mean == pytest.approx([LEFT.fx, LEFT.k1, RIGHT.fx])
