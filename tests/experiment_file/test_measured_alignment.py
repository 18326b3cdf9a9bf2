"""The mesh placed by holes, edges and the measured surface of rendered plates; what is refused."""

import re

import numpy as np
import pytest
from holed_plate import CORNERS, HOLES, alignment, edge, hole, pair, placement_error, write_plate

from idic.errors import InputError
from idic.experiment_file import load_experiment

TILT_DEG = 6.0  # of the plate before the pair


def px_error(cameras, experiment):
    found = [experiment.model.camera, *(other.camera for other in experiment.cameras)]
    return max(np.abs(true.project(CORNERS) - own.project(CORNERS)).max()
               for true, own in zip(cameras, found, strict=True))


def std_of(experiment):
    return next(np.sqrt(np.diag(prior.covariance)) for prior in experiment.model.parameters.joint
                if "placement.t_x" in prior.names)


@pytest.fixture(scope="module")
def plate(tmp_path_factory):
    """Cameras, and the folder with both holes marked in both images."""
    cameras, rng = pair(TILT_DEG), np.random.default_rng(2)
    tables = [alignment([hole(camera, k, rng) for k in range(2)]) for camera in cameras]
    return cameras, write_plate(tmp_path_factory.mktemp("plate"), cameras, tables)


def again(plate, tmp_path, *tables):
    """The same images with other alignments."""
    text = (plate[1] / "experiment.toml").read_text()
    tables = iter(tables)
    text = re.sub(r"alignment = .*\n", lambda _: next(tables), text)
    for name in ("left", "right", "mesh.inp", "cal.json"):
        (tmp_path / name).symlink_to(plate[1] / name)
    (tmp_path / "experiment.toml").write_text(text)
    return tmp_path


def test_two_holes_and_the_measured_surface_place_the_mesh(plate):
    cameras, folder = plate
    experiment = load_experiment(folder)
    error, std = placement_error(cameras[0], experiment.model.camera), std_of(experiment)
    assert px_error(cameras, experiment) < 0.3  # clicks of 1 px: 1.2 in the mean
    assert (np.abs(error) < 4.0 * std).all()
    assert (std[:2] < 0.02).all() and (std[3:] < 0.02).all()  # deg, mm: a tilt of one click is 1 deg
    notes = "\n".join(experiment.notes)
    assert "hole of radius 1.5" in notes and "mm (rms) from the mesh" in notes and "rotation_x" in notes


def test_the_deviations_are_the_prior_of_the_placement(plate, tmp_path):
    folder = again(plate, tmp_path, *re.findall(r"alignment = .*\n", (plate[1] / "experiment.toml").read_text()))
    with (folder / "experiment.toml").open("a") as file:
        file.write('[[dof]]\nname = "placement.rotation_z"\n[[dof]]\nname = "placement.t_x"\n'
                   "prior = { mean = 0.0, std = 0.5 }\n")
    (prior,) = load_experiment(folder).model.parameters.joint
    assert "placement.t_x" not in prior.names  # it has one of its own
    _, mean, precision = prior.precision(load_experiment(folder).model.parameters.free)
    assert mean == [0.0] and precision[0, 0] == pytest.approx(std_of(load_experiment(plate[1]))[2] ** -2)


@pytest.mark.slow
def test_a_hole_and_an_edge_in_one_of_two_images_are_enough(plate, tmp_path):
    cameras = plate[0]
    table = alignment([hole(cameras[0], 0)], [edge(cameras[0], 3, 2)])
    experiment = load_experiment(again(plate, tmp_path, table, ""))
    assert px_error(cameras, experiment) < 0.4
    assert (np.abs(placement_error(cameras[0], experiment.model.camera)) < 4.0 * std_of(experiment)).all()


@pytest.mark.slow
def test_clicks_may_stand_beside_the_measured_surface(plate, tmp_path):
    cameras, rng = plate[0], np.random.default_rng(5)
    tables = [f"alignment = {{ points_mm = {CORNERS.tolist()}, points_px = "
              f"{(camera.project(CORNERS) + rng.standard_normal((4, 2))).tolist()}, measured_surface = true }}\n"
              for camera in cameras]
    experiment = load_experiment(again(plate, tmp_path, *tables))
    error, std = placement_error(cameras[0], experiment.model.camera), std_of(experiment)
    assert (np.abs(error) < 4.0 * std).all()
    assert (std[:2] < 0.02).all() and std[3] > 0.02  # the tilt from the surface, the rest from clicks of 1 px


@pytest.mark.slow
def test_one_camera_is_placed_by_the_outlines_of_two_holes(plate, tmp_path):
    cameras = plate[0][:1]
    table = alignment([hole(cameras[0], k, radius=True) for k in range(2)],
                      [edge(cameras[0], 3, 2), edge(cameras[0], 0, 1)])
    folder = again(plate, tmp_path, table, "")
    text = (folder / "experiment.toml").read_text()
    start, end = text.index('[[camera]]\nname = "right"'), text.index("[material")
    (folder / "experiment.toml").write_text(text[:start] + text[end:])
    experiment = load_experiment(folder)
    assert px_error(cameras, experiment) < 1.5  # the tilt is 3 deg off: circles of 15 px hardly tell it
    assert not experiment.model.parameters.joint and any("roughly" in note for note in experiment.notes)


def refused(words, *tables, slow=False):
    return pytest.param(tables, words, marks=[pytest.mark.slow] if slow else [], id=words.replace(" ", "-"))


LEFT, RIGHT = pair(TILT_DEG)
ABOVE = edge(LEFT, 3, 2)


@pytest.mark.parametrize("tables, words", [
    refused("no hole", alignment([f"{{ centre_mm = {HOLES[0].tolist()}, px = [140, 60] }}", hole(LEFT, 1)]), ""),
    refused("leaves the place of the mesh open", alignment([hole(LEFT, 0)]), alignment([hole(RIGHT, 0)])),
    refused("not marked in two cameras", alignment([hole(LEFT, 0), hole(LEFT, 1)]), ""),
    refused("no edge", alignment([hole(LEFT, 0)], [edge(LEFT, 3, 2, -25.0)]), ""),
    refused("cannot be measured", alignment([hole(LEFT, 0).replace("[-6.0", "[-3.0"), hole(LEFT, 1)], [ABOVE]), "",
            slow=True),
    refused("does not fit", alignment([hole(LEFT, 0).replace("[-6.0", "[-5.5"), hole(LEFT, 1)], [ABOVE]), "",
            slow=True),
    refused("another radius", alignment([hole(LEFT, 0, radius=True).replace("= 1.5", "= 2.5"), hole(LEFT, 1)], [ABOVE]),
            "", slow=True),
    refused("given twice", alignment([hole(LEFT, 0), hole(LEFT, 1)], [ABOVE]) + "translation_mm = [0, 0, 9]\n"
            "rotation = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]\n", ""),
    refused("too few", "alignment = { points_mm = [[0, 0], [1, 0]], points_px = [[1, 1], [2, 2]] }\n", ""),
])
def test_what_does_not_place_the_mesh_is_refused(plate, tmp_path, tables, words):
    with pytest.raises(InputError, match=words) as found:
        load_experiment(again(plate, tmp_path, *tables))
    assert found.value.remedy and found.value.key


@pytest.mark.slow
def test_images_that_belong_to_another_camera_are_refused(plate, tmp_path):
    """Right and left images exchanged, each with its own marks: the surface is then at no place of the mesh."""
    left, right = plate[0]
    folder = again(plate, tmp_path, alignment([hole(right, 0), hole(right, 1)], [edge(right, 3, 2)]),
                   alignment([hole(left, 0), hole(left, 1)]))
    text = (folder / "experiment.toml").read_text()
    text = text.replace('"left/', '"LEFT/').replace('"right/', '"left/').replace('"LEFT/', '"right/')
    (folder / "experiment.toml").write_text(text)
    with pytest.raises(InputError):
        load_experiment(folder)
