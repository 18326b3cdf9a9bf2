"""An end with a shape of its own is told as that, and no cause of the material, nor two rotations, in its place.

The truth of the slow tests is a finer mesh whose nodes are moved one by one (`side_twins.py`).
"""

from types import SimpleNamespace

import numpy as np
import pytest
from side_twins import GRIP, TRUTH, WIDTH, Side, write_folder
from test_channels_and_headline import CONTENT, TITLES

import idic
from idic.diagnose import Fit, Misfit, candidate_library
from idic.diagnose import Situation
from idic.diagnose.residual.excess_left import ExcessLeft
from idic.diagnose.selection.free_model import EndMotion, FreeEnd
from idic.diagnose.selection.moves.free_end import end_motions, explains_more, may_be_an_end
from idic.experiment_file import load_experiment, read_toml, with_overrides
from idic.parameters import Parameter, ParameterSet
from idic.report.diagnosis.headline import diagnosis_headline
from idic.run import diagnose_run

FEW = ("heterogeneity", "orthotropy", "grip_rotation", "grip_slip", "machine_compliance", "lens_distortion")
LIBRARY = tuple(c for c in candidate_library() if c.name in FEW)
COURSE = GRIP / GRIP.max()


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    return write_folder(tmp_path_factory.mktemp("clean") / "test", Side())


def test_every_held_set_gets_the_polynomials_along_it_and_the_file_takes_them(path):
    experiment, document = load_experiment(path), read_toml(path)
    seen = Situation(document, experiment, {}, {}, {}, np.zeros(0), np.zeros(0))
    source = SimpleNamespace(load=lambda edits: load_experiment(path, edits))
    found = list(end_motions(source, seen))
    assert [(one.nodes, one.free_course) for one in found] == [("LEFT", False), ("LEFT", True), ("RIGHT", False),
                                                               ("RIGHT", True)]
    assert found[2].names == tuple(f"boundary.RIGHT.{c}.shape{k}" for c in "xy" for k in range(4))
    assert len(found[3].names) == 6 * len(found[2].names)
    for one in found:  # the drives of before stay
        kept = with_overrides(document, one.edits)["boundary"]
        assert kept[1]["ux"]["column"] == "grip_mm" and [table["nodes"] for table in kept] == ["LEFT", "RIGHT"]


def fitted(chi2, unknowns=(), usable_std=0.1):
    """A model that leaves so much chi-square of motions on either copy."""
    one = Misfit(np.arange(4), np.full(4, 100.0 + chi2 / 4.0), np.full(4, 100), np.zeros((4, 0)), 1.0)
    return Fit("m", "m", "converged", dict.fromkeys(unknowns, 1.0), dict.fromkeys(unknowns, usable_std),
               np.zeros((4, 0)), None, one, one)


def freed(null, chi2, n):
    motion = EndMotion("RIGHT", {}, tuple(f"boundary.RIGHT.y.shape{k}" for k in range(n)), False)
    after = fitted(chi2, ("BODY.E", *motion.names))
    return FreeEnd(after, ExcessLeft(null.judgement, after.judgement, 1e6), motion,
                   null.choice.chi2 - after.choice.chi2)


def test_a_free_end_must_explain_more_than_the_selected_causes_by_more_than_its_unknowns_could():
    null = fitted(1000.0, ("BODY.E",))
    named = fitted(100.0, ("BODY.E", "BODY.inclusion.x"))
    assert explains_more(freed(null, 0.0, 8), null, named)
    assert not explains_more(freed(null, 0.0, 96), null, named)  # 2 x 95 for them, 200 gained on both copies
    assert not explains_more(freed(null, 90.0, 2), null, named)
    assert not explains_more(freed(null, 120.0, 1), null, named)
    assert explains_more(freed(null, 120.0, 1), null, null)  # nothing was selected


@pytest.mark.parametrize("sides, share, leaves, asked", [
    (("bulk",), 0.9, False, True), (("boundary", "boundary"), 0.9, False, True), ((), 0.9, False, True),
    (("boundary",), 0.9, False, True), (("camera",), 0.9, True, True), (("camera",), 0.9, False, False),
    (("bulk",), 0.3, False, False), (("bulk", "boundary"), float("nan"), False, False)])
def test_ends_are_freed_where_they_may_be_the_cause(sides, share, leaves, asked):
    mismatch = SimpleNamespace(is_significant=True, nested_tests=SimpleNamespace(share=lambda name: share))
    rounds = [SimpleNamespace(winner=SimpleNamespace(ranked=SimpleNamespace(candidate=SimpleNamespace(side=side))))
              for side in sides] + [SimpleNamespace(winner=None)]
    assert may_be_an_end(mismatch, rounds, SimpleNamespace(matters=leaves)) is asked
    assert not may_be_an_end(None, rounds, SimpleNamespace(matters=leaves))


def test_parameters_beside_a_free_end_are_given_in_the_units_of_the_user():
    end = SimpleNamespace(refitted=SimpleNamespace(values={"BODY.E": 70e3, "BODY.nu": 0.3},
                                                   stds={"BODY.E": 500.0, "BODY.nu": None}),
                          motion=SimpleNamespace(nodes="LEFT", free_course=False), share=0.9, heldout=100.0,
                          excess=SimpleNamespace(motion_px=0.0), shapes=[], instead_of=())
    parameters = ParameterSet([Parameter("BODY.E", 69e3, "GPa", factor=1e3), Parameter("BODY.nu", 0.3)])
    assert FreeEnd.content(end, ["BODY.E", "BODY.nu"], parameters)["parameters"] == {
        "BODY.E": {"value": 70.0, "std": 0.5}, "BODY.nu": {"value": 0.3, "std": None}}


def test_the_headline_names_the_end_its_shape_and_what_to_do():
    entry = {"nodes": "RIGHT", "share": 0.97, "shapes": [
        {"component": "x", "degree": 3, "words": "s-shaped", "value": 0.03, "std": 0.0004, "unit": "mm"},
        {"component": "x", "degree": 2, "words": "bent", "value": 0.01, "std": 0.0003, "unit": "mm"}]}
    said = diagnosis_headline(CONTENT | {"verdict": "outside_library", "named": [], "free_end": entry}, TITLES)
    assert said.startswith("The end RIGHT moves in a way that no candidate describes (shape: s-shaped in ux by 0.030")
    assert "explains 97 % of the residual on held-out data: measure that end from the images" in said


def shaped(component, *columns):
    """Motion of RIGHT on top of the log: mean, slope, second and further polynomials (mm) at the largest load."""
    return Side(motion={("RIGHT", component): np.outer(COURSE, columns)})


def diagnosed(folder, side):
    idic.identify(write_folder(folder / "test", side), folder / "run")
    return diagnose_run(folder / "run", library=LIBRARY)


@pytest.mark.slow
@pytest.mark.parametrize("side, component, words", [(shaped("x", 0.0, 0.0, 0.0, 0.006), "x", "s-shaped"),
                                                    (shaped("y", 0.0, -0.02 / WIDTH), "y", "linear along it")])
def test_an_end_with_a_shape_of_its_own_is_told_as_that(side, component, words, tmp_path):
    """An uneven grip, and a jaw that lets the end contract across."""
    content = diagnosed(tmp_path, side)
    end = content["free_end"]
    assert content["verdict"] == "outside_library" and content["named"] == []
    assert end["nodes"] == "RIGHT" and end["share"] > 0.9 and content["mismatch"]["side"] == "boundary"
    assert (end["shapes"][0]["component"], end["shapes"][0]["words"]) == (component, words)
    E = end["parameters"]["BODY.E"]
    assert abs(E["value"] - TRUTH["E"]) < 3.0 * E["std"]
    assert content["next_experiment"].startswith("take the motion of RIGHT from the images")
    assert content["headline"].startswith("The end RIGHT moves in a way that no candidate describes")
    assert "The end RIGHT moves" in (tmp_path / "run/diagnosis.html").read_text(encoding="utf-8")


@pytest.mark.slow
@pytest.mark.parametrize("side, name", [
    (Side(modulus=lambda c: np.where(np.hypot(*(c - (3.6, 1.2)).T) < 1.0, 0.7, 1.0)), "heterogeneity"),
    (shaped("x", 0.0, 0.0015), "grip_rotation")])
def test_a_cause_of_the_library_at_that_end_keeps_its_name(side, name, tmp_path):
    """A soft spot that nearly touches the end, and a grip that turns."""
    content = diagnosed(tmp_path, side)
    assert content["named"] == [name] and content["free_end"] is None
