"""Starting an external program: permission, path and exit status; never through a shell."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from idic.errors import InputError

PERMISSION = "IDIC_ALLOW_EXTERNAL"  # programs that may be started, separated as in PATH
GUARD = Path(__file__).with_name("guard.py")
LOG_FILE, MAX_LOG_BYTES = "log.txt", 4_000_000  # bytes
GUARD_GRACE_SECONDS = 30.0  # after the limit of the program, until the guard itself is killed
FORBIDDEN_PREFIXES = ("PATH", "LD_", "DYLD_", "PYTHON", "BASH", "ENV", "IFS", "SHELL", "PERL", "RUBY", "NODE_", "IDIC_")


@dataclass(frozen=True)
class Ending:
    """How a program ended.

    outcome : "ended", "timeout", "stopped", "not started"; code : negative = killed by a signal
    """

    outcome: str
    code: int | None
    reason: str = ""

    def in_words(self, program: str, timeout_s: float) -> str:
        """What went wrong; empty where nothing did."""
        if self.outcome == "timeout":
            return f"{program} was ended after {timeout_s:g} s"
        if self.outcome != "ended":
            fault = "could not be started" if self.outcome == "not started" else "was stopped"
            return f"{program} {fault} {self.reason}".strip()
        if self.code:
            fault = f"was killed by signal {-self.code}" if self.code < 0 else f"ended with exit code {self.code}"
            return f"{program} {fault}"
        return ""


def require_permission(command: Sequence[str], file: Path | str) -> None:
    """Check that the user allowed this program by name.

    Raises
    ------
    InputError
        The program is not allowed: an experiment folder alone never starts one.
    """
    allowed = [name for name in os.environ.get(PERMISSION, "").split(os.pathsep) if name]
    if command[0] not in allowed:
        raise InputError("the experiment starts a program that is not allowed", file=file,
                         key="solver.command", expected=f"permission to run {command[0]!r}",
                         found=f"allowed: {', '.join(allowed) or 'nothing'}; the command is {' '.join(command)}",
                         remedy="read command, template and files of [solver]; if you trust them, add "
                                f"--allow-external {command[0]}  (or set {PERMISSION}={command[0]}, "
                                "on the workers of a cluster, too)")


def find_program(name: str, file: Path | str) -> str:
    """The absolute path of a program: given so, or found on PATH.

    Raises
    ------
    InputError
        No such program, or a relative path.
    """
    key = "solver.command[0]"
    if not os.path.isabs(name) and (os.sep in name or (os.altsep and os.altsep in name)):
        raise InputError("a program by a relative path", file=file, key=key, found=name,
                         expected="a name found on PATH, or an absolute path", remedy="write the absolute path")
    path = shutil.which(name)
    if path is None or not os.path.isabs(path):
        raise InputError("the program of the external solver is not found", file=file, key=key,
                         expected=f"{name!r} on PATH, executable" if not os.path.isabs(name) else "an executable file",
                         found="nothing", remedy="install it, or write its absolute path")
    return path


def check_environment(environment: Mapping[str, str], file: Path | str) -> None:
    """Refuse variables that make the allowed program load other code."""
    for name in environment:
        plain = name.replace("_", "").isalnum() and "\0" not in environment[name]
        if name.upper().startswith(FORBIDDEN_PREFIXES) or not plain:
            raise InputError("a variable that an experiment must not set", file=file, key=f"solver.environment.{name}",
                             expected="variables of the solver, such as OMP_NUM_THREADS", found=name,
                             remedy="set it where you start idic: the solver inherits it")


def run_program(command: Sequence[str], folder: Path, environment: Mapping[str, str], timeout_s: float) -> Ending:
    """Run a program in a folder until it ends or the time is up; its output goes to ``log.txt`` there.

    command : its first entry is an absolute path. The program ends with this process, however that ends.
    """
    order = json.dumps({"command": list(command), "log": str((folder / LOG_FILE).resolve()), "log_limit": MAX_LOG_BYTES,
                        "timeout_s": timeout_s})
    guard = subprocess.Popen([sys.executable, "-I", str(GUARD), order], cwd=folder, stdin=subprocess.PIPE,
                             stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, env=os.environ | dict(environment),
                             start_new_session=True)
    try:
        report = guard.stdout.read()  # until the guard is done; an interruption goes to `finally`
    finally:
        guard.stdin.close()
        try:
            guard.wait(GUARD_GRACE_SECONDS)
        except subprocess.TimeoutExpired:
            guard.kill()
            guard.wait()
        guard.stdout.close()
    try:
        return Ending(**json.loads(report))
    except (ValueError, TypeError):
        return Ending("stopped", None, "(its guard process ended)")
