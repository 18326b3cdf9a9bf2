"""What is started, what stops it, and what is left of it: real programs, killed for real."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest

from idic.errors import InputError
from idic.fe.external.process import run_program
from idic.fe import PERMISSION, check_environment, find_program, require_permission
from idic.fe.external import process as external_process

PYTHON = (sys.executable, "-S", "-c")


def marked(mark):
    """Living processes that carry a mark on their command line."""
    found = []
    for process in psutil.process_iter():
        try:
            if mark in process.cmdline()[-1:] and process.status() != psutil.STATUS_ZOMBIE:
                found.append(process)
        except psutil.Error:
            continue
    return found


def gone(mark, seconds=10.0):
    """Whether nothing with the mark lives any more; a killed process needs a moment."""
    end = time.monotonic() + seconds
    while marked(mark) and time.monotonic() < end:
        time.sleep(0.05)
    return not marked(mark)


def family(mark, own_end="time.sleep(600)"):
    """A program with a child, both ignoring SIGTERM; both carry the mark."""
    child = "import signal, time; signal.signal(15, signal.SIG_IGN); time.sleep(600)"
    code = ("import signal, subprocess, sys, time; signal.signal(15, signal.SIG_IGN); "
            f"subprocess.Popen([sys.executable, '-S', '-c', {child!r}, {mark!r}]); "
            f"print('born', flush=True); {own_end}")
    return (*PYTHON, code, mark)


def test_a_program_runs_in_its_folder_without_input_and_its_output_is_kept(tmp_path):
    code = ("import os, sys; print(os.getcwd(), os.environ['OWN'], repr(sys.stdin.read()), flush=True); "
            "print('err', file=sys.stderr)")
    ending = run_program((*PYTHON, code), tmp_path, {"OWN": "x"}, 60.0)
    assert (ending.outcome, ending.code) == ("ended", 0)
    assert (tmp_path / "log.txt").read_text() == f"{tmp_path} x ''\nerr\n"


def test_a_relative_folder_will_do(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "run").mkdir()
    run_program((*PYTHON, "print('x' * 200000)"), Path("run"), {}, 60.0)  # more than a pipe holds
    assert len((tmp_path / "run" / "log.txt").read_text()) == 200001


@pytest.mark.parametrize("code, how, number", [("raise SystemExit(7)", "ended", 7),
                                               ("import os; os.kill(os.getpid(), 9)", "ended", -9)])
def test_how_a_program_ends_is_told(tmp_path, code, how, number):
    ending = run_program((*PYTHON, code), tmp_path, {}, 60.0)
    assert (ending.outcome, ending.code) == (how, number) and ending.in_words("x", 60.0)


def test_no_shell_looks_at_the_arguments(tmp_path):
    code = "import sys; print(sys.argv[1:])"
    run_program((*PYTHON, code, "$(touch evil)", "; touch evil", "*"), tmp_path, {}, 60.0)
    assert "['$(touch evil)', '; touch evil', '*']" in (tmp_path / "log.txt").read_text()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["log.txt"]


def test_when_the_time_is_up_the_whole_group_is_killed_even_if_it_does_not_listen(tmp_path, monkeypatch):
    mark, began = f"mark-{tmp_path}", time.monotonic()
    ending = run_program(family(mark), tmp_path, {}, 10.0)
    assert ending.outcome == "timeout" and gone(mark)
    assert time.monotonic() - began < 60.0  # and not 600: loaded machines included
    assert "born" in (tmp_path / "log.txt").read_text()


def test_children_that_a_program_leaves_behind_are_ended(tmp_path):
    mark = f"mark-{tmp_path}"
    assert run_program(family(mark, "sys.exit(0)"), tmp_path, {}, 60.0).code == 0
    assert gone(mark)


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT])
def test_nothing_outlives_an_interrupted_or_killed_caller(tmp_path, number):
    mark = f"mark-{tmp_path}"
    script = tmp_path / "caller.py"
    script.write_text("import sys\nfrom pathlib import Path\nfrom idic.fe.external.process import run_program\n"
                      f"run_program({family(mark)!r}, Path({str(tmp_path)!r}), {{}}, 600.0)\n")
    caller = subprocess.Popen([sys.executable, str(script)], stderr=subprocess.DEVNULL)
    end = time.monotonic() + 60.0
    while len(marked(mark)) < 2 and time.monotonic() < end:
        time.sleep(0.05)
    assert len(marked(mark)) == 2
    os.kill(caller.pid, number)
    caller.wait()
    assert gone(mark, 20.0)


def test_of_endless_output_beginning_and_end_are_kept(tmp_path, monkeypatch):
    monkeypatch.setattr(external_process, "MAX_LOG_BYTES", 200_000)
    code = "print('first'); print('x' * 99 + '\\n', end='') or [print('y' * 99) for _ in range(100000)]; print('last')"
    run_program((*PYTHON, code), tmp_path, {}, 60.0)
    text = (tmp_path / "log.txt").read_text()
    assert text.startswith("first") and text.endswith("last\n") and "left out" in text and len(text) < 300_000


# permission and place --------------------------------------------------------------------------------
def test_a_program_is_started_only_if_it_was_named(monkeypatch):
    monkeypatch.setenv(PERMISSION, os.pathsep.join(["ccx", "/opt/abaqus"]))
    require_permission(("ccx", "-i", "job"), "x.toml")
    with pytest.raises(InputError, match="not allowed") as caught:
        require_permission(("bash", "-c", "rm -rf ~"), "x.toml")
    assert "bash -c rm -rf ~" in caught.value.found and "--allow-external bash" in caught.value.remedy
    monkeypatch.delenv(PERMISSION)
    with pytest.raises(InputError):
        require_permission(("ccx",), "x.toml")


def test_a_program_is_found_on_the_path_or_named_absolutely(tmp_path, monkeypatch):
    program = tmp_path / "solver"
    program.write_text("#!/bin/sh\n")
    program.chmod(0o755)
    assert find_program(str(program), "x.toml") == str(program)
    monkeypatch.setenv("PATH", str(tmp_path))
    assert find_program("solver", "x.toml") == str(program)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PATH", ".")
    for name in ("./solver", "solver", "no-such-program", str(tmp_path / "missing")):
        with pytest.raises(InputError):
            find_program(name, "x.toml")


@pytest.mark.parametrize("name", ["LD_PRELOAD", "PATH", "PYTHONPATH", "BASH_ENV", "ld_library_path", "IDIC_X", "A B"])
def test_an_experiment_cannot_make_the_program_load_something_else(name):
    with pytest.raises(InputError):
        check_environment({name: "x"}, "x.toml")
    check_environment({"OMP_NUM_THREADS": "2", "CCX_NPROC": "1"}, "x.toml")


def test_the_guard_needs_nothing_but_the_standard_library():
    guard = Path(external_process.GUARD)
    done = subprocess.run([sys.executable, "-I", "-S", str(guard), json.dumps(
        {"command": ["/no/such"], "log": os.devnull, "log_limit": 10, "timeout_s": 1.0})],
        stdin=subprocess.PIPE, capture_output=True, text=True, check=True)
    assert json.loads(done.stdout)["outcome"] == "not started"
