"""`idic clean`: a RUN becomes smaller, and what is needed to go on stays."""

import json
import shutil
from dataclasses import replace

import pytest
from typer.testing import CliRunner

from idic.cli.app import app
from idic.errors import InputError
from idic.run import clean_run, identify_run, open_run, run_lock, write_report
from idic.run.store.run_lock import RunBusy
from idic.run.store.state_file import load_state, save_state


@pytest.fixture(scope="module")
def run(gallery, tmp_path_factory):
    """Its report is a page and a table of one line: a whole one takes 5 s and comes with the slow test."""
    folder = tmp_path_factory.mktemp("clean")
    step = gallery("step").copied(folder)
    identify_run(step.experiment, step.run, resume=True, overrides={"options.max_iterations": 1})  # moved
    for name in ("report.html", "tables/frames.csv", "figures/where.png"):
        file = folder / "run" / name
        file.parent.mkdir(exist_ok=True)
        file.write_bytes(b"of a diagnosis")
    (folder / "run" / "diagnosis.json").write_text(json.dumps({"mismatch": {"figure": "figures/where.png"}}))
    return folder / "run"


def contents(run):
    return {file.relative_to(run).as_posix(): file.read_bytes() for file in run.rglob("*") if file.is_file()}


def test_a_run_at_work_is_left_alone(run):
    before = contents(run)
    with run_lock(run), pytest.raises(RunBusy):
        clean_run(run)
    assert contents(run).keys() == before.keys()


def test_a_part_of_a_joint_run_at_work_is_left_alone_with_the_others(run, tmp_path):
    whole = shutil.copytree(run, tmp_path / "whole")
    part = shutil.copytree(run, whole / "experiments" / "part")
    with run_lock(part), pytest.raises(RunBusy):  # it is being diagnosed
        clean_run(whole, results_only=True)
    assert (part / "run.zarr").exists() and (whole / "run.zarr").exists()


@pytest.mark.parametrize("command", ["diagnose --no-prefect", "diagnose", "systematic"])
def test_no_two_commands_write_into_a_run_at_a_time(run, command, monkeypatch):
    """A second diagnosis would delete the refits of the first, a second assessment write its result over the other."""
    refit = run / "diagnosis" / "null-0123456789abcdef.npz"
    refit.parent.mkdir(exist_ok=True)
    refit.write_bytes(b"of the diagnosis that is at work")
    before = (run / "result.json").read_bytes()
    monkeypatch.setenv("PREFECT_API_URL", "http://127.0.0.1:9/api")  # no server is asked
    with run_lock(run):
        answer = CliRunner().invoke(app, [*command.split(), str(run), "--workers", "0"])
    assert answer.exit_code == 2 and "another idic process works on this RUN" in answer.output, answer.output
    assert refit.exists() and (run / "result.json").read_bytes() == before


def test_a_run_whose_experiment_was_moved_says_how_to_tell_it_the_new_place(run, tmp_path):
    own, folder = shutil.copytree(run, tmp_path / "run"), run.parent / "test"
    moved = folder.rename(tmp_path / "moved")
    try:
        with pytest.raises(InputError, match="no longer where it was") as told:
            open_run(str(own))
        assert str(folder) in str(told.value) and "--resume" in told.value.remedy
        identify_run(moved, own, resume=True, overrides={"options.max_iterations": 1})
        assert open_run(str(own)).settings["experiment"] == str(moved)
    finally:
        moved.rename(folder)


def test_an_interrupted_run_keeps_what_resume_needs(run, tmp_path):
    own = shutil.copytree(run, tmp_path / "run")
    save_state(own, replace(load_state(own), status="running"))  # Ctrl-C: a result with the status "interrupted"
    with pytest.raises(InputError, match=": .*interrupted") as told:
        clean_run(own, results_only=True)
    assert "--resume" in told.value.remedy and (own / "run.zarr").exists()
    clean_run(own)  # pictures may go


@pytest.mark.slow  # a report
def test_pictures_go_and_come_back_with_the_report_and_results_stay(run):
    write_report(run)
    before = contents(run)
    size = sum(len(data) for data in before.values())
    answer = CliRunner().invoke(app, ["clean", str(run)])
    assert answer.exit_code == 0 and "MB freed" in answer.stdout
    after = contents(run)
    gone = before.keys() - after.keys()
    assert gone and all(name.startswith(("figures/", "paraview/")) for name in gone)
    assert after["figures/where.png"] == b"of a diagnosis"  # nothing else makes it again
    assert all(before[name] == after[name] for name in after if name != "run.lock")
    assert clean_run(run) == 0
    write_report(run)
    assert contents(run).keys() == before.keys()
    assert size - sum(len(data) for data in after.values()) > 0


def test_results_only_leaves_pages_tables_and_results(run):
    clean_run(run, results_only=True)
    left = contents(run)
    assert {"result.json", "report.html", "tables/frames.csv"} <= left.keys()
    assert not any(name.startswith("run.zarr") for name in left)
    for command in (["report"], ["diagnose", "--no-prefect"]):
        said = CliRunner().invoke(app, [*command, str(run)])
        assert said.exit_code == 2 and "--results-only removes" in said.output, said.output


def test_what_a_link_leads_to_stays(tmp_path):
    (tmp_path / "outside").mkdir()
    (tmp_path / "outside" / "holiday.png").write_bytes(b"mine")
    run = tmp_path / "run"
    run.mkdir()
    (run / "result.json").write_text("{}")
    (run / "figures").symlink_to(tmp_path / "outside", target_is_directory=True)
    (run / "run.zarr").symlink_to(tmp_path / "outside", target_is_directory=True)
    clean_run(run, results_only=True)
    assert (tmp_path / "outside" / "holiday.png").read_bytes() == b"mine"
    assert not (run / "run.zarr").is_symlink()


def test_a_folder_that_is_no_run_is_refused_and_nothing_is_removed(tmp_path):
    (tmp_path / "figures").mkdir()
    (tmp_path / "figures" / "holiday.png").write_bytes(b"mine")
    with pytest.raises(InputError, match="no finished identification"):
        clean_run(tmp_path)
    assert (tmp_path / "figures" / "holiday.png").exists()
