"""`idic init` in folders with a film, and with the images of two cameras and their calibration; sets of a material."""

import json
import shutil
import tomllib

import cv2
import numpy as np
import pytest
import tifffile
from typer.testing import CliRunner

from experiment_file.small_experiment import change, write_experiment
from idic.cli.app import app
from idic.experiment_file import load_experiment


def shown(*words):
    result = CliRunner().invoke(app, [str(word) for word in words])
    return result.exit_code, result.output


def test_a_film_is_the_recording(tmp_path):
    folder = write_experiment(tmp_path / "test")
    (folder / "experiment.toml").unlink()
    film = cv2.VideoWriter(str(folder / "pull.mp4"), cv2.VideoWriter_fourcc(*"mp4v"), 1, (60, 50), True)
    for path in sorted((folder / "images").glob("*.tif")):
        film.write(cv2.cvtColor(tifffile.imread(path), cv2.COLOR_GRAY2BGR))
        path.unlink()
    film.release()
    code, text = shown("init", folder)
    assert code == 0 and "pull.mp4: 4 of 60 x 50 px" in text
    assert tomllib.loads((folder / "experiment.toml").read_text())["experiment"]["images"] == "pull.mp4"


def paired(tmp_path, calibrated=True):
    folder = write_experiment(tmp_path / "test")
    (folder / "experiment.toml").unlink()
    (folder / "images").rename(folder / "right")
    (folder / "left").mkdir()
    for path in (folder / "right").glob("*.tif"):
        tifffile.imwrite(folder / "left" / path.name, tifffile.imread(path))
    if calibrated:
        matrix = [[3000.0, 0, 30], [0, 3000.0, 25], [0, 0, 1]]
        rig = {"K1": matrix, "D1": [0, 0, 0, 0, 0], "K2": matrix, "D2": [0, 0, 0, 0, 0], "R": np.eye(3).tolist(),
               "T": [-0.5, 0.0, 0.0], "image_size": [60, 50]}
        (folder / "calibration.json").write_text(json.dumps(rig))
    return folder


def test_two_folders_with_a_calibration_are_two_cameras(tmp_path):
    folder = paired(tmp_path)
    code, text = shown("init", folder)
    assert code == 0 and "cameras      two, left and right, by calibration.json" in text
    text = (folder / "experiment.toml").read_text()
    first, second = tomllib.loads(text)["camera"]
    assert (first["name"], second["name"], second["images"], second["calibration_camera"]) == (
        "left", "right", "right/*.tif", 1)
    assert "camera.rotation_deg" not in text  # a lens has none
    corners = "points_px = [[10, 40], [50, 40], [50, 10], [10, 10]]"  # FILL IN
    text = text.replace("# [camera.alignment]", "[camera.alignment]").replace("# points_mm", "points_mm")
    text = text.replace("# points_px = []", corners).replace("# thickness_mm", "thickness_mm")
    (folder / "experiment.toml").write_text(text)
    assert len(load_experiment(folder).views) == 2


def test_two_folders_without_a_calibration_are_not(tmp_path):
    folder = paired(tmp_path, calibrated=False)
    shown("init", folder)
    assert "name" not in tomllib.loads((folder / "experiment.toml").read_text())["camera"]


@pytest.mark.parametrize("name, first_pattern, second_pattern, names", [
    ("img_{k:04d}_{c}.tif", "images/img_*_0.tif", "images/img_*_1.tif", ["first", "second"]),
    ("{side}-{k}.tif", "images/left-*.tif", "images/right-*.tif", ["left", "right"]),
    ("T{k:02d}_Cam{c}.tif", "images/T*_Cam0.tif", "images/T*_Cam1.tif", ["first", "second"]),
])
def test_names_of_one_folder_tell_two_cameras_apart(tmp_path, name, first_pattern, second_pattern, names):
    folder = paired(tmp_path)
    (folder / "images").mkdir()
    for c, side in enumerate(("left", "right")):
        for k, path in enumerate(sorted((folder / side).glob("*.tif"))):
            path.rename(folder / "images" / name.format(k=k, c=c, side=side))
        (folder / side).rmdir()
    (folder / "mesh.inp").unlink()
    code, text = shown("init", folder)
    config = tomllib.loads((folder / "experiment.toml").read_text())
    assert code == 0 and config["experiment"]["images"] == first_pattern, text
    assert [camera["name"] for camera in config["camera"]] == names and config["camera"][1]["images"] == second_pattern
    assert "no mesh file: give one in mm" in text and "fill in      mesh, " in text


def test_a_series_of_one_camera_is_not_halved(tmp_path):
    """Also with a calibration of two at hand: its names leave no two equal series."""
    folder = paired(tmp_path)
    for path in (folder / "right").glob("*.tif"):
        path.unlink()
    (folder / "right").rmdir()
    for k, path in enumerate(sorted((folder / "left").glob("*.tif"))):
        path.rename(path.with_name(f"run1_step{k // 3}_{k % 3}.tif"))  # 0_0, 0_1, 0_2, 1_0
    shown("init", folder)
    config = tomllib.loads((folder / "experiment.toml").read_text())
    assert config["experiment"]["images"] == "left/*.tif" and isinstance(config["camera"], dict)


def elements(folder, name):
    return load_experiment(folder).model.mesh.element_sets[name]


def test_a_material_fills_several_sets_or_the_whole_mesh(tmp_path):
    folder = write_experiment(tmp_path / "test")
    change(folder, "mesh.inp", "ELSET=SPECIMEN", "ELSET=WHOLE")
    change(folder, "mesh.inp", "*ELSET, ELSET=LAST", "*ELSET, ELSET=LOW, GENERATE\n1001, 1006\n*ELSET, ELSET=HIGH, "
                                                     "GENERATE\n1006, 1012\n*ELSET, ELSET=LAST")
    change(folder, "experiment.toml", "[material.SPECIMEN]", '[material.STEEL]\nsets = ["low", "HIGH"]')
    assert len(elements(folder, "STEEL")) == 12
    change(folder, "experiment.toml", 'sets = ["low", "HIGH"]', 'sets = ["ALL"]')
    assert len(elements(folder, "STEEL")) == 12
    change(folder, "experiment.toml", '[material.STEEL]\nsets = ["ALL"]', "[material.ALL]")
    assert len(elements(folder, "ALL")) == 12


@pytest.mark.parametrize("entry, told", [
    ('[material.STEEL]\nsets = ["LAST", "ROOF"]', "ROOF"),
    ("[material.STEEL]", "[material.ALL] fills the whole mesh"),
    ('[material.STEEL]\nsets = ["LAST"]', "let one material fill several"),
    ('[material.WHOLE]\nsets = ["LAST"]', "the material has the name of another set"),
])
def test_sets_that_cannot_be_joined_are_refused(tmp_path, entry, told):
    folder = write_experiment(tmp_path / "test")
    change(folder, "mesh.inp", "ELSET=SPECIMEN", "ELSET=WHOLE")
    change(folder, "experiment.toml", "[material.SPECIMEN]", entry)
    code, text = shown("check", folder, "--no-picture")
    assert code == 2 and told in " ".join(text.split())


@pytest.mark.parametrize("names, cameras", [(("left.avi", "right.avi"), ["left", "right"]),
                                            (("cam0.tif", "cam1.tif"), ["first", "second"])])
def test_a_film_of_each_camera_is_a_pair(tmp_path, names, cameras):
    folder = paired(tmp_path)
    for name, side in zip(names, ("left", "right"), strict=True):
        images = np.array([tifffile.imread(path) for path in sorted((folder / side).glob("*.tif"))])
        shutil.rmtree(folder / side)
        if name.endswith(".tif"):
            tifffile.imwrite(folder / name, images, photometric="minisblack")
            continue
        film = cv2.VideoWriter(str(folder / name), cv2.VideoWriter_fourcc(*"FFV1"), 1, (60, 50), True)
        for image in images:
            film.write(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR))
        film.release()
    code, text = shown("init", folder)
    assert code == 0 and f"cameras      two, {cameras[0]} and {cameras[1]}, by calibration.json" in text
    assert "other films" not in text
    table = tomllib.loads((folder / "experiment.toml").read_text())
    assert table["experiment"]["images"] == names[0] and table["camera"][1]["images"] == names[1]


def test_a_folder_of_each_specimen_gets_an_experiment_of_its_own(tmp_path):
    for name in ("A 0", "B 90"):
        folder = write_experiment(tmp_path / "all" / name)
        (folder / "experiment.toml").unlink()
    code, text = shown("init", tmp_path / "all")
    assert code == 0 and "specimens    2; one material of all of them: idic identify 'A 0' 'B 90'" in text
    for name in ("A 0", "B 90"):
        assert 'loads = "loads.csv"' in (tmp_path / "all" / name / "experiment.toml").read_text()
    code, text = shown("init", tmp_path / "all")
    assert code == 2 and "has an experiment already" in text
