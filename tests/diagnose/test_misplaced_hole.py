"""A hole that is not where the mesh has it: its place is found, to the accuracy that the recording gives.

The truth is a mesh of its own whose hole is moved (`side_twins`); the model has it in the middle.
"""

import numpy as np
import pytest
from side_twins import PIXEL, TRUTH, Side, refit, screening, write_folder

from idic.diagnose.physics.edits import further_dofs
from idic.experiment_file import load_experiment, read_toml
from idic.identification import identify

AT = (0.12, -0.09)  # mm: 2 and 1.5 px


@pytest.mark.slow
def test_the_place_of_a_misplaced_hole_comes_first_and_comes_back(tmp_path):
    path = write_folder(tmp_path / "test", Side(hole_at=AT))
    _, result = screening(path, ("hole_geometry", "orthotropy", "grip_rotation", "lens_distortion", "pixel_size"))
    best = result.ranked[0]
    assert best.candidate.name == "hole_geometry" and best.standing == "significant"
    assert best.variant.new == ("geometry.hole_y",)  # across the load; along it a hole hardly shows
    again = refit(path, best.variant).result["parameters"]
    assert abs(again["geometry.hole_y"]["value"] - AT[1]) < 3.0 * again["geometry.hole_y"]["std"] < PIXEL
    experiment = load_experiment(path)
    here = type("Here", (), {"experiment": experiment, "document": read_toml(path)})
    whole = identify(load_experiment(path, further_dofs(here, "geometry.hole_x", "geometry.hole_y")))
    found = whole.result["parameters"]
    for name, true in (("geometry.hole_x", AT[0]), ("geometry.hole_y", AT[1]), ("BODY.E", TRUTH["E"]),
                       ("BODY.nu", TRUTH["nu"])):
        assert abs(found[name]["value"] - true) < 3.0 * found[name]["std"], (name, found[name])
    assert np.isfinite(found["geometry.hole_x"]["std"])
