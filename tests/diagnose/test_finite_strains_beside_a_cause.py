"""A cause hides what finite strains do; once it is in the model they are counted, and its course is asked again."""

from dataclasses import replace

import pytest
from side_twins import ANY_SIZE
from test_revision import chosen, ranked, refit, screening, sets

from idic.diagnose import Variant
from idic.diagnose.selection.rival import Rival
from idic.diagnose.selection.moves.finite_strains import plain_if_enough
from idic.diagnose.selection.rival import MIN_HELDOUT_DROP
from idic.diagnose.selection.rivals import edits_of, finite
from idic_studies.trial.scenes.recording import Paint, write_public
from idic_studies.trial.scenes.scene import NULLS
from idic_studies.trial.scenes.setup import direction
from idic_studies.trial.scenes.solve import solve
from idic_studies.trial.scenes.worlds import world_scene
from idic_studies.trial.tool_run import run_tool

WORLD = {"specimen": "hole", "columns": 132, "frames": 16, "programme": "unloading", "thickness": 0.5, "solid": False,
         "finite": False, "noise": "white"}


def rival(left, knots):
    """A winner with so many unknowns that leaves so much chi-square."""
    answer = refit(("friction",), left)
    stds = {f"knot[{k}]": 0.1 for k in range(knots)}
    return Rival(ranked("friction"), replace(answer, stds=stds), 100.0, 100.0, 100.0, practical=ANY_SIZE)


@pytest.mark.parametrize("gain, goes_back", [(0.0, True), (MIN_HELDOUT_DROP + 3.5, True),
                                             (MIN_HELDOUT_DROP + 5.0, False)])
def test_a_course_that_brings_less_than_its_knots_must_goes_back_to_the_former_one(gain, goes_back):
    free, plain = rival(50.0, 5), rival(50.0 + gain, 1)
    assert (plain_if_enough([free, plain]) is plain) is goes_back
    assert plain_if_enough([free]) is free
    failed = replace(plain, refitted=replace(plain.refitted, choice=None, judgement=None))
    assert plain_if_enough([free, failed]) is free


def test_a_law_that_a_cause_brings_gets_its_finite_form_and_an_edit_of_the_log_stays():
    table = {"law": "orthotropic", "kinematics": "small", "E1": 3.0}
    edits = {"material.BODY": table, "channel": [{"column": "F", "drift_knots": 6}]}
    (one,) = chosen(("magnification",), sets(((), 500.0), (("magnification",), 10.0)))
    variant = Variant("orthotropic", edits, ("BODY.E2",), {"BODY.E2": 3.0})
    winner = replace(one.winner, ranked=replace(one.winner.ranked, variant=variant, label="orthotropic"),
                     refitted=replace(one.winner.refitted, label="orthotropic"))
    found = edits_of(finite(winner, screening()), screening())
    assert found == {"material.BODY": {**table, "kinematics": "finite"}, "channel": edits["channel"]}
    assert table["kinematics"] == "small"


@pytest.mark.slow
def test_friction_of_a_body_with_finite_strains_is_told_alone_and_they_are_said(tmp_path):
    """Truth on another mesh, with finite strains; the user's law has small ones."""
    true = NULLS["elastic"].truth
    user = world_scene(WORLD, "elastic", 2.0, true)
    user = replace(user, force=lambda F: F * (1.0 + 0.02 * direction(user)))
    body = replace(user, kinematics="finite")
    write_public(tmp_path, user, solve(body), Paint(3, 4))
    answer = run_tool(tmp_path).content
    entry = answer["model"]["parameters_after"]["BODY.E"]
    assert answer["verdict"] == "single" and answer["named"] == ["friction"], answer["headline"]
    assert abs(entry["value"] - true["E"]) < 3.0 * entry["std"] < 0.02 * true["E"]
    assert any("shows finite strains" in caution for caution in answer["cautions"])
    assert entry["value"] < answer["model"]["parameters_before"]["BODY.E"]["value"] - 0.03 * true["E"]
