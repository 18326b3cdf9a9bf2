"""A crack as a candidate: its path, its lengths, its words; and whole diagnoses of sheets whose truth is CalculiX's."""

from __future__ import annotations

import shutil
from types import SimpleNamespace

import numpy as np
import pytest
from experiment_file.small_experiment import TOML, write_experiment
from twins.cracked_sheet import ACROSS, LENGTHS, E, clamped_sheet, write_sheet

from idic.diagnose import candidate_library
from idic.diagnose.cut_mesh import _lowest
from idic.diagnose.locate.crack_path import Cells, Line
from idic.experiment_file import load_experiment, read_toml
from idic.report.diagnosis.words import crack_words
from idic.run import diagnose_run, identify_run
from idic.run.diagnosis.enriched import _without_suspects
from idic.virtual_tests import strip_with_hole

CRACK = next(candidate for candidate in candidate_library() if candidate.name == "crack")
TABLE = {"name": "suspect", "path_mm": [[-0.5, 1.5], [3.0, 1.6]], "length_mm": {"value": 0.0, "identify": False},
         "knots": [1, 3]}
RIVALS = ("crack", "heterogeneity", "damage", "plasticity", "grip_rotation")


def test_a_line_has_room_to_the_next_edge_and_none_in_a_hole():
    cells = Cells.of(strip_with_hole(10.0, 6.0, 1.0, "quad8", 6, 8, 6))
    assert cells.holds(np.array([[0.0, 0.0], [1.2, 0.0], [4.9, 2.9], [5.1, 0.0]])).tolist() == [False, True, True,
                                                                                               False]
    assert cells.room_ahead(Line((1.01, 0.0), (2.0, 0.0), False)) == pytest.approx(4.0, abs=0.2 * cells.size)
    assert cells.room_ahead(Line((-5.0, 0.0), (-4.0, 0.0), False)) == pytest.approx(4.0, abs=0.2 * cells.size)


def test_a_line_is_turned_about_its_start_and_moved_with_its_length():
    line = Line((1.0, 2.0), (4.0, 6.0), False)
    assert (line.length, line.direction_deg) == (5.0, pytest.approx(53.13, abs=0.01))
    assert line.turned(90.0).end == pytest.approx((-3.0, 5.0))
    assert line.moved(1.0, 0.0, 2.0) == Line((2.0, 2.0), (8.0, 10.0), False)


@pytest.mark.parametrize(("values", "place"), [([4.0, 1.0, 0.0], 1.0), ([1.0, 0.0, 1.0], 0.0), ([0.0, 5.0, 9.0], -1.0),
                                               ([float("inf"), 3.0, 2.0], 1.0), ([9.0, 1.0, 0.9], 0.5127)])
def test_the_next_place_is_the_lowest_of_a_parabola(values, place):
    assert _lowest(values) == pytest.approx(place, abs=1e-3)


def test_its_variants_free_the_length_of_the_suspected_crack_along_its_path(tmp_path):
    write_experiment(tmp_path / "test", TOML)
    path = tmp_path / "test" / "experiment.toml"
    edits = {"crack": [TABLE]}
    situation = SimpleNamespace(document=read_toml(path) | edits, experiment=load_experiment(path, edits))
    variants = CRACK.variants(situation)
    names = ("crack.suspect.length_knot[1]", "crack.suspect.length_knot[3]")
    assert {variant.new for variant in variants} == {names}
    assert all(variant.null == dict.fromkeys(names, 0.0) for variant in variants)
    assert all(0.0 <= v.probe[names[0]] <= v.probe[names[1]] < 3.0 for v in variants)
    freed = load_experiment(path, dict(variants[0].edits))
    assert set(names) <= set(freed.model.parameters.free)
    free = SimpleNamespace(document=read_toml(path) | variants[0].edits, experiment=freed)
    assert CRACK.variants(free) == ()
    plain = SimpleNamespace(document=read_toml(path), experiment=load_experiment(path))
    assert CRACK.variants(plain) == ()


def test_a_suspected_crack_that_is_none_is_not_in_the_enriched_experiment():
    own = {"name": "edge", "path_mm": [[0, 1], [3, 1]], "length_mm": 0.0}
    document = {"crack": [dict(TABLE), own]}
    _without_suspects(document)
    assert document == {"crack": [own]}
    document = {"crack": [dict(TABLE)], "dof": []}
    _without_suspects(document)
    assert document == {"dof": []}


def test_its_words_tell_where_it_begins_how_it_grows_and_what_loads_its_tip():
    entry = {"start_mm": [-2e-16, 14.3], "direction_deg": 1.6, "inner": False, "frames": [0, 1, 2],
             "length_mm": [3.0, 3.0, 6.6], "length_mm_std": [0.1, 0.1, 0.05], "K_I": [None, 1.2, 3.45],
             "K_I_std": [None, 0.1, 0.02], "K_II": [None, 0.0, 0.1], "K_II_std": [None, 0.1, 0.03]}
    assert crack_words(entry) == (
        "from (0, 14.3) mm at an edge at 2°, 3.00 ± 0.10 mm in frame 1 to 6.600 ± 0.050 mm in frame 2, "
        "K_I 3.450 ± 0.020 MPa √m, K_II 0.100 ± 0.030 MPa √m in frame 2")
    steady = entry | {"length_mm": [3.0, 3.0, 3.1], "inner": True, "K_I": [None] * 3}
    assert crack_words(steady) == "from (0, 14.3) mm inside the body at 2°, 3.100 ± 0.050 mm long"
    assert crack_words(entry | {"length_mm_std": [None] * 3}).endswith("length not determined")


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("ccx") is None, reason="CalculiX is not installed")
def test_a_crack_that_grows_between_grips_is_named_with_its_place_and_lengths(tmp_path):
    """Driven by its grips and with a free modulus the sheet conceals it: the residual is 0.1 grey values more."""
    lengths = (3.0, 3.0, 3.3, 4.6, 5.6, 6.6)
    folder = clamped_sheet(tmp_path / "test", tmp_path / "ccx", lengths)
    identify_run(folder, tmp_path / "run")
    library = [candidate for candidate in candidate_library() if candidate.name in RIVALS]
    content = diagnose_run(tmp_path / "run", library=library)
    assert (content["verdict"], content["named"], content["indistinguishable"]) == ("single", ["crack"], [])
    crack = content["cracks"]["suspect"]
    assert crack["start_mm"] == pytest.approx([0.0, ACROSS], abs=0.7) and abs(crack["direction_deg"]) < 6.0
    assert crack["length_mm"][2:] == pytest.approx(lengths[2:], abs=0.5)
    E_after = content["model"]["parameters_after"]["SHEET.E"]
    assert abs(E_after["value"] - E) < 3.0 * E_after["std"]
    assert content["headline"].startswith("Crack (from (0, 1")


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("ccx") is None, reason="CalculiX is not installed")
def test_a_crack_in_a_sheet_that_a_force_pulls_is_named_alone(tmp_path):
    """With its lengths at the knots; the length between two of them is interpolated."""
    write_sheet(tmp_path / "test", tmp_path / "ccx", tables="")
    identify_run(tmp_path / "test", tmp_path / "run")
    library = [candidate for candidate in candidate_library() if candidate.name in RIVALS]
    content = diagnose_run(tmp_path / "run", library=library)
    assert (content["verdict"], content["named"], content.get("spots", [])) == ("single", ["crack"], [])
    knots = [1, 2, 4, 5]
    lengths = [content["cracks"]["suspect"]["length_mm"][k] for k in knots]
    assert lengths == pytest.approx([LENGTHS[k] for k in knots], abs=0.15)
