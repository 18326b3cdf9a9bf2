"""Candidates of cameras with a lens: every model of the library loads before one, and a concealed fault is named."""

from __future__ import annotations

import numpy as np
import pytest
from side_twins import FORCE_NOISE, GRIP, GRIP_NOISE, LENGTH, NOISE, PIXEL, RADIUS, SHAPE, THICKNESS, TIMES, TOML
from side_twins import TRUTH, WIDTH, Side, refit, screening, truth
from twins.moving_sheet import write_moving_sheet

from idic.diagnose import candidate_library
from idic.diagnose import Situation
from idic.experiment_file import load_experiment, read_toml
from idic.fe import nodal_deformation
from idic.identification import treatments
from idic.images import LENS_MODELS, PinholeCamera, PlacedCamera, RigidMotion, rotation_of
from idic.virtual_tests import (
    Rig, Sensor, strip_with_hole, traced_images, write_images, write_inp, write_loads,
)

DISTANCE, APPROACH = 300.0, 0.12  # mm; of the specimen at the end
OF_LENSES = {"specimen_motion", "focal_length", "placement", "lens_distortion"}
NOT_OF_LENSES = {"magnification", "camera_motion", "camera_rotation", "pixel_size", "origin", "parallax",
                 "sheet_bending"}
LENS = PinholeCamera(DISTANCE / PIXEL, DISTANCE / PIXEL, 91.7, 57.4, k1=-0.1, rotation=rotation_of([2.0, -4.0, 0.5]) @
                     Rig.FROM_ABOVE, translation_mm=[0.1, 0.0, DISTANCE])
TABLE = ('[camera]\nmodel = "pinhole"\ncalibration = "cal.json"\n'
         f"rotation = {LENS.rotation.tolist()}\ntranslation_mm = {LENS.translation_mm.tolist()}\nnoise_std_gv")


def written(folder, images, force, grip):
    write_images(folder, images)
    write_loads(folder, TIMES, {"force_N": force, "grip_mm": grip})
    write_inp(strip_with_hole(LENGTH, WIDTH, RADIUS, "quad8", 3, 4, 3, name="BODY"), folder / "mesh.inp", "twin")
    Rig((LENS,), SHAPE).write_calibration(folder / "cal.json")
    head, _, tail = TOML.partition("[camera]")
    (folder / "experiment.toml").write_text(head + TABLE + tail.partition("noise_std_gv")[2])
    return folder / "experiment.toml"


def approaching(folder):
    """The strip of `side_twins`, rendered by ray tracing while it comes nearer."""
    (folder / "images").mkdir(parents=True)
    mesh, u, force = truth(Side())
    F = np.array([nodal_deformation(mesh, now) for now in u])
    thins = -TRUTH["nu"] / (1.0 - TRUTH["nu"]) * (F[:, :, 0, 0] + F[:, :, 1, 1] - 2.0)  # plane stress, small strains
    u = np.concatenate([u, 0.5 * THICKNESS * thins[:, :, None]], axis=2)
    placed = PlacedCamera(LENS, motion=RigidMotion(("t_z",), ("t_z",), (TIMES / TIMES[-1])[None], np.array([APPROACH])))
    rng = np.random.default_rng(3)
    images = traced_images(mesh, None, placed, u, Sensor(SHAPE, noise_std=NOISE, background=30.0), rng)
    return written(folder, images, force + FORCE_NOISE * rng.standard_normal(len(TIMES)),
                   GRIP + GRIP_NOISE * rng.standard_normal(len(TIMES)) * (TIMES > 0))


@pytest.fixture(scope="module")
def blank(tmp_path_factory):
    folder = tmp_path_factory.mktemp("blank")
    (folder / "images").mkdir()
    return written(folder, (np.zeros(SHAPE, np.uint8) for _ in TIMES), 10.0 * TIMES, GRIP)


def test_every_candidate_loads_before_a_lens(blank):
    path, experiment = blank, load_experiment(blank)
    where = Situation(read_toml(path), experiment, experiment.model.parameters.as_values(),
                      {"BODY": np.linspace(3, 9, 7)},
                      {"BODY": 0.01}, np.zeros((len(TIMES), experiment.model.mesh.n_nodes, 3)), 10.0 * TIMES[:, None])
    found = {candidate.name: candidate.variants(where) for candidate in candidate_library()}
    assert all(found[name] for name in OF_LENSES) and not any(found[name] for name in NOT_OF_LENSES)
    for name in OF_LENSES:
        for variant in found[name]:
            enriched = load_experiment(path, variant.edits).model.parameters
            assert set(variant.new) <= set(enriched.free), variant.label
            assert {n: enriched[n].value for n in variant.new} == pytest.approx(dict(variant.null))


def test_systematic_treatments_before_a_lens_load(blank):
    found = treatments(load_experiment(blank), read_toml(blank))
    assert {treatment.camera for treatment in found} == {"as given", "the specimen may approach and tilt"}
    for treatment in found:
        load_experiment(blank, treatment.overrides)


@pytest.mark.slow
def test_an_approach_before_a_lens_is_named_and_its_refit_finds_it(tmp_path):
    path = approaching(tmp_path / "near")
    _, result = screening(path, None)
    best = result.ranked[0]
    assert best.candidate.name == "specimen_motion" and best.standing == "significant"
    again = refit(path, best.variant).result["parameters"]
    for name, true in (("placement.t_z_drift", APPROACH / TIMES[-1]), ("placement.rotation_x_drift", 0.0),
                       ("placement.rotation_y_drift", 0.0), ("BODY.E", TRUTH["E"]), ("BODY.nu", TRUTH["nu"])):
        assert abs(again[name]["value"] - true) < 3.0 * again[name]["std"], name


@pytest.mark.slow
@pytest.mark.parametrize("name", LENS_MODELS)
def test_a_wrong_distortion_is_named_before_every_other_cause(name, tmp_path):
    leading = LENS_MODELS[name].leading
    wrong = LENS_MODELS[name].example[leading] + 0.01  # 0.6 px in the corner
    _, result = screening(write_moving_sheet(tmp_path / "lens", name, {leading: wrong}), None)
    best = result.ranked[0]
    assert (best.candidate.name, best.variant.new, best.standing) == ("lens_distortion", (f"camera.{leading}",),
                                                                      "significant")
