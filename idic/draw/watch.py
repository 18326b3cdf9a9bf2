"""Starts `idic identify` as a process of its own, and tells how its RUN stands; what came out is in its report.

The page only reads: a RUN goes on, to the same numbers, whether anybody watches or not.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from idic.draw.folder import RUNS, run_folder
from idic.errors import InputError
from idic.inside import folder_inside, is_inside, open_inside
from idic.run import STATE_FILE, empty_folder, is_held, read_result

CONSOLE = ".console.txt"  # FOLDER/runs/NAME.console.txt: what the command says
LOG_LINES = 12


def start(folder: Path, name: str) -> subprocess.Popen:
    """`idic identify FOLDER --out FOLDER/runs/NAME`, which outlives this process; a RUN of this name is resumed.

    Raises
    ------
    InputError
        The name is none.
    """
    run = run_folder(folder, name)
    folder_inside(folder, RUNS)
    resume = ["--resume"] if (run / "run.zarr").exists() else []
    command = [sys.executable, "-m", "idic", "identify", str(folder), "--out", str(run), *resume]
    detachment = ({"creationflags": getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0)} if os.name == "nt"
             else {"start_new_session": True})
    with open_inside(folder, f"{RUNS}/{name}{CONSOLE}", "wb") as console:
        return subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=console, stderr=subprocess.STDOUT,
                                cwd=empty_folder(), **detachment)


def next_name(used_names: tuple[str, ...]) -> str:
    """``run-1``, or the first number that is free."""
    return next(name for k in range(1, 10_000) if (name := f"run-{k}") not in used_names)


def state_of(folder: Path, name: str) -> dict:
    """How a RUN stands: at work, starting, stopped, or the status of its result; the last lines of its log; whether it
    has a report. Cheap; asked every second."""
    run = run_folder(folder, name)
    lines = _tail(folder, f"{RUNS}/{name}/log.txt") or _tail(folder, f"{RUNS}/{name}{CONSOLE}")
    return {"name": name, "status": _status(run), "log": lines, "report": is_inside(run, "report.html")}


def _status(run: Path) -> str:
    if is_held(run):
        return "at work"
    try:
        return read_result(run)["status"]
    except (InputError, OSError):  # none yet
        return "stopped" if is_inside(run, STATE_FILE) else "starting"


def _tail(folder: Path, name: str) -> list[str]:
    try:
        with open_inside(folder, name) as stream:
            stream.seek(0, os.SEEK_END)
            stream.seek(max(stream.tell() - 8192, 0))
            text = stream.read().decode("utf-8", errors="replace")
    except (InputError, OSError):
        return []
    return [line[:300] for line in text.splitlines() if line.strip()][-LOG_LINES:]


def is_at_work(folder: Path, name: str) -> bool:
    """Whether a process works on the RUN."""
    return is_held(run_folder(folder, name))
