"""A user's day: every command, one after the other, on the folders that the one before has left."""

import csv
import json
import os
import subprocess
import sys
from types import SimpleNamespace

import pytest
from typer.testing import CliRunner
from virtual_tests.small_strip import write_small_strip

from idic.cli.app import app

pytestmark = pytest.mark.usefixtures("shared_server")
TRUTH = {"sheet.E", "sheet.nu", "sheet.yield_stress", "sheet.hardening_modulus"}


def idic(*arguments, cwd=None):
    """A command as a user starts it, its output taken by a file."""
    command = [sys.executable, "-m", "idic", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=900, env={**os.environ, "COLUMNS": "140"},
                          cwd=cwd)


def here(*arguments):
    """A command in this process: those that start no others need no imports of their own."""
    answer = CliRunner(env={"COLUMNS": "140"}).invoke(app, [str(word) for word in arguments])
    return SimpleNamespace(returncode=answer.exit_code, stdout=answer.stdout, stderr=answer.stderr)


@pytest.fixture(scope="module")
def day(tmp_path_factory):
    return tmp_path_factory.mktemp("day")


@pytest.fixture(scope="module")
def experiment(day):
    answer = here("example", "demo", "--out", day / "test", "--reduced", "--seed", "3")
    assert answer.returncode == 0, answer.stderr
    assert f"idic identify {day / 'test'} --out RUN" in answer.stdout  # what to do next
    return day / "test"


@pytest.fixture(scope="module")
def strip(day):
    """The demonstration in small frames that start nearer to the truth: an identification takes a third of the time."""
    return write_small_strip(day / "strip")


@pytest.fixture(scope="module")
def identified(day, strip, hostile_folder):
    folder, marks = hostile_folder
    answer = idic("identify", strip, "--out", day / "run", "--workers", "1", cwd=folder)
    assert answer.returncode == 0, answer.stderr
    assert not list(marks.iterdir())  # no file of the working folder was obeyed
    return day / "run", answer


@pytest.fixture(scope="module")
def stopped(day, strip):
    """The same from another start and without the time to get anywhere."""
    answer = here("identify", strip, "--out", day / "stopped", "--no-prefect", "--no-report",
                  "--set", "options.max_iterations=1", "--set", "material.sheet.E.value=50e3")
    return day / "stopped", answer


def test_a_check_reports_the_correlated_region_and_writes_a_picture_only(experiment):
    before = {path.name for path in experiment.iterdir()}
    answer = here("check", experiment)
    assert answer.returncode == 0, answer.stderr
    assert "noise" in answer.stdout and "mesh.png" in answer.stdout
    assert {path.name for path in experiment.iterdir()} == before | {"check"}


def test_init_writes_a_file_that_waits_for_the_scale_and_goes_no_further(experiment, day):
    folder = day / "mine"
    folder.mkdir()
    for name in ("images", "loads.csv", "mesh.inp"):
        (folder / name).symlink_to(experiment / name)
    answer = here("init", folder)
    assert answer.returncode == 0 and (folder / "experiment.toml").is_file()
    again = here("init", folder)  # what the user has written since would be lost
    assert again.returncode == 2 and "experiment.toml" in again.stderr


def test_an_identification_shows_its_table_and_where_everything_lies(identified, strip):
    run, answer = identified
    assert all(name in answer.stdout for name in TRUTH)
    assert f"results  {run / 'result.json'}" in answer.stdout and f"report   {run / 'report.html'}" in answer.stdout
    result, truth = (json.loads((folder / name).read_text())
                     for folder, name in ((run, "result.json"), (strip, "truth.json")))
    assert result["schema"] == "idic.result/1" and result["status"] == "converged"
    for name in TRUTH:
        entry = result["parameters"][name]
        assert abs(entry["value"] - truth["parameters"][name]) < 4.0 * entry["std"]
        assert set(entry) >= {"value", "std", "unit", "start", "free", "ci95"}


def test_the_log_lists_events_with_their_times(identified):
    log = (identified[0] / "log.txt").read_text()
    assert "evaluation   0" in log and "Traceback" not in log
    assert [float(line.split("objective")[1].split()[0]) for line in log.splitlines() if "objective" in line]


def test_a_search_that_did_not_converge_ends_with_code_3_and_results_that_say_so(stopped):
    run, answer = stopped
    assert answer.returncode == 3, answer.stderr
    assert json.loads((run / "result.json").read_text())["status"] == "max_iterations"
    assert "max" in answer.stdout


def test_a_finished_run_is_not_overwritten(identified, strip):
    run, _ = identified
    before = (run / "result.json").read_bytes()
    answer = here("identify", strip, "--out", run, "--no-prefect")
    assert answer.returncode == 2 and (run / "result.json").read_bytes() == before


def test_a_report_is_made_again_with_its_tables(identified):
    run, _ = identified
    (run / "report.html").unlink()
    answer = here("report", run)
    assert answer.returncode == 0, answer.stderr
    assert (run / "report.html").stat().st_size > 100_000
    tables = sorted(run.rglob("*.csv"))
    assert tables
    for table in tables:
        with open(table, newline="", encoding="utf-8") as file:
            rows = list(csv.reader(line for line in file if not line.startswith("#")))
        assert len(rows) > 1 and len({len(row) for row in rows}) == 1, table
    assert list(run.rglob("*.pvd")) and list(run.rglob("*.vtu"))


def test_runs_are_compared_side_by_side(identified, stopped):
    answer = here("compare", identified[0], stopped[0])
    assert answer.returncode == 0, answer.stderr
    assert all(name in answer.stdout for name in TRUTH) and "max iterations" in answer.stdout


def test_a_simulation_writes_an_experiment_that_can_be_checked(experiment, day):
    answer = here("simulate", experiment, "--out", day / "virtual", "--seed", "5", "--noise-gv", "1.5")
    assert answer.returncode == 0, answer.stderr
    answer = here("check", day / "virtual", "--no-picture")
    assert answer.returncode == 0, answer.stderr
    assert not (day / "virtual" / "check").exists()


def test_a_design_promises_standard_deviations_before_the_test(strip, identified, day):
    answer = here("design", strip, "--out", day / "design", "--workers", "0")
    assert answer.returncode == 0, answer.stderr
    assert all(name in answer.stdout for name in TRUTH)
    assert json.loads((day / "design" / "design.json").read_text()) and (day / "design" / "design.html").is_file()


def test_the_candidate_physics_are_listed_and_an_unknown_one_is_refused():
    answer = here("physics")
    assert answer.returncode == 0 and "plasticity" in answer.stdout and "illumination" in answer.stdout
    assert "…" not in answer.stdout and "geometric_nonlinearity: " in answer.stdout
    answer = here("physics", "no_such_thing")
    assert answer.returncode == 2 and "plasticity" in answer.stderr
