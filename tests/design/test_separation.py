"""Planned tests that shall tell candidates apart: odds, edits carried into a plan, courses, the command."""

from __future__ import annotations

import json

import numpy as np
import pytest
from planned_tests import FORCE, GRIPS, PLAN, plan_folder
from typer.testing import CliRunner

import idic
from idic.cli.app import app
from idic.errors import InputError
from idic.experiment_file import read_toml
from idic.identification import expected_odds, load_plan
from idic.run.separation.courses import Course, best_course, menu
from idic.run.separation.members import Diagnosed, RefittedModel, carried_edits, planned, undecided
from idic.virtual_tests import simulate

ELASTIC = """
[material.BODY]
law = "elastic"
E = { value = 2000, unit = "MPa", identify = true }
nu = { value = 0.35, identify = true }
"""
CURVED = {"dof": [{"name": "channel.force_N.curvature"}]}


def law(name, **values):
    free = {key: {"value": value, "identify": True} | ({} if key in ("nu", "nonlinearity") else {"unit": "MPa"})
            for key, value in values.items()}
    return {"material.BODY": {"law": name, **free}}


NONLINEAR = law("nonlinear_elastic", E=2000.0, nu=0.35, nonlinearity=-14.0)
PLASTIC = law("j2_linear", E=2000.0, nu=0.35, yield_stress=15.0, hardening_modulus=800.0)


def plan(folder, program, n_frames=12):
    return plan_folder(folder, ELASTIC + GRIPS + FORCE + PLAN.replace("n_frames = 6", f"n_frames = {n_frames}")
                       + f"\n[design.program]\ngrip_mm = {program}\n")


def odds(folder, *edits):
    return expected_odds({str(number): load_plan(folder, edit) for number, edit in enumerate(edits)})


def test_a_model_is_not_told_from_itself_and_odds_grow_with_frames(tmp_path):
    far = plan(tmp_path / "far", "[[0, 0], [11, 0.09]]")
    (same,) = odds(far, NONLINEAR, NONLINEAR)
    assert same.log_odds == pytest.approx(0.0)
    (pair,) = odds(far, NONLINEAR, PLASTIC)
    assert (np.diff(pair.log_odds) > -1e-6 * pair.log_odds[-1]).all() and pair.log_odds[-1] > 10.0
    content = pair.content()
    assert pair.log_odds[content["frames"] - 1] >= np.log(99.0) > pair.log_odds[content["frames"] - 2]
    assert content["load"] == pytest.approx(content["frames"] / 11)


def test_unloading_separates_yield_from_a_bent_line_and_a_small_load_separates_nothing(tmp_path):
    unload, tiny = (plan(tmp_path / name, program) for name, program in (
        ("unload", "[[0, 0], [6, 0.09], [11, 0]]"), ("tiny", "[[0, 0], [11, 0.01]]")))
    (pair,) = odds(unload, PLASTIC, NONLINEAR)
    assert pair.content()["frames"] is not None
    (pair,) = odds(tiny, PLASTIC, NONLINEAR)
    assert pair.content()["frames"] is None and pair.log_odds[-1] < 0.1


def test_an_edit_changes_in_a_plan_what_it_changed_in_the_run(tmp_path):
    """The plan has its boundaries in another order and drives the held edge."""
    base = {"boundary": [{"nodes": "LEFT", "ux": 0.0}, {"nodes": "RIGHT", "ux": {"column": "grip_mm"}}],
            "material": {"BODY": {"law": "elastic"}}}
    slip = {"kind": "slip", "from_s": 3.0}
    edits = {"boundary": [{"nodes": "LEFT", "ux": {"value": 0.0, "corrections": [slip]}}, base["boundary"][1]],
             "dof": [{"name": "channel.force_N.scale"}]}
    own_dof = {"name": "camera.rotation"}
    document = base | {"dof": [own_dof], "boundary": [{"nodes": "RIGHT", "ux": {"column": "other_mm"}},
                                                      {"nodes": "LEFT", "ux": {"column": "back_mm"}}]}
    carried = carried_edits(RefittedModel("grip_slip", edits, {}), base, document, tmp_path)
    assert carried["boundary"] == [document["boundary"][0],
                                   {"nodes": "LEFT", "ux": {"column": "back_mm", "corrections": [slip]}}]
    assert carried["dof"] == [own_dof, edits["dof"][0]]
    with pytest.raises(InputError, match="has not what a candidate changes"):
        carried_edits(RefittedModel("grip_slip", edits, {}), base, {"boundary": document["boundary"][:1]}, tmp_path)
    with pytest.raises(InputError, match="has not what a candidate changes"):
        carried_edits(RefittedModel("plasticity", PLASTIC, {}), base, {"material": {"OTHER": {}}}, tmp_path)


def test_a_share_of_the_load_cell_keeps_its_size_in_a_plan(tmp_path):
    folder = plan(tmp_path / "plan", "[[0, 0], [11, 0.09]]")
    model = RefittedModel("load_cell_curvature", CURVED, {"channel.force_N.curvature": 0.05, "BODY.E": 2100.0})
    made = planned(model, Diagnosed((model,), read_toml(folder / "experiment.toml"), {"force_N": 120.0}), folder, None,
                   None)
    assert made.experiment.model.channels[0].largest == 120.0
    assert made.experiment.model.parameters["BODY.E"].value == 2100.0


def test_the_search_finds_the_course_and_stays_within_load_and_time():
    program = {"grip_mm": [[0, 0], [10, 0.2]], "side_mm": [[0, 0], [10, -0.1]]}
    aim = (0.5, 1.0, -1.0, 0.0)

    def merit(course: Course) -> float:
        return -sum((a - b) ** 2 for a, b in zip(course.shape, aim, strict=True)) - 0.1 * (len(course.columns) == 1)

    best, value = best_course(program, merit)
    assert best.shape == aim and value == 0.0 and "50, 100, -100, 0 %" in best.words
    assert best.program(program) == {"grip_mm": [[0, 0], [2.5, 0.1], [5, 0.2], [7.5, -0.2], [10, 0]],
                                     "side_mm": [[0, 0], [2.5, -0.05], [5, -0.1], [7.5, 0.1], [10, 0]]}
    alone = [course for course in menu(program) if course.columns == ("side_mm",)]
    assert alone[0].program(program)["grip_mm"] == [[0, 0], [2.5, 0], [5, 0], [7.5, 0], [10, 0]]


def test_what_is_undecided_is_the_set_else_the_first_two_refits():
    refits = [{"name": name} for name in "abc"]
    assert undecided({"indistinguishable": [["b", "c"]], "refits": refits}) == ["b", "c"]
    assert undecided({"set": ["a", "c"], "indistinguishable": [], "refits": refits}) == ["a", "c"]
    assert undecided({"indistinguishable": [], "named": ["c"], "refits": refits}) == ["c", "a"]


def test_a_run_without_a_diagnosis_is_refused_before_anything_is_written(tmp_path):
    folder = plan(tmp_path / "plan", "[[0, 0], [11, 0.09]]")
    (tmp_path / "run").mkdir()
    command = ["design", str(folder), "--separate", str(tmp_path / "run"), "--out", str(tmp_path / "out")]
    answer = CliRunner().invoke(app, command)
    assert answer.exit_code == 2 and "not diagnosed" in answer.output and not (tmp_path / "out").exists()
    (tmp_path / "run" / "diagnosis.json").write_text(json.dumps({"refits": [{"name": "plasticity"}]}))
    answer = CliRunner().invoke(app, command)
    assert answer.exit_code == 2 and "damaged diagnosis" in answer.output and not (tmp_path / "out").exists()


@pytest.mark.slow
def test_a_diagnosed_run_ranks_plans_and_gets_a_course(tmp_path):
    """A stiffness that falls with strain: load cell, drift and finite strains stay beside it under a steady load."""
    source = plan(tmp_path / "source", "[[0, 0], [11, 0.09]]")
    file = simulate(source, tmp_path / "test", NONLINEAR, seed=1)
    text = file.read_text().replace("nonlinear_elastic", "elastic")
    file.write_text(text.replace("[material.BODY.nonlinearity]\nvalue = -14.0\nidentify = true\n", ""))
    idic.identify(tmp_path / "test", tmp_path / "run")
    runner = CliRunner()
    told = runner.invoke(app, ["diagnose", str(tmp_path / "run"), "--workers", "0", "--no-prefect"])
    assert told.exit_code == 0 and "idic design --separate RUN PLAN" in told.output
    tiny = plan(tmp_path / "tiny", "[[0, 0], [11, 0.005]]")
    back = plan(tmp_path / "back", "[[0, 0], [6, 0.12], [11, 0]]")
    answer = runner.invoke(app, ["design", str(tiny), str(back), "--separate", str(tmp_path / "run"), "--out",
                                 str(tmp_path / "out"), "--workers", "0"])
    assert answer.exit_code == 0, answer.output
    separation = json.loads((tmp_path / "out" / "design.json").read_text())["separation"]
    assert {"nonlinear_elasticity", "load_cell_curvature"} <= set(separation["members"])
    assert [entry["name"] for entry in separation["plans"]] == ["back", "tiny"]
    assert separation["plans"][1]["separated"] == 0 < separation["plans"][0]["separated"]
    assert separation["course"]["separated"] >= separation["plans"][0]["separated"]
    page = (tmp_path / "out" / "design.html").read_text()
    assert "Which plan tells the candidates apart" in page and separation["sentences"][0] in page
