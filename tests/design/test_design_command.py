"""`idic design` as a user meets it: files out, sentences, comparison of plans, messages about bad input."""

import csv
import io
import json
import pickle
import re

import numpy as np
import pytest
import tifffile
from planned_tests import ELASTIC, FORCE, GRIPS, PLAN, PROGRAM, plan_folder, recorded_folder
from rich.console import Console
from typer.testing import CliRunner

import idic
from idic.cli.app import app
from idic.cli.tables import show
from idic.errors import InputError
from idic.experiment_file import load_experiment, read_toml
from idic.report import design_lines
from idic.report.design.page import _facts
from idic.report.design.words import best_plan
from idic.report.design.page import draw_design, render_design
from idic.report.design.words import direction, fixed_product, headline, open_parameters, weakest
from idic.identification import Plan, expected_odds
from idic.run.design import DesignJob, evaluate_plans, plan_names, run_design
from idic.run import write_design
from idic.run.separation.courses import Course, best_course, menu
from idic.run.separation.members import Diagnosed, RefittedModel, carried_edits, planned, undecided
from idic.run.separation.separate import _merit, _of_plan  # noqa: F401  (of test_separated_in_simulated_tests)
from idic.virtual_tests import simulate

PLY = """
[material.BODY]
law = "orthotropic"
E1 = { value = 4000, unit = "MPa", identify = true }
E2 = { value = 2000, unit = "MPa", identify = true }
nu12 = 0.3
G12 = { value = 900, unit = "MPa", identify = true }
angle = ANGLE
"""


@pytest.fixture(scope="module")
def two_orientations(tmp_path_factory):
    """A ply pulled along its fibres and across them, compared."""
    top = tmp_path_factory.mktemp("plies")
    for name, angle in (("along", 0.0), ("across", 90.0)):
        plan_folder(top / name, PLY.replace("ANGLE", str(angle)) + GRIPS + FORCE + PLAN + PROGRAM)
    return top, write_design([top / "along", top / "across"], top / "out", workers=0)


def test_of_two_orientations_each_is_better_for_its_own_modulus(two_orientations):
    comparison = two_orientations[1]["comparison"]["parameters"]
    assert comparison["BODY.E1"]["best"] == "along" and comparison["BODY.E2"]["best"] == "across"
    assert best_plan(two_orientations[1]["comparison"]).count("is better for") == 2


def test_all_plans_together_are_better_than_any_of_them(two_orientations):
    for entry in two_orientations[1]["comparison"]["parameters"].values():
        assert entry["joint"] < min(entry["std"].values())


def test_the_files_out_are_complete_and_the_page_needs_no_other(two_orientations):
    top, content = two_orientations
    assert json.loads((top / "out" / "design.json").read_text()) == json.loads(json.dumps(content))
    page = (top / "out" / "design.html").read_text()
    assert not re.findall(r'(?:src|href)="(?!data:|#)', page)  # its script stands in it
    assert all(word in page for word in ("E1", "along", "across", "virtual speckle", "all together", "✓"))
    names = {file.stem for file in (top / "out" / "figures").iterdir()}
    assert {"expected_std", "growth_along", "sensitivities_across", "spectrum_along", "correlation_across"} <= names
    rows = list(csv.DictReader((top / "out" / "design.csv").open()))
    assert [row["plan"] for row in rows] == ["along"] * 3 + ["across"] * 3 + ["joint"] * 3
    stored = content["plans"][0]["parameters"]["BODY.E1"]["std"]
    assert float(rows[0]["std"]) == pytest.approx(stored, rel=1e-8)


def test_a_plan_crosses_to_another_process_and_gives_the_same_numbers_there(two_orientations):
    top, content = two_orientations
    job = pickle.loads(pickle.dumps(DesignJob("along", Plan.of(top / "along"))))
    design = pickle.loads(pickle.dumps(run_design(job)))
    stds = {name: entry["std"] for name, entry in content["plans"][0]["parameters"].items()}
    assert {name: design.full.std(name) for name in design.names} == stds


@pytest.mark.slow
def test_two_workers_give_the_same_numbers_as_none(two_orientations):
    top, content = two_orientations
    again, _ = evaluate_plans([top / "along", top / "across"], workers=2)
    assert again == content


def test_numbers_are_in_the_units_of_the_user(tmp_path):
    toml = ELASTIC.replace('value = 1200, unit = "MPa"', 'value = 1.2, unit = "GPa"')
    entries = []
    for name, text in (("MPa", ELASTIC), ("GPa", toml)):
        folder = plan_folder(tmp_path / name, text + GRIPS + FORCE + PLAN + PROGRAM)
        entries.append(evaluate_plans([folder])[0]["plans"][0])
    first, second = (entry["parameters"]["BODY.E"] for entry in entries)
    assert second["unit"] == "GPa" and second["std"] == pytest.approx(1e-3 * first["std"])
    assert second["motion_px"] == pytest.approx(first["motion_px"])
    growth = [entry["growth"]["std"]["BODY.E"][-1] for entry in entries]
    assert growth == pytest.approx([first["std"], second["std"]])


def test_the_sentences_name_open_parameters_and_fixed_combinations(tmp_path):
    toml = ELASTIC + GRIPS + FORCE + '[[dof]]\nname = "geometry.thickness"\n' + PLAN + PROGRAM
    plan = evaluate_plans([plan_folder(tmp_path / "plan", toml)])[0]["plans"][0]
    said = " ".join((headline(plan), *open_parameters(plan), weakest(plan)))
    assert "cannot be told apart from geometry.thickness" in said
    assert "the test determines BODY.E·geometry.thickness" in said
    assert {"names": ["BODY.E", "geometry.thickness"], "correlation": None} in plan["confusable"]


FIELDS = """
[experiment]
fields = "stage_*.csv"
mesh = { roi_mm = [1, 1, 19, 9], element_mm = 4 }
kind = "plane_stress"
[material.SPECIMEN]
law = "elastic"
E = 70e3
nu = { value = 0.3, identify = true }
[[boundary]]
nodes = "OUTER"
u = "measured"
"""


def test_the_design_of_measured_fields_tells_of_points_and_millimetres(tmp_path):
    rng = np.random.default_rng(0)
    x, y = (axis.ravel() for axis in np.meshgrid(np.arange(0.0, 20.1, 0.5), np.arange(0.0, 10.1, 0.5)))
    for k in range(3):
        u = np.column_stack([0.002 * k * x, -0.0006 * k * y]) + rng.normal(0.0, 1e-4, (len(x), 2))
        rows = [f"{a},{b},{c:.7f},{d:.7f}" for a, b, c, d in np.column_stack([x, y, u])]
        (tmp_path / f"stage_{k}.csv").write_text("\n".join(["x_mm,y_mm,u_mm,v_mm", *rows]))
    (tmp_path / "experiment.toml").write_text(FIELDS)
    content, drawn = evaluate_plans([tmp_path], workers=0)
    (plan,) = content["plans"]
    facts = dict(_facts(plan))
    number, rest = facts["measured fields"].split(" ", 1)
    # 37 x 17 points at 0.5 mm; those next to the edges of the mesh may be left out
    assert 480 <= int(number) <= 37 * 17 and rest == "points, 0.5 mm apart"
    assert facts["noise of a component σ"].endswith("µm") and not {"image", "camera noise σ"} & set(facts)
    console = Console(width=140, file=io.StringIO())
    show(console, design_lines(content))
    told = console.file.getvalue()
    motion = float(re.search(r"largest motion (\S+) mm", told)[1])
    assert motion == pytest.approx(0.004 * 19, rel=0.05)  # 1 mm from the end at x = 20 mm
    assert facts["largest motion"] == f"{motion:.3g} mm" and "motion mm" in told and "px" not in told
    page = render_design(content, draw_design(content, drawn))
    assert "the noise of fields" in page and "How far the points move" in page and "motion of the points" in page
    own = re.sub(r'data:image[^"]+|digital image correlation|<(style|script)>.*?</', "", page, flags=re.DOTALL)
    for of_images in ("image", "pattern", "camera"):
        assert of_images not in told and of_images not in own, of_images


def test_parameters_that_need_the_force_are_reported(tmp_path):
    folder = plan_folder(tmp_path / "plan")
    plan = evaluate_plans([folder])[0]["plans"][0]
    assert any(text.startswith("E cannot be determined without force_N") for text in open_parameters(plan))


def test_a_pair_is_confusable_above_the_limit_and_not_below(tmp_path):
    folder = plan_folder(tmp_path / "plan")
    pairs = {limit: evaluate_plans([folder], confusable=limit)[0]["plans"][0]["confusable"]
             for limit in (0.001, 0.999)}
    assert [pair["names"] for pair in pairs[0.001]] == [["BODY.E", "BODY.nu"]] and pairs[0.999] == []


def test_the_fixed_product_is_constant_along_the_weak_direction():
    for vector in ((1.0, -0.19), (1.0, -1.0), (0.5, 0.8), (0.3, -0.9)):
        text = fixed_product(np.array(vector), ["K", "n"], [None, None])
        K, n = np.exp(vector)
        value = eval(text.replace("·", "*").replace("^", "**"), {"K": K, "n": n})  # noqa: S307
        assert value == pytest.approx(1.0, abs=0.03)  # powers are written to two digits
    assert fixed_product(np.array([0.5, 0.5, 0.7]), ["a", "b", "c"], [None] * 3) is None
    assert direction(np.array([0.19, -0.98, 0.01]), ["n", "K", "E"], [None] * 3) == "ln K +0.98, ln n -0.19"


@pytest.fixture
def planned_folder_of_two(tmp_path):
    toml = ELASTIC + GRIPS + FORCE + PLAN.replace("n_frames = 6", "n_frames = 2") + PROGRAM
    return plan_folder(tmp_path / "plan", toml)


# folders ------------------------------------------------------------------------------------------
def test_a_recorded_test_is_used_as_it_is(tmp_path):
    folder = recorded_folder(tmp_path / "test")
    plan, experiment = Plan.of(folder), load_experiment(folder)
    assert plan.pattern == "images"
    assert np.array_equal(plan.experiment.model.channels[0].values, experiment.model.channels[0].values)
    assert np.array_equal(plan.experiment.model.times, experiment.model.times)


def test_images_without_a_log_follow_the_programme(tmp_path):
    folder = recorded_folder(tmp_path / "test", ELASTIC + GRIPS + FORCE + PROGRAM)
    (folder / "loads.csv").unlink()
    experiment = Plan.of(folder).experiment
    assert experiment.model.n_frames == 6 and experiment.model.times[-1] == 5.0
    assert np.allclose(experiment.model.prescribed[2].drive.values, [0.0, 0.03, 0.06, 0.09, 0.12, 0.10])


@pytest.mark.parametrize("change, words", [
    (("[design]", "[options]\nalpha = 0.01\n[design]\nimage_pixels = [1, 2]"), ["image_pixels", "image_px"]),
    (("n_frames = 6", ""), ["n_frames", "[design]"]),
    (("image_px = [140, 100]", ""), ["image_px", "no images"]),
    (("grip_mm = [[0, 0], [4, 0.12], [5, 0.10]]", "grap_mm = [[0, 0], [5, 0.1]]"), ["grip_mm", "design.program"]),
    (("grip_mm = [[0, 0]", "grap_mm = [[0, 0], [5, 0]]\ngrip_mm = [[0, 0]"), ["grap_mm", "did you mean grip_mm"]),
    (("n_frames = 6", "n_frames = 6\nduration_s = 9"), ["does not cover the test", "0 to 9 s"]),
    (("[4, 0.12], [5, 0.10]", "[4, 0.12], [3, 0.10]"), ["not sorted", "grip_mm"]),
    (("grip_mm = [[0, 0]", "force_N = [[0, 0], [5, 9]]\ngrip_mm = [[0, 0]"), ["channel", "force_N"]),
    (("noise_std = 1.0", ""), ["noise_std", "force_N"]),
    (("E = { value = 1200, unit = \"MPa\", identify = true }\nnu = { value = 0.25, identify = true }",
      "E = 1200\nnu = 0.25"), ["no parameter", "identify = true"]),
])
def test_bad_plans_are_refused_with_a_remedy_and_nothing_is_written(change, words, tmp_path):
    text = ELASTIC + GRIPS + FORCE + PLAN + PROGRAM
    assert change[0] in text
    folder = plan_folder(tmp_path / "plan", text.replace(*change))
    with pytest.raises(InputError) as problem:
        write_design([folder], tmp_path / "out", workers=0)
    assert all(word in str(problem.value) for word in words), str(problem.value)
    assert not (tmp_path / "out").exists()


def test_a_folder_without_images_and_without_a_plan_gets_the_missing_keys(tmp_path):
    folder = plan_folder(tmp_path / "plan", ELASTIC + GRIPS + FORCE)
    with pytest.raises(InputError, match=r"no images of a test yet(.|\n)*\[design\] with image_px"):
        Plan.of(folder)


def test_a_photograph_of_another_size_is_refused(tmp_path):
    folder = plan_folder(tmp_path / "plan", images='images = "speckle.tif"')
    tifffile.imwrite(folder / "speckle.tif", np.zeros((8, 8), np.uint8))
    with pytest.raises(InputError, match="not the size of the photograph"):
        Plan.of(folder)


def test_identification_refuses_a_test_that_is_only_planned(tmp_path):
    folder = plan_folder(tmp_path / "plan")
    with pytest.raises(InputError, match="there are no images(.|\n)*run the test"):
        load_experiment(folder)


def test_a_planned_test_can_be_simulated_and_then_identified(planned_folder_of_two, tmp_path):
    """The images and the log that the plan lacks are rendered; the new folder is a test that was made."""
    made = simulate(planned_folder_of_two, tmp_path / "made", noise_std_gv=2.0)
    experiment = load_experiment(made)
    assert experiment.model.n_frames == 2 and experiment.recording.stack.shape == (100, 140)
    assert experiment.model.channels[0].values[1] > 50.0  # N: 0.10 mm of 6 mm at 1200 MPa on 6 mm² less the waist
    assert Plan.of(made).pattern == "images"


def test_plans_are_named_by_their_folders_and_by_more_where_those_are_equal(tmp_path):
    assert plan_names(["x/plan-a", "x/plan-b"]) == ["plan-a", "plan-b"]
    assert plan_names(["x/plan", "y/plan"]) == ["x/plan", "y/plan"]
    with pytest.raises(InputError, match="given twice"):
        plan_names(["x/plan", "x/plan"])


def test_the_command_prints_a_table_and_ends_with_zero_and_bad_input_with_two(tmp_path):
    folder, out = plan_folder(tmp_path / "plan"), tmp_path / "out"
    command = ["design", str(folder), "--out"]
    answer = CliRunner(env={"COLUMNS": "140"}).invoke(app, [*command, str(out), "--noise-gv", "3"])
    assert answer.exit_code == 0, answer.stderr
    assert "BODY.nu" in answer.stdout and "image noise: 3 grey values" in answer.stdout and str(out) in answer.stdout
    bad = CliRunner().invoke(app, [*command, str(tmp_path / "bad"), "--confusable", "2"])
    assert bad.exit_code == 2 and "--confusable" in bad.stderr and not (tmp_path / "bad").exists()


# candidates of a diagnosed run, told apart -------------------------------------------------------
LINEAR_BODY = """
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


def course_plan(folder, program, n_frames=12):
    return plan_folder(folder, LINEAR_BODY + GRIPS + FORCE + PLAN.replace("n_frames = 6", f"n_frames = {n_frames}")
                       + f"\n[design.program]\ngrip_mm = {program}\n")


def odds(folder, *edits):
    return expected_odds({str(number): Plan.of(folder, edit) for number, edit in enumerate(edits)})


def test_a_model_is_not_told_from_itself_and_odds_grow_with_frames(tmp_path):
    far = course_plan(tmp_path / "far", "[[0, 0], [11, 0.09]]")
    (same,) = odds(far, NONLINEAR, NONLINEAR)
    assert same.log_odds == pytest.approx(0.0)
    (pair,) = odds(far, NONLINEAR, PLASTIC)
    assert (np.diff(pair.log_odds) > -1e-6 * pair.log_odds[-1]).all() and pair.log_odds[-1] > 10.0
    content = pair.content()
    assert pair.log_odds[content["frames"] - 1] >= np.log(99.0) > pair.log_odds[content["frames"] - 2]
    assert content["load"] == pytest.approx(content["frames"] / 11)


def test_unloading_separates_yield_from_a_bent_line_and_a_small_load_separates_nothing(tmp_path):
    unload, tiny = (course_plan(tmp_path / name, program) for name, program in (
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
    folder = course_plan(tmp_path / "plan", "[[0, 0], [11, 0.09]]")
    model = RefittedModel("load_cell_curvature", CURVED, {"channel.force_N.curvature": 0.05, "BODY.E": 2100.0})
    made = planned(model, Diagnosed((model,), read_toml(folder / "experiment.toml"), {"force_N": 120.0}), folder, None,
                   None)
    assert made.experiment.model.channels[0].largest == 120.0
    assert made.experiment.model.parameters["BODY.E"].value == 2100.0


def test_the_search_finds_the_course_and_stays_within_load_and_time():
    program = {"grip_mm": [[0, 0], [10, 0.2]], "side_mm": [[0, 0], [10, -0.1]]}
    aim = (0.5, 1.0, -1.0, 0.0)

    def merit(course: Course) -> float:
        return -sum((a - b) ** 2 for a, b in zip(course.shape, aim, strict=True)) - 0.1 * (len(course.direction) == 1)

    best, value = best_course(program, merit)
    assert best.shape == aim and value == 0.0 and "50, 100, -100, 0 %" in best.words
    assert best.program(program) == {"grip_mm": [[0, 0], [2.5, 0.1], [5, 0.2], [7.5, -0.2], [10, 0]],
                                     "side_mm": [[0, 0], [2.5, -0.05], [5, -0.1], [7.5, 0.1], [10, 0]]}
    alone = [course for course in menu(program) if course.direction == (("side_mm", 1),)]
    assert alone[0].program(program)["grip_mm"] == [[0, 0], [2.5, 0], [5, 0], [7.5, 0], [10, 0]]
    assert alone[0].words == "side_mm alone, load, then unload"


def test_the_search_finds_the_direction():
    program = {"grip_mm": [[0, 0], [10, 0.2]], "side_mm": [[0, 0], [10, -0.1]]}
    wanted = (("grip_mm", 1), ("side_mm", -1))
    best, _ = best_course(program, lambda course: (course.direction == wanted) + course.shape.count(1.0))
    assert best.direction == wanted and best.words.startswith("grip_mm against side_mm, ")
    assert best.program(program)["side_mm"][-1] == [10, 0.1]


def test_what_is_undecided_is_the_set_else_the_first_two_refits():
    refits = [{"name": name} for name in "abc"]
    assert undecided({"indistinguishable": [["b", "c"]], "refits": refits}) == ["b", "c"]
    assert undecided({"set": ["a", "c"], "indistinguishable": [], "refits": refits}) == ["a", "c"]
    assert undecided({"indistinguishable": [], "named": ["c"], "refits": refits}) == ["c", "a"]


def test_a_run_without_a_diagnosis_is_refused_before_anything_is_written(tmp_path):
    folder = course_plan(tmp_path / "plan", "[[0, 0], [11, 0.09]]")
    (tmp_path / "run").mkdir()
    command = ["design", str(folder), "--separate", str(tmp_path / "run"), "--out", str(tmp_path / "out")]
    answer = CliRunner().invoke(app, command)
    assert answer.exit_code == 2 and "not diagnosed" in answer.output and not (tmp_path / "out").exists()
    (tmp_path / "run" / "diagnosis.json").write_text(json.dumps({"refits": [{"name": "plasticity"}]}))
    answer = CliRunner().invoke(app, command)
    assert answer.exit_code == 2 and not (tmp_path / "out").exists()
    assert "does not hold what idic writes" in answer.output.replace("\n", " ")


@pytest.mark.slow
def test_a_diagnosed_run_ranks_plans_and_gets_a_course(tmp_path):
    """A stiffness that falls with strain: load cell, drift and finite strains stay beside it under a steady load."""
    source = course_plan(tmp_path / "source", "[[0, 0], [11, 0.09]]")
    file = simulate(source, tmp_path / "test", NONLINEAR, seed=1)
    text = file.read_text().replace("nonlinear_elastic", "elastic")
    file.write_text(text.replace("[material.BODY.nonlinearity]\nvalue = -14.0\nidentify = true\n", ""))
    idic.identify(tmp_path / "test", tmp_path / "run")
    runner = CliRunner()
    told = runner.invoke(app, ["diagnose", str(tmp_path / "run"), "--workers", "0", "--no-prefect"])
    assert told.exit_code == 0 and "idic design --separate RUN PLAN" in told.output
    tiny = course_plan(tmp_path / "tiny", "[[0, 0], [11, 0.005]]")
    back = course_plan(tmp_path / "back", "[[0, 0], [6, 0.12], [11, 0]]")
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
