"""How long a user waits: import, help, and the demo with nothing compiled yet and with everything compiled."""

import os
import resource
import subprocess
import sys
import time
from shutil import rmtree

import pytest
from virtual_tests.small_strip import write_small_strip

pytestmark = [pytest.mark.bench, pytest.mark.slow]


def seconds(command, repeats=1, **environment) -> float:
    """Shortest wall time of a command."""
    found = []
    for _ in range(repeats):
        began = time.perf_counter()
        done = subprocess.run([sys.executable, *command], capture_output=True, env=os.environ | environment)
        found.append(time.perf_counter() - began)
        assert done.returncode == 0, done.stderr.decode()
    return min(found)


def test_help_and_import_answer_at_once(measured):
    bare = seconds(["-c", "pass"], 5)
    plain, help_ = seconds(["-c", "import idic"], 5), seconds(["-m", "idic", "--help"], 5)
    measured("`import idic` / `idic --help`", f"{plain:.2f} s / {help_:.2f} s", f"bare interpreter {bare:.2f} s")
    assert plain < bare + 0.5 * help_ + 0.5  # nothing heavy is imported


def test_the_second_demo_has_nothing_to_compile(tmp_path, measured):
    cache = str(tmp_path / "cache")
    command = ["-m", "idic", "demo", "--out", str(tmp_path / "demo")]
    first, second = (seconds(command, NUMBA_CACHE_DIR=cache) for _ in range(2))
    measured("`idic demo`, second time", f"{second:.0f} s", f"first time, nothing compiled yet: {first:.0f} s")
    assert second < first


def test_a_small_run_pays_for_prefect_but_not_for_workers(tmp_path, measured):
    """Processor time of the command with all its processes, kernels compiled."""
    test = write_small_strip(tmp_path / "test")

    def cpu_seconds(*options) -> float:
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        seconds(["-m", "idic", "identify", str(test), "--no-report", "--out", str(tmp_path / "run"), *options])
        rmtree(tmp_path / "run")
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime

    cpu_seconds("--no-prefect")  # compiles
    shown, alone, spread = cpu_seconds("--prefect"), cpu_seconds("--no-prefect"), cpu_seconds("--workers", "2")
    measured("identification of 11 small frames, Prefect's view", f"{shown:.0f} CPU s",
             f"--no-prefect {alone:.0f} CPU s; with two workers {spread:.0f} CPU s")
    assert shown < 0.8 * spread
    assert shown < 4 * alone
