"""How long a user waits: import, help, and the demo with nothing compiled yet and with everything compiled."""

import os
import resource
import subprocess
import sys
import time
from pathlib import Path
from shutil import rmtree

import pytest
from virtual_tests.small_strip import write_small_strip

pytestmark = [pytest.mark.bench, pytest.mark.slow]


USES = """if True:
    import resource, subprocess, sys
    done = subprocess.run(sys.argv[1:], stdout=subprocess.DEVNULL)
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    print(used.ru_utime + used.ru_stime, used.ru_maxrss / 1024)
    sys.exit(done.returncode)
"""


def used_by(python, *words, **environment) -> tuple[float, float]:
    """CPU seconds of a command of idic with all its processes; largest resident memory of one of them (MiB).

    python : the interpreter of the version
    """
    answer = subprocess.run([sys.executable, "-c", USES, str(python), "-m", "idic", *map(str, words)],
                            capture_output=True, text=True, env=os.environ | environment)
    assert answer.returncode == 0, answer.stderr
    cpu_s, memory = answer.stdout.split()
    return float(cpu_s), float(memory)


def seconds(command, repeats=1, **environment) -> float:
    """Shortest wall time of a command."""
    times = []
    for _ in range(repeats):
        began = time.perf_counter()
        process = subprocess.run([sys.executable, *command], capture_output=True, env=os.environ | environment)
        times.append(time.perf_counter() - began)
        assert process.returncode == 0, process.stderr.decode()
    return min(times)


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
        usage_at_start = resource.getrusage(resource.RUSAGE_CHILDREN)
        seconds(["-m", "idic", "identify", str(test), "--no-report", "--out", str(tmp_path / "run"), *options])
        rmtree(tmp_path / "run")
        usage_at_end = resource.getrusage(resource.RUSAGE_CHILDREN)
        return usage_at_end.ru_utime + usage_at_end.ru_stime - usage_at_start.ru_utime - usage_at_start.ru_stime

    cpu_seconds("--no-prefect")  # compiles
    prefect_s, plain_s, workers_s = cpu_seconds("--prefect"), cpu_seconds("--no-prefect"), \
        cpu_seconds("--prefect", "--workers", "2")
    measured("identification of 11 small frames, Prefect's view", f"{prefect_s:.0f} CPU s",
             f"--no-prefect {plain_s:.0f} CPU s; with two workers {workers_s:.0f} CPU s")
    assert prefect_s < 0.8 * workers_s
    assert prefect_s < 4 * plain_s


@pytest.mark.parametrize("words, repeats", [(("check", "demo"), 3), (("identify", "demo", "--out", "run"), 2)],
                         ids=["check", "identify"])
def test_the_demo_beside_another_version(measured, tmp_path, words, repeats):
    """Each version in turns with its bytecode and its kernels on the disk; from a pipe, so that no terminal shows the
    address of Prefect's pages.

    IDIC_OTHER_PYTHON names the interpreter in which the other version is installed: FOLDER/.venv/bin/python.
    """
    if not Path(other := os.environ.get("IDIC_OTHER_PYTHON", "")).is_file():
        pytest.skip("IDIC_OTHER_PYTHON names no interpreter with another version")
    uses = {"this version": [], "the other one": []}
    for turn in range(repeats + 1):  # the first one compiles
        for name, python in (("this version", sys.executable), ("the other one", other)):
            place = tmp_path / name
            bytecode = {"PYTHONDONTWRITEBYTECODE": "", "PYTHONPYCACHEPREFIX": str(tmp_path / "bytecode")}
            if turn == 0:
                used_by(python, "example", "demo", "--out", place / "demo", **bytecode)
            paths = [place / word if word in ("demo", "run") else word for word in words]
            uses[name].append(used_by(python, *paths, **bytecode))
            rmtree(place / "run", ignore_errors=True)
    best = {name: min(pairs[1:]) for name, pairs in uses.items()}
    (cpu_s, memory), (other_s, other_memory) = best["this version"], best["the other one"]
    measured(f"`idic {words[0]}` of the demo", f"{cpu_s:.2f} CPU s, {memory:.0f} MiB",
             f"{cpu_s / other_s:.2f} of the other version's {other_s:.2f} CPU s and {other_memory:.0f} MiB")
    assert cpu_s < other_s
