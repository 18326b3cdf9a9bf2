"""Several experiments with shared materials: what they determine together, and the RUN that they leave."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

sys.path[:0] = [str(Path(__file__).parents[1] / "identify")]

from twin_runs import ELASTIC, FORCE, GRIPS, TRUTH, Twin, write_folder  # noqa: E402

import idic  # noqa: E402
from idic.errors import InputError  # noqa: E402
from idic.experiment_file import load_experiment  # noqa: E402
from idic.identification import Joint, identify  # noqa: E402
from idic.run import compare_runs, folders_of, points, write_comparison, write_report  # noqa: E402
from idic.run.store.state_file import load_state, save_state  # noqa: E402

TURNED = """
[[dof]]
name = "camera.rotation_deg"
"""
STAGED = """
[[stage]]
free = ["BODY.E"]
[[stage]]
free = "all"
"""


@pytest.fixture(scope="module")
def pair(tmp_path_factory):
    """Two specimens of one material in two recordings: the first with a schedule of two stages, the second with none
    and an unknown turn of its camera."""
    root = tmp_path_factory.mktemp("pair")
    first = write_folder(root / "first", Twin(seed=1), ELASTIC + GRIPS + FORCE + STAGED)
    second = write_folder(root / "second", Twin(seed=2, grip=(0.0, 0.05, 0.1, 0.05, 0.0, 0.06)),
                          ELASTIC + GRIPS + FORCE + TURNED)
    return [first, second]


@pytest.fixture(scope="module")
def together(pair, tmp_path_factory):
    run = tmp_path_factory.mktemp("run") / "both"
    return run, idic.identify(pair, run)


@pytest.mark.slow  # 10 s of CPU time
def test_two_experiments_have_the_standard_deviation_of_their_weighted_mean(pair, together):
    alone = [identify(load_experiment(path)).result["parameters"] for path in pair]
    _, both = together
    assert both["status"] == "converged"
    for name, truth in TRUTH.items():
        entry = both["parameters"][f"BODY.{name}"]
        stds = [own[f"BODY.{name}"]["std"] for own in alone]
        # of E and nu each by itself: their correlation moves the mean a little, linearisation points differ
        assert entry["std"] == pytest.approx(sum(s**-2 for s in stds) ** -0.5, rel=0.05)
        weights = np.array(stds) ** -2.0
        mean = weights @ [own[f"BODY.{name}"]["value"] for own in alone] / weights.sum()
        assert entry["value"] == pytest.approx(mean, abs=0.5 * entry["std"])
        assert entry["value"] == pytest.approx(truth, abs=4 * entry["std"] + 0.01 * truth)  # the coarse mesh's own bias


def test_the_camera_of_one_experiment_is_no_business_of_the_other(together):
    run, both = together
    assert set(both["parameters"]) >= {"BODY.E", "BODY.nu", "second.camera.rotation_deg"}
    assert not [name for name in both["parameters"] if name.startswith("first.camera.rotation")]
    turn = both["parameters"]["second.camera.rotation_deg"]
    assert abs(turn["value"]) < 3 * turn["std"] < 0.5  # seen only where the specimen turns or deforms
    assert {frame["experiment"] for frame in both["frames"]} == {"first", "second"}
    assert set(both["residual"]["channel_rms"]) == {"first.force_N", "second.force_N"}
    for name in ("first", "second"):
        part = json.loads((run / "experiments" / name / "result.json").read_text())
        assert part["parameters"]["BODY.E"]["std"] == both["parameters"]["BODY.E"]["std"]
        assert part["residual"]["image_chi2_dof"] == pytest.approx(1.0, abs=0.1)


def test_an_experiment_without_a_schedule_ends_in_the_last_stage_of_the_other_one(together):
    run, both = together
    assert both["stages"] == 2 and both["status"] == "converged"
    for name in ("first", "second"):
        part = json.loads((run / "experiments" / name / "result.json").read_text())
        assert part["stages"] == 2 and part["parameters"]["BODY.E"]["std_model"] is not None
        assert "motion" in part["discrepancy"]["motion_px"] and f"{name}.motion" in both["discrepancy"]["motion_px"]


@pytest.mark.slow  # steps side by side of one experiment: identify/test_parallel_steps.py
def test_steps_side_by_side_lead_several_experiments_to_the_same_answer(pair, together, tmp_path):
    """From a third of the modulus: a step of twice the limit is worth it for both."""
    _, both = together
    far = {"material.BODY.E.value": TRUTH["E"] / 3.0, "options.trial_steps": 3}
    found = idic.identify(pair, tmp_path / "run", overrides=far)
    assert found["status"] == "converged" and found["rounds"] < found["evaluations"]
    for name, entry in both["parameters"].items():
        # two ends of one search: each stops when its next step is below 2 % of a standard deviation
        assert abs(entry["value"] - found["parameters"][name]["value"]) < 0.05 * entry["std"]


@pytest.mark.slow  # three reports
def test_the_report_of_all_leads_to_that_of_each(together):
    run, _ = together
    page = write_report(run).read_text(encoding="utf-8")
    for name in ("first", "second"):
        assert f"experiments/{name}/report.html" in page
        assert "BODY.E" in (run / "experiments" / name / "report.html").read_text(encoding="utf-8")


@pytest.mark.slow  # three runs; of one experiment: faults/test_resume.py
def test_an_interrupted_run_of_several_goes_on_to_the_same_bits(pair, together, tmp_path):
    class Stop(Exception):
        pass


    lines = []

    def say(text):
        lines.append(text)
        if text.startswith("evaluation   2"):
            raise Stop

    with pytest.raises(Stop):
        idic.identify(pair, tmp_path / "run", say=say)
    with pytest.raises(InputError, match="exists already"):
        idic.identify(pair, tmp_path / "run")
    resumed = idic.identify(pair, tmp_path / "run", resume=True)
    assert resumed["parameters"] == together[1]["parameters"]
    assert idic.identify(pair, tmp_path / "run", resume=True)["parameters"] == resumed["parameters"]


def test_a_kill_between_the_states_of_a_run_leaves_no_part_behind(pair, tmp_path, monkeypatch):
    """A part that stays "running" is diagnosed at an older point than its result, and never counts as finished."""
    class Kill(Exception):
        pass

    def killed(run, state):
        if Path(run).parent.name == "experiments" and not state.running:
            raise Kill
        save_state(run, state)

    monkeypatch.setattr(points, "save_state", killed)
    short = {"options.max_iterations": 1}
    with pytest.raises(Kill):
        idic.identify(pair, tmp_path / "run", overrides=short)
    monkeypatch.undo()
    result = idic.identify(pair, tmp_path / "run", overrides=short, resume=True)
    parts = [load_state(folder) for folder in folders_of(tmp_path / "run").values()]
    assert {(part.status, part.evaluations) for part in parts} == {(result["status"], result["evaluations"])}


@pytest.mark.slow  # three runs of six to eighteen evaluations, 16 s of CPU time
def test_two_speeds_tell_viscosity_from_strength_which_one_speed_cannot(tmp_path):
    law = """
[material.BODY]
law = "viscoplastic"
E = 2000.0
nu = 0.35
yield_stress = { value = 18, unit = "MPa", identify = true }
hardening_modulus = 50.0
eta = { value = 60, unit = "MPa*s", identify = true }
m = { value = 3.0, identify = true }
"""
    truth = {"E": 2000.0, "nu": 0.35, "yield_stress": 20.0, "hardening_modulus": 50.0, "eta": 40.0, "m": 4.0}
    grip = (0.0, 0.05, 0.1, 0.15, 0.2, 0.25)
    slow = Twin(law="viscoplastic", truth=truth, grip=grip, seed=3, times=tuple(1000.0 * k for k in range(6)))
    fast = replace(slow, seed=4, times=tuple(1.0 * k for k in range(6)))
    paths = [write_folder(tmp_path / name, twin, law + GRIPS + FORCE)
             for name, twin in (("slow", slow), ("fast", fast))]
    alone = [idic.identify(path) for path in paths]
    assert {entry["name"] for entry in alone[0]["not_identifiable"]} == {"BODY.eta", "BODY.m"}
    both = idic.identify(paths, tmp_path / "run-both")
    assert both["status"] == "converged" and not both["not_identifiable"]
    for name in ("yield_stress", "eta", "m"):
        entry = both["parameters"][f"BODY.{name}"]
        assert entry["value"] == pytest.approx(truth[name], abs=4 * entry["std"] + 0.03 * truth[name])  # coarse mesh
        of_one = alone[1]["parameters"][f"BODY.{name}"]["std"]
        assert of_one is None or of_one > 5 * entry["std"]  # None: left open; 7, 38 and 52 measured


def test_a_shared_parameter_that_is_stated_in_two_ways_is_refused(pair, tmp_path):
    other = ELASTIC.replace("nu = { value = 0.25, identify = true }", "nu = 0.3")
    odd = write_folder(tmp_path / "odd", Twin(seed=5), other + GRIPS + FORCE)
    with pytest.raises(InputError, match="stated in two ways"):
        idic.identify([pair[0], odd], tmp_path / "run")
    rubber = '\n[material.BODY]\nlaw = "neo_hookean"\nC10 = { value = 500, identify = true }\nkappa = 3000.0\n'
    odd = write_folder(tmp_path / "rubber", Twin(seed=5), rubber + GRIPS + FORCE)
    with pytest.raises(InputError, match="another law"):
        idic.identify([pair[0], odd], tmp_path / "run")
    assert not (tmp_path / "run").exists()


def test_a_schedule_joins_the_stages_of_all_experiments(pair):
    first, second = (load_experiment(path) for path in pair)
    from idic.model import Stage

    staged = replace(first, stages=(Stage(("BODY.E",)), Stage("all")))
    stages = Joint.of({"first": staged, "second": second}).whole.stages
    assert stages[0].free == ("BODY.E", "second.camera.rotation_deg")
    assert set(stages[1].free) == {"BODY.E", "BODY.nu", "second.camera.rotation_deg"}


# idic compare -----------------------------------------------------------------------------------------------------
def test_a_comparison_lists_the_differences_of_two_runs(gallery, together, tmp_path):
    run, both = together
    single = gallery("plate").shown  # the first recording by itself
    content = compare_runs([single, run])
    alone, all_ = content["runs"]
    assert [alone["name"], all_["name"]] == [single.name, "both"]
    assert alone["models"] == all_["models"] == {"BODY": "elastic"}
    assert not all_["same_data"]
    row = next(entry for entry in content["parameters"] if entry["name"] == "BODY.E")
    first, second = row["values"]
    assert second["value"] == both["parameters"]["BODY.E"]["value"]
    expected = (second["value"] - first["value"]) / np.hypot(first["std"], second["std"])
    assert row["differences"] == [pytest.approx(0.0), pytest.approx(expected)]
    turn = next(entry for entry in content["parameters"] if entry["name"] == "second.camera.rotation_deg")
    assert turn["values"][0] is None and turn["differences"][1] is None
    page = write_comparison(content, tmp_path / "out").read_text(encoding="utf-8")
    assert "BODY.E" in page and "Model and fit" in page and "data:image/webp" in page
    assert (tmp_path / "out" / "compare.csv").read_text().count("\n") == 1 + len(content["parameters"])


def test_a_folder_without_a_result_is_not_compared(together, tmp_path):
    with pytest.raises(InputError, match="there is no result"):
        compare_runs([together[0], tmp_path])
    with pytest.raises(InputError, match="two RUN folders or more"):
        compare_runs([together[0]])
