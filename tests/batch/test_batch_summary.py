"""The summary of a batch: every run in it, statuses and reasons, scatter between runs; the folder is guarded."""

from __future__ import annotations

import csv
import io
import json
from dataclasses import replace

import numpy as np
import pytest

from idic.errors import InputError
from idic.report import batch_table, scatter
from idic.report.several_runs.batch_page import _points
from idic.run.batch.store import Batch
from idic.run.batch.runs import BatchOutcome
from idic.run.batch.entries import BatchRun

VALUES = (69.0, 70.0, 72.0)


def result(value, status="converged", std=1.5):
    entry = {"value": value, "std": std, "unit": "GPa", "start": 60.0, "free": True}
    locked = {"value": 0.3, "std": None, "unit": "", "start": 0.3, "free": False}
    return {"status": status, "iterations": 4, "parameters": {"A.E": entry, "A.nu": locked}, "cost": {"wall_s": 3.0},
            "residual": {"image_chi2_dof": 1.01}}


@pytest.fixture
def batch(tmp_path):
    """Three converged runs of two experiments, a refused one, one at its limit, one that is not done."""
    names = ["a0", "a1", "b0", "refused", "limit", "waiting"]
    runs = [BatchRun(name, "/data/b" if name == "b0" else "/data/a", {"A.E": 60.0}) for name in names]
    batch = Batch(tmp_path / "out", runs)
    for name, value in zip(names, VALUES, strict=False):
        batch.record(BatchOutcome(name, "converged", result=result(value)))
    batch.record(BatchOutcome("refused", "bad_input", "<b>mesh.inp</b>: no mesh\n  what to do: draw one"))
    batch.record(BatchOutcome("limit", "max_iterations", result=result(50.0, "max_iterations")))
    return batch


def test_the_summary_has_every_run_with_status_and_reason(batch):
    with batch.claim(resume=False):
        content = batch.write("running", page=True)
    assert json.loads((batch.folder / "batch.json").read_text()) == content
    assert [row["status"] for row in content["runs"]] == [*["converged"] * 3, "bad_input", "max_iterations", "waiting"]
    assert content["converged"] == 3
    rows = list(csv.DictReader(io.StringIO(batch_table(content))))
    assert [row["A.E"] for row in rows] == ["69", "70", "72", "", "50", ""]
    assert rows[3]["reason"].endswith("what to do: draw one") and "A.nu" not in rows[0]
    page = (batch.folder / "batch.html").read_text()
    assert "3 of 6 runs converged; 1 bad input, 1 max iterations, 1 waiting." in page
    assert "&lt;b&gt;mesh.inp" in page and "<b>mesh" not in page, "what a file says is text, not markup"
    assert 'href="a0/report.html"' in page and "refused/report.html" not in page
    assert "src=\"http" not in page and "data:image/webp" in page


def test_an_interrupted_batch_says_how_to_go_on(batch):
    with batch.claim(resume=False):
        row = batch.write("interrupted")["runs"][-1]
    assert row["status"] == "interrupted" and "--resume" in row["reason"]


def test_a_batch_interrupted_while_it_is_resumed_keeps_the_rows_of_finished_runs(batch):
    with batch.claim(resume=False):
        before = {row["name"]: row for row in batch.write("finished")["runs"]}
    for name in ("a0", "a1", "limit", "refused"):
        (batch.folder / name).mkdir()
        (batch.folder / name / "result.json").touch()
    changed = [replace(run, overrides={"A.E": 50.0}) if run.name == "a1" else run for run in batch.runs]
    again = Batch(batch.folder, changed)
    with again.claim(resume=True):
        rows = {row["name"]: row for row in again.write("interrupted")["runs"]}
    assert rows["a0"] == before["a0"] and rows["limit"] == before["limit"]
    assert rows["a1"]["status"] == "interrupted", "another start than the one of the earlier row"
    assert rows["b0"]["status"] == "interrupted", "its RUN is gone"


@pytest.mark.parametrize("change", [
    {"parameters": 3}, {"parameters": {"A.E": 1.0}}, {"wall_s": float("inf")}, {"status": ["converged"]}, {"more": 1},
    {"iterations": "4"}, {"reason": "\ud800"},
    {"parameters": {"A.E": {"value": None, "std": 1.0, "unit": "", "start": None}}},
    {"parameters": {"A.E": {"value": "69", "std": None, "unit": "", "start": None}}}])
def test_rows_of_other_types_are_not_taken_over(batch, change):
    with batch.claim(resume=False):
        content = batch.write("finished")
    (batch.folder / "a0").mkdir()
    (batch.folder / "a0" / "result.json").touch()
    file = batch.folder / "batch.json"
    for text in (json.dumps({"runs": [content["runs"][0] | change]}), "[" * 200_000):
        file.write_text(text)
        again = Batch(batch.folder, batch.runs)
        with again.claim(resume=True):
            assert again.write("interrupted", page=True)["runs"][0]["status"] == "interrupted"


def test_scatter_is_of_converged_runs_over_all_and_per_experiment(batch):
    with batch.claim(resume=False):
        rows = batch.write("finished")["runs"]
    together, of_a = scatter(rows)
    assert (together["experiment"], together["runs"], of_a["runs"]) == (None, 3, 2)
    found = together["parameters"]["A.E"]
    assert found["mean"] == pytest.approx(np.mean(VALUES)) and found["std"] == pytest.approx(np.std(VALUES, ddof=1))
    assert (found["min"], found["max"], found["formal_std"], found["n"]) == (69.0, 72.0, 1.5, 3)
    assert of_a["parameters"]["A.E"]["std"] == pytest.approx(1.0 / np.sqrt(2.0))


def row(value, std, unit, **more):
    entry = {"value": value, "std": std, "unit": unit, "start": 2.0 * value}
    return {"status": "converged", "experiment": "x", "parameters": {"A.E": entry}} | more


def test_parameters_without_a_value_or_of_another_dimension_have_no_scatter():
    assert scatter([row(1.0, None, "GPa"), row(1.0, 1.0, "GPa")])[0]["parameters"] == {}
    assert scatter([row(1.0, 1.0, "px"), row(1.0, 1.0, "mm")])[0]["parameters"] == {}


def test_two_files_with_one_modulus_in_gpa_and_mpa_are_compared_in_one_unit():
    rows = [row(69.0, 1.0, "GPa", name="a", run="a"), row(71e3, 2e3, "MPa", name="b", run="b")]
    found = scatter(rows)[0]["parameters"]["A.E"]
    assert found["unit"] == "GPa"
    assert [found[key] for key in ("mean", "min", "max", "formal_std")] == \
        pytest.approx([70.0, 69.0, 71.0, 1.5], rel=1e-12)
    drawn = [(entry["value"], entry["std"], entry["start"]) for _, _, entry in _points(rows, "A.E")]
    np.testing.assert_allclose(drawn, [(69.0, 1.0, 138.0), (71.0, 2.0, 142.0)], rtol=1e-12)
    plain = dict(reason="", iterations=1, image_chi2_dof=1.0, wall_s=1.0)
    table = list(csv.DictReader(io.StringIO(batch_table({"runs": [one | plain for one in rows]}))))
    assert [(one["A.E"], one["A.E.unit"]) for one in table] == [("69", "GPa"), ("71000", "MPa")]  # as in its result


def test_the_folder_of_an_earlier_batch_asks_for_resume(batch):
    with batch.claim(resume=False):
        batch.write("finished")
    with pytest.raises(InputError, match="exists already"), Batch(batch.folder, batch.runs).claim(resume=False):
        pass
    with Batch(batch.folder, batch.runs).claim(resume=True):
        pass


def test_a_folder_in_use_for_something_else_is_left_alone(tmp_path):
    (tmp_path / "thesis.tex").write_text("x")
    with pytest.raises(InputError, match="something else"), Batch(tmp_path, []).claim(resume=True):
        pass
    assert [p.name for p in tmp_path.iterdir()] == ["thesis.tex"]


def test_two_batches_do_not_work_in_one_folder(batch):
    with batch.claim(resume=False):
        batch.write("running")
        with pytest.raises(InputError, match="another idic process"), Batch(batch.folder, []).claim(resume=True):
            pass
