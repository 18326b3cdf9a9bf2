"""A law of small strains says what finite strains would do to its parameters, though no residual shows them."""

import re
from dataclasses import replace

import numpy as np
import pytest

from idic.experiment_file import load_experiment
from idic.identification import identify, joined
from idic.run.store.discrepancy_store import load_discrepancy, save_discrepancy
from idic.run import RunStore
from idic.simulation_error.small_strains import with_finite_strains
from idic_studies.trial.scenes.recording import Paint, write_public
from idic_studies.trial.scenes.scene import NULLS
from idic_studies.trial.scenes.solve import solve
from idic_studies.trial.scenes.worlds import world_scene

WORLD = {"specimen": "hole", "columns": 132, "frames": 5, "programme": "monotonic", "thickness": 1.5, "solid": False,
         "finite": False, "noise": "white"}


@pytest.fixture(scope="module")
def stretched(tmp_path_factory):
    """A sheet of 2 % strain whose law has finite strains, on a mesh of its own; the user's law has small ones."""
    folder = tmp_path_factory.mktemp("stretched")
    scene = world_scene(WORLD, "elastic", 1.0, NULLS["elastic"].truth)
    motion = solve(replace(scene, kinematics="finite"))
    return identify(load_experiment(folder, stack=write_public(folder, scene, motion, Paint(1, 2))))


def notes(result):
    return [note for note in result["notes"] if note.startswith("small strains")]


def test_the_note_names_the_error_and_its_size(stretched):
    result, true = stretched.result, NULLS["elastic"].truth["E"]
    entry = result["parameters"]["BODY.E"]
    (note,) = notes(result)
    said = float(re.search(r"BODY\.E by ([+-]\d+) MPa", note).group(1))
    assert entry["value"] - true > 4.0 * entry["std"]
    assert abs(entry["value"] + said - true) < 2.0 * entry["std"]


def test_a_law_of_finite_strains_is_told_nothing(stretched):
    finite = with_finite_strains(stretched.experiment)
    assert with_finite_strains(finite) is None
    found = identify(finite)
    assert not notes(found.result) and found.discrepancy.strain_error is None
    assert abs(found.result["parameters"]["BODY.E"]["value"] / NULLS["elastic"].truth["E"] - 1.0) < 0.005


def test_the_error_is_kept_with_a_run_and_in_a_joint_one(stretched, tmp_path):
    made = stretched.discrepancy
    store = RunStore(tmp_path)
    save_discrepancy(store, 3, made)
    np.testing.assert_array_equal(load_discrepancy(store, 3).strain_error, made.strain_error)
    same = {name: name for name in made.names}
    both = joined({"one": made, "two": made}, made.names, {"one": same, "two": same})
    np.testing.assert_allclose(both.strain_error[:both.n], 2.0 * made.strain_error[:made.n])
