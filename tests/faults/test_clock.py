"""The clock of the machine may be set while idic runs: nothing is taken for dead, and no time is negative."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from pathlib import Path

import psutil
import pytest
from quality.called import called

from idic.run.store import run_lock

ROOT = Path(__file__).parents[2]
SHIFTS = (-86400.0, -3600.0, 3600.0, 86400.0)  # s


@pytest.fixture
def without_flock(monkeypatch):
    """A file system that has no locks: the holder's process is looked for."""
    monkeypatch.setattr(run_lock, "fcntl", None)


@pytest.mark.parametrize("shift", SHIFTS)
def test_the_holder_of_a_run_lives_on_when_the_clock_is_set(tmp_path, monkeypatch, without_flock, shift):
    with run_lock.run_lock(tmp_path):
        boot, create = psutil.boot_time, psutil.Process.create_time
        monkeypatch.setattr(psutil, "boot_time", lambda: boot() + shift)
        monkeypatch.setattr(psutil.Process, "create_time", lambda process: create(process) + shift)
        with pytest.raises(run_lock.RunBusy), run_lock.run_lock(tmp_path):
            pass


def test_a_process_number_that_was_given_to_a_younger_process_is_no_holder(tmp_path, without_flock):
    with run_lock.run_lock(tmp_path):
        content = (tmp_path / run_lock.LOCK_NAME).read_text()
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as younger:
        (tmp_path / run_lock.LOCK_NAME).write_text(content.replace(f'"pid": {os.getpid()}', f'"pid": {younger.pid}'))
        with run_lock.run_lock(tmp_path):
            pass
        younger.communicate(b"\n")


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="reads /proc")
def test_psutil_shifts_both_times_alike():
    """What the rule above rests on: start of a process and start of the machine come from the same clock."""
    ticks = float(Path("/proc/self/stat").read_text().rpartition(")")[2].split()[19]) / os.sysconf("SC_CLK_TCK")
    assert run_lock._started(psutil.Process()) == pytest.approx(ticks, abs=1.0)


@pytest.mark.parametrize("folder", ["idic", "flows"])
def test_durations_come_from_monotonic_clocks(folder):
    """`time.time()` is for what people read; a difference of two of them may have any sign."""
    for file in sorted((ROOT / folder).rglob("*.py")):
        calls = [node for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))) if isinstance(node, ast.Call)]
        assert not [node for node in calls if called(node) in ("time.time", "datetime.now")], file
