"""A run that is stopped, by whatever, ends with `--resume` as if it had not been; nothing lives on behind it."""

from __future__ import annotations

import json
import os
import shutil
import signal

import numpy as np
import pytest
from fault_runs import (command_line, descendants, evaluations, finish, kill, outcome, plain_run, still_alive,
                        stored_system, wait_for_evaluation)
from typer.testing import CliRunner

import idic
from idic.cli.app import app
from idic.errors import InputError
from idic.run import FrameArrays, open_run, read_array, residuals_of


def here(*arguments):
    """A command in this process that is to be refused: exit code and everything that was said."""
    answer = CliRunner().invoke(app, [str(word) for word in arguments])
    return answer.exit_code, answer.output


def assert_same_end(run, small):
    assert outcome(run) == small.result
    assert stored_system(run) == small.system


@pytest.mark.slow  # two workers: see the command below
@pytest.mark.parametrize("workers", [1, 4])
def test_any_number_of_workers_gives_the_same_bits(undisturbed, tmp_path, workers):
    code, said = finish(plain_run(undisturbed.experiment, tmp_path / "run", workers))
    assert code == 0, said
    assert_same_end(tmp_path / "run", undisturbed)


def kill_and_resume(small, run, generator, workers, n_kills):
    for _ in range(n_kills):
        process = plain_run(small.experiment, run, workers)
        try:
            process.wait(generator.uniform(1.0, 8.0))  # s: from before the first file is written to after the last
        except Exception:  # noqa: BLE001 - still running, as wanted
            family = descendants(process)
            kill(process)
            assert not still_alive(family)
    run.mkdir(exist_ok=True)
    (run / ".state.json.0123456789ab.tmp").touch()  # what a kill during the write of the state leaves
    code, said = finish(plain_run(small.experiment, run, workers))
    assert code == 0, said
    assert_same_end(run, small)
    assert not [path for path in run.rglob(".*") if path.name.endswith((".tmp", ".old"))]


@pytest.mark.slow  # test_kills.py kills two runs
def test_a_run_that_was_killed_twice_ends_with_the_same_bits(small, tmp_path):
    kill_and_resume(small, tmp_path / "run", np.random.default_rng(3), workers=0, n_kills=2)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(25))
def test_a_run_killed_twice_at_any_instant_ends_with_the_same_bits(small, tmp_path, seed):
    kill_and_resume(small, tmp_path / "run", np.random.default_rng(seed), workers=seed % 3, n_kills=2)


def test_the_command_survives_a_kill_and_leaves_no_process_behind(small, tmp_path):
    run = tmp_path / "run"
    arguments = ("identify", small.experiment, "--out", run)
    process = command_line(*arguments, "--workers", 2)
    wait_for_evaluation(run, process, 1)
    process.send_signal(signal.SIGSTOP)  # or a busy machine brings the run to its end before the second one is there
    code, said = here(*arguments, "--no-prefect", "--resume")
    assert code == 2 and "another idic process" in said, said
    family = descendants(process)
    assert len(family) >= 3, "two workers and a Prefect server"
    kill(process)
    assert not still_alive(family)

    code, said = here(*arguments, "--no-prefect")
    assert code == 2 and "--resume" in said, said
    code, said = finish(command_line(*arguments, "--no-prefect", "--resume", "--no-report"))
    assert code == 0, said
    assert_same_end(run, small)


@pytest.mark.slow  # Ctrl-C is seen below; 50 s of CPU time
def test_sigterm_ends_a_resumed_command_with_code_4_and_no_process_behind(undisturbed, tmp_path):
    run = tmp_path / "run"
    arguments = ("identify", undisturbed.experiment, "--out", run, "--workers", 2)
    process = command_line(*arguments)
    wait_for_evaluation(run, process, 1)
    kill(process)
    before = evaluations(run)
    process = command_line(*arguments, "--resume")
    wait_for_evaluation(run, process, before + 1)
    family = descendants(process)
    process.send_signal(signal.SIGTERM)
    code, said = finish(process)
    assert code == 4, said
    assert "--resume" in said and "Traceback" not in said, said
    assert not still_alive(family)
    assert outcome(run)["status"] == "interrupted"

    code, said = finish(command_line(*arguments, "--resume"))
    assert code == 0, said
    assert_same_end(run, undisturbed)


@pytest.mark.usefixtures("shared_server")
def test_ctrl_c_ends_with_code_4_and_the_way_to_go_on(small, tmp_path):
    run = tmp_path / "run"
    process = command_line("identify", small.experiment, "--out", run, "--workers", 1)
    wait_for_evaluation(run, process, 1)
    family = descendants(process)
    os.killpg(process.pid, signal.SIGINT)  # a terminal sends it to the workers, too
    code, said = finish(process)
    assert code == 4, said
    assert "--resume" in said and "Traceback" not in said, said
    assert not still_alive(family)
    assert outcome(run)["status"] == "interrupted"
    assert outcome(run)["parameters"]["sheet.E"]["std"] is not None


# damage -------------------------------------------------------------------------------------------
def open_run_copy(small, tmp_path):
    """A copy of the finished run as a kill leaves it: the last evaluation done, nothing after it."""
    run = tmp_path / "run"
    shutil.copytree(small.run, run)
    (run / "result.json").unlink()
    return run


def flip_a_bit(file):
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 4
    file.write_bytes(content)


def a_chunk(run, pattern):
    """A chunk of an array; "accepted" stands for the evaluation that was accepted last."""
    accepted = json.loads((run / "state.json").read_text())["state"]["accepted"]["number"]
    pattern = pattern.replace("accepted", f"{accepted:03d}")
    return sorted(file for file in (run / "run.zarr").glob(f"{pattern}/c/**/*") if file.is_file())[0]


@pytest.mark.parametrize("array, damage", [
    ("images/frames", "flipped"), ("evaluations/accepted/base/u", "missing"),
    *(pytest.param(*case, marks=pytest.mark.slow) for case in (
        ("evaluations/accepted/system/M", "flipped"), ("images/frames", "missing"),
        ("evaluations/accepted/base/u", "flipped"), ("prepared/local", "flipped")))])
def test_damaged_data_are_computed_anew(small, tmp_path, array, damage):
    run = open_run_copy(small, tmp_path)
    chunk = a_chunk(run, array)
    flip_a_bit(chunk) if damage == "flipped" else chunk.unlink()
    idic.identify(small.experiment, run, resume=True)
    assert_same_end(run, small)


def alter(file):
    """The last digit 1 becomes a 2."""
    text = file.read_text()
    file.write_text(text[::-1].replace("1", "2", 1)[::-1])


@pytest.mark.parametrize("name", ["state.json", "run.json"])
def test_the_copy_of_a_damaged_description_is_used(small, tmp_path, name):
    run, said = open_run_copy(small, tmp_path), []
    alter(run / name)
    idic.identify([small.experiment], run, resume=True, say=said.append)
    assert_same_end(run, small)
    assert [line for line in said if f"{name} is damaged: its copy takes its place" in line]


@pytest.mark.parametrize("name", ["state", "run"])
def test_a_description_that_is_damaged_with_its_copy_is_reported_and_not_used(small, tmp_path, name):
    run = open_run_copy(small, tmp_path)
    for file in (f"{name}.json", f"{name}.copy.json"):
        alter(run / file)
    with pytest.raises(InputError) as refused:
        idic.identify(small.experiment, run, resume=True)
    assert f"{name}.json" in str(refused.value) and refused.value.remedy
    assert not (run / "result.json").exists()


# refusals -----------------------------------------------------------------------------------------
def test_a_finished_run_that_lost_its_state_and_the_copy_starts_over(small, tmp_path):
    """Its points were thinned at the end: they are not those that a further step reads."""
    run = tmp_path / "run"
    shutil.copytree(small.run, run)
    for name in ("state.json", "state.copy.json"):
        (run / name).unlink()
    idic.identify(small.experiment, run, resume=True)
    assert_same_end(run, small)


def test_the_run_of_another_experiment_stays_as_it_is(small, tmp_path):
    other = shutil.copytree(small.experiment, tmp_path / "other")
    log = (other / "loads.csv").read_text()
    (other / "loads.csv").write_text(log[::-1].replace("1", "2", 1)[::-1])  # one digit of the last row
    before = contents(small.run)
    with pytest.raises(InputError, match="another experiment"):
        idic.identify(other, small.run, resume=True)
    assert contents(small.run) == before


def contents(run):
    return {file: file.read_bytes() for file in run.rglob("*") if file.is_file()}


def test_a_finished_run_keeps_only_what_resume_and_report_need(small):
    """Residual maps of all frames take four times the room of 8-bit images; those of the report's frames stay. The
    first point's sensitivities are of no use any more."""
    stored = small.run / "run.zarr"
    assert [path.relative_to(stored).as_posix() for path in stored.rglob("residual*")] == ["final/residual"]
    frames, maps = read_array(stored / "final", "frames"), FrameArrays.open(stored / "final", "residual")
    assert len(frames) == maps.n_frames == 4 and frames[-1] == len(small.result["frames"]) - 1
    context = open_run(str(small.run))
    entry = [entry for entry in small.result["history"] if entry["accepted"]][-1]
    half_a_step = small.result["noise"]["std_gv"] / 8.0
    np.testing.assert_allclose(maps.read(3, 4)[0], residuals_of(context, entry)(int(frames[3])), rtol=1e-3,
                               atol=half_a_step)
    accepted = [entry["evaluation"] for entry in small.result["history"] if entry["accepted"]][-1]
    assert accepted > 0
    kept = {number: {folder.name for folder in (stored / f"evaluations/{number:03d}/base").glob("*/")}
            for number in (0, accepted)}
    assert kept[0] == {"u", "channels", "steps"} and "du" in kept[accepted]


def test_a_finished_run_answers_again_without_computing(small, tmp_path):
    """The command does the same, and makes the report again: `front_door/test_no_prefect.py`."""
    run = tmp_path / "run"
    shutil.copytree(small.run, run)
    before = (run / "result.json").read_bytes()
    simulated = (run / "run.zarr" / "channels" / "zarr.json").stat().st_mtime_ns
    idic.identify(small.experiment, run, resume=True)
    assert (run / "result.json").read_bytes() == before
    assert (run / "run.zarr" / "channels" / "zarr.json").stat().st_mtime_ns == simulated
