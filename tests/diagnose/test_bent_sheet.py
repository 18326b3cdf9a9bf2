"""A sheet that bends towards one camera: every shape is an experiment, and a concealed bulge is named."""

from __future__ import annotations

import shutil

import numpy as np
import pytest
from bent_sheet import DISTANCE, LOAD, write_sheet
from side_twins import GRIP, LENGTH, RADIUS, SHAPE, TIMES, TOML, TRUTH, WIDTH, with_free_courses

from idic.diagnose import Situation, candidate_library
from idic.experiment_file import load_experiment, read_toml
from idic.images import CameraMotion
from idic.run import diagnose_run, identify_run
from idic.virtual_tests import strip_with_hole, write_images, write_inp, write_loads

by_calculix = pytest.mark.skipif(shutil.which("ccx") is None, reason="CalculiX is not installed (Debian: calculix-ccx)")
BULGE = 0.04  # mm: 0.1 % of the distance


def situation_of(folder, toml):
    (folder / "images").mkdir(parents=True)
    write_images(folder, (np.zeros(SHAPE, np.uint8) for _ in TIMES))
    write_loads(folder, TIMES, {"force_N": 10.0 * TIMES, "grip_mm": GRIP})
    write_inp(strip_with_hole(LENGTH, WIDTH, RADIUS, "quad8", 2, 2, 1, name="BODY"), folder / "mesh.inp", "twin")
    path = folder / "experiment.toml"
    path.write_text(toml)
    experiment = load_experiment(path)
    return path, Situation(read_toml(path), experiment, experiment.model.parameters.as_values(), {"BODY": np.ones(7)},
                           {"BODY": 0.01}, np.zeros((len(TIMES), experiment.model.mesh.n_nodes, 2)),
                           10.0 * TIMES[:, None])


def test_every_shape_and_course_is_an_experiment(tmp_path):
    """A shape that the file has is not proposed; the others join it."""
    path, where = situation_of(tmp_path / "test", TOML.replace(
        "[camera]", '[camera]\ndeflections = [{ shape = "bow_y", column = "force_N" }]'))
    trials = [(candidate, variant) for candidate in candidate_library() for variant in candidate.variants(where)
              if candidate.name in ("sheet_bending", "specimen_motion")]
    shapes = [variant.new[0].split(".")[1].rpartition("_")[0] for _, variant in trials]
    assert set(shapes) == set(CameraMotion.shapes) - {"bow_y"} and len(trials) == 3 * len(set(shapes))
    knots = with_free_courses(trials, where.document, where.experiment.model.parameters.free,
                              lambda edits: load_experiment(path, edits))
    assert len(knots) == len(set(shapes))
    for _, variant in [*trials, *knots]:
        parameters = load_experiment(path, variant.edits).model.parameters
        assert {"camera.bow_y_load", *variant.new} <= set(parameters.free), variant.label
        assert {name: parameters[name].value for name in variant.new} == pytest.approx(dict(variant.null))


def diagnosed(folder, course):
    identify_run(write_sheet(folder, BULGE * course).parent, folder / "run")
    return diagnose_run(folder / "run")


@pytest.mark.slow  # two minutes of CPU time
@by_calculix
def test_a_bulge_that_grows_with_the_force_is_named_and_the_parameters_come_back(tmp_path):
    """Without it nu comes out at 0.30. The whole library."""
    content = diagnosed(tmp_path, LOAD)
    assert (content["verdict"], content["named"], content["indistinguishable"]) == ("single", ["sheet_bending"], [])
    before, after = (content["model"][f"parameters_{when}"] for when in ("before", "after"))
    assert abs(before["BODY.nu"]["value"] - TRUTH["nu"]) > 0.03
    for name, value in TRUTH.items():
        assert abs(after[f"BODY.{name}"]["value"] - value) < 2.0 * after[f"BODY.{name}"]["std"], name
    (ratio,) = (entry["value"] for name, entry in after.items() if name.startswith("camera."))
    u_z = np.load(tmp_path / "truth.npy")[:, :, 2]
    assert 0.8 * BULGE < ratio * DISTANCE < u_z.max()  # the membrane rises most at the hole
    assert content["fit"]["explainable_share_recovered"] > 0.95


@pytest.mark.slow
@by_calculix
@pytest.mark.parametrize("start, size", [(7, 1.5), (4, 1.0)])
def test_a_bulge_that_begins_late_is_named_with_its_beginning(tmp_path, start, size):
    """One frame per second; its course is identified. The weaker one leaves less than free motions show, and two shapes
    explain it as well as one with a course."""
    content = diagnosed(tmp_path, size * np.maximum(TIMES - start, 0.0) / (TIMES[-1] - start))
    assert (content["verdict"], content["named"]) == ("single", ["sheet_bending"])
    (course,) = content["courses"]
    begun, visible = course["onset_frames"]
    assert course["free"] and begun <= start < visible <= start + 2
    for name, value in TRUTH.items():
        entry = content["model"]["parameters_after"][f"BODY.{name}"]
        assert abs(entry["value"] - value) < 2.0 * entry["std"], name


@pytest.mark.slow
@by_calculix
def test_a_sheet_that_stays_flat_names_nothing(tmp_path):
    content = diagnosed(tmp_path, 0.0 * LOAD)
    assert (content["verdict"], content["named"]) == ("none", [])
