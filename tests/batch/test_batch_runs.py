"""Batches that are really run: a failing one beside others, the numbers of single runs, kills, workers that die."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from typer.testing import CliRunner
from one_thread import ONE_THREAD

from idic.cli.app import app
from idic.errors import InputError
from idic.run import run_lock
from idic.run.batch.runs import BatchJob, BatchOutcome, identify_whole
from idic.run.workers.runner import JobKillsWorkers

pytestmark = pytest.mark.usefixtures("shared_server")
SECONDS = 600.0


def idic(*arguments) -> subprocess.Popen:
    return subprocess.Popen([sys.executable, "-m", "idic", *map(str, arguments)], stdout=subprocess.PIPE,
                            stderr=subprocess.STDOUT, text=True, env=dict(os.environ) | ONE_THREAD,
                            start_new_session=True)


def finish(process: subprocess.Popen) -> tuple[int, str]:
    said, _ = process.communicate(timeout=SECONDS)
    return process.returncode, said


def test_one_that_fails_does_not_stop_the_rest_and_the_command_says_3(strips, tmp_path):
    words = ["batch", strips / "broken", strips / "strip", "--out", tmp_path / "out", "--workers", 0,
             "--set", "options.max_iterations=1"]
    answer = CliRunner(env={"COLUMNS": "140"}).invoke(app, [str(word) for word in words])
    code, said = answer.exit_code, answer.output
    assert code == 3, said
    assert "0 of 2 runs converged; 1 bad input, 1 max iterations." in said and "Traceback" not in said
    broken, strip = json.loads((tmp_path / "out" / "batch.json").read_text())["runs"]
    assert "did you mean j2_linear" in broken["reason"] and not (tmp_path / "out" / "broken").exists()
    assert strip["iterations"] is not None and (tmp_path / "out" / "strip" / "report.html").is_file()
    assert "objective" in (tmp_path / "out" / "strip" / "log.txt").read_text(), "its own log"
    assert (tmp_path / "out" / "batch.html").is_file() and (tmp_path / "out" / "batch.csv").is_file()


def test_nothing_is_written_for_a_list_that_is_not_usable(strips, tmp_path):
    answer = CliRunner().invoke(app, ["batch", str(strips / "nowhere"), "--out", str(tmp_path / "out")])
    assert answer.exit_code == 2 and "no such experiment" in answer.stderr, answer.stderr
    assert not (tmp_path / "out").exists()


def test_a_run_that_another_process_works_on_is_said_after_some_patience(strips, tmp_path, monkeypatch):
    monkeypatch.setattr("idic.run.batch.runs.BUSY_SECONDS", 0.1)
    monkeypatch.setattr("idic.run.batch.runs.POLL_SECONDS", 0.05)
    with run_lock(tmp_path / "run"):
        outcome = identify_whole(BatchJob("a", str(strips / "strip"), str(tmp_path / "run"), {}))
    assert outcome.status == "busy" and "another idic process" in outcome.reason


class Murderous:
    """A runner on which one job kills its workers; it says so when that result is asked for, as Dask does."""

    workers, dashboard = 1, None

    def __init__(self, victim):
        self.victim, self.done = victim, []

    def stream(self, function, jobs, names, retries=0, progress=None, ahead=None, copies=False):
        for job in jobs:
            if job.name == self.victim:
                raise JobKillsWorkers(f"the worker processes keep dying on {job.name}")
            self.done.append(job.name)
            yield BatchOutcome(job.name, "converged", result={"parameters": {}})


@pytest.mark.parametrize("victim", ["a", "b", "c"])
def test_a_run_that_kills_its_workers_is_given_up_and_the_others_are_done(tmp_path, victim):
    from idic.run import Console, Hooks
    from idic.run.batch.store import Batch
    from idic.run.batch.entries import BatchRun
    from idic.run.batch.identify import _Work

    batch = Batch(tmp_path / "out", [BatchRun(name, "x") for name in "abc"])
    runner = Murderous(victim)
    with batch.claim(resume=False):
        _Work(batch, Hooks(runner), Console()).side_by_side([batch.job(run) for run in batch.runs])
        rows = {row["name"]: row for row in batch.write("finished")["runs"]}
    assert sorted(runner.done) == sorted(set("abc") - {victim})
    assert rows[victim]["status"] == "error" and "keep dying" in rows[victim]["reason"]
    assert all(rows[name]["status"] == "converged" for name in set("abc") - {victim})


def test_the_run_that_kills_its_workers_is_given_up_also_where_earlier_ones_are_still_at_work(tmp_path):
    from idic.run import Console, Hooks
    from idic.run.batch.store import Batch
    from idic.run.batch.entries import BatchRun
    from idic.run.batch.identify import _Work

    class Numbered(Murderous):
        def stream(self, function, jobs, names, retries=0, progress=None, ahead=None, copies=False):
            killer = JobKillsWorkers("the worker processes keep dying")
            killer.job = next((k for k, job in enumerate(jobs) if job.name == self.victim), None)
            if killer.job is not None:
                raise killer
            yield from super().stream(function, jobs, names)

    batch = Batch(tmp_path / "out", [BatchRun(name, "x") for name in "abc"])
    with batch.claim(resume=False):
        _Work(batch, Hooks(Numbered("b")), Console()).side_by_side([batch.job(run) for run in batch.runs])
        rows = {row["name"]: row["status"] for row in batch.write("finished")["runs"]}
    assert rows == {"a": "converged", "b": "error", "c": "converged"}


def test_a_deployment_takes_absolute_paths_below_its_root_only(tmp_path, monkeypatch):
    from idic_flows.deployed import data_path

    root = tmp_path / "data"
    root.mkdir()
    (root / "link").symlink_to("/etc")
    assert data_path(str(tmp_path / "anywhere"), "out") == tmp_path / "anywhere"
    monkeypatch.setenv("IDIC_DATA_ROOT", str(root))
    assert data_path(str(root / "run"), "out") == root / "run"
    for outside in (tmp_path / "anywhere", root / ".." / "x", root / "link" / "passwd", Path("/")):
        with pytest.raises(InputError, match="outside"):
            data_path(str(outside), "out")
    with pytest.raises(InputError, match="relative"):
        data_path("run", "out")


def test_a_deployed_batch_refuses_a_list_that_leads_out_of_its_root(tmp_path, monkeypatch):
    from idic_flows.deployed import batch

    root, secret = tmp_path / "data", tmp_path / "secret"
    for folder in (root, secret):
        folder.mkdir()
    (secret / "experiment.toml").touch()
    (root / "list.csv").write_text("experiment\n../secret\n")
    monkeypatch.setenv("IDIC_DATA_ROOT", str(root))
    with pytest.raises(InputError, match="outside of the data"):
        batch.fn([str(root / "list.csv")], str(root / "out"))
    assert not (root / "out").exists()


# slow -----------------------------------------------------------------------------------------------
@pytest.mark.slow
def test_a_batch_killed_in_the_middle_keeps_what_is_finished_and_ends_with_the_numbers_of_single_runs(strips, tmp_path):
    out = tmp_path / "out"
    arguments = ("batch", strips / "strip", "--starts", 3, "--seed", 4, "--out", out, "--workers", 2)
    process = idic(*arguments)
    wait_for(lambda: len(list(out.glob("*/result.json"))) >= 1, process)
    time.sleep(1.0)  # s: into the third run, or the reports of the first two
    os.kill(process.pid, signal.SIGKILL)
    process.communicate()
    first = {file: file.stat().st_mtime_ns for file in out.glob("*/result.json")}
    code, said = finish(idic(*arguments, "--resume"))
    assert code == 0 and "3 of 3 runs converged" in said, said
    assert {file: file.stat().st_mtime_ns for file in first} == first, "a finished run is not computed again"
    row = json.loads((out / "batch.json").read_text())["runs"][2]
    settings = [word for key, value in row["set"].items() for word in ("--set", f"{key}={value!r}")]
    code, said = finish(idic("identify", strips / "strip", "--out", tmp_path / "single", "--workers", 0, *settings))
    assert code == 0, said
    single = json.loads((tmp_path / "single" / "result.json").read_text())
    assert {name: entry["value"] for name, entry in row["parameters"].items()} == {
        name: entry["value"] for name, entry in single["parameters"].items() if entry["free"]}


@pytest.mark.slow
def test_fewer_runs_than_workers_spread_their_simulations_and_ctrl_c_ends_with_4(strips, tmp_path):
    out = tmp_path / "out"
    arguments = ("batch", strips / "strip", "--out", out, "--workers", 2)
    process = idic(*arguments)
    wait_for((out / "strip" / "state.json").is_file, process)
    os.killpg(process.pid, signal.SIGINT)
    code, said = finish(process)
    assert code == 4 and "--resume" in said and "Traceback" not in said, said
    assert json.loads((out / "batch.json").read_text())["status"] == "interrupted"
    code, said = finish(idic(*arguments, "--resume"))
    assert code == 0 and "identification 1 of" in said and "strip" in said, said


def wait_for(condition, process):
    end = time.monotonic() + SECONDS
    while not condition():
        assert process.poll() is None, finish(process)
        assert time.monotonic() < end, "the batch did not get so far"
        time.sleep(0.05)
