"""Runs of `idic identify` that are stopped in every way, and what must be true of them afterwards."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import psutil
from one_thread import ONE_THREAD

from idic.run import read_result

SECONDS = 600.0  # a run takes 10 s on a quiet machine, minutes on one with ten times as many processes as cores
BEGINNING = 0.25  # share of a run before its first evaluation
PLAIN = """
import sys
if __name__ == "__main__":
    import idic
    idic.identify(sys.argv[1], sys.argv[2], resume=True, workers=int(sys.argv[3]))
"""


def command_line(*arguments) -> subprocess.Popen:
    """`idic ARGUMENTS` in a process group of its own, as a shell would start it."""
    code = "from idic.cli import main; main()"
    script = Path(os.environ["IDIC_TEST_SCRIPTS"]) / "idic_command.py"
    script.write_text(f'if __name__ == "__main__":\n    {code}\n')
    return _start([script, *arguments])


def plain_run(experiment: Path, run: Path, workers: int) -> subprocess.Popen:
    """The Python API in another process; goes on with what is there."""
    script = Path(os.environ["IDIC_TEST_SCRIPTS"]) / "plain_run.py"
    script.write_text(PLAIN)
    return _start([script, experiment, run, workers])


def _start(arguments) -> subprocess.Popen:
    return subprocess.Popen([sys.executable, *map(str, arguments)], stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                            text=True, env=dict(os.environ) | ONE_THREAD, start_new_session=True)


def finish(process: subprocess.Popen) -> tuple[int, str]:
    """Exit code and everything that was said."""
    out, err = process.communicate(timeout=SECONDS)
    return process.returncode, out + err


def wait_for_evaluation(run: Path, process: subprocess.Popen, number: int) -> None:
    """Until the checkpoint holds `number` evaluated points."""
    end = time.monotonic() + SECONDS
    while evaluations(run) < number:
        assert process.poll() is None, finish(process)
        assert time.monotonic() < end, "the run did not get so far"
        time.sleep(0.02)


def is_at(run: Path, process: subprocess.Popen, share: float, whole: int) -> bool:
    """Wait until a share of a run of `whole` evaluations is done, and no clock of a busy machine; False: it has ended.

    share : 0 the start of the process, then the evaluations, 1 the last; around them in seconds, 5 to a whole
    """
    end, wanted = time.monotonic() + SECONDS, int(share * whole) if share > BEGINNING else -1
    while evaluations(run) < min(wanted, whole) and process.poll() is None:
        assert time.monotonic() < end, "the run did not get so far"
        time.sleep(0.02)
    try:
        process.wait(5.0 * (share if wanted < 0 else max(share - 1.0, (share * whole) % 1.0 / whole)))
    except subprocess.TimeoutExpired:
        return True
    return False


def evaluations(run: Path) -> int:
    try:
        return json.loads((run / "state.json").read_text())["state"]["evaluations"]
    except (OSError, ValueError):
        return -1


def descendants(process: subprocess.Popen) -> list[psutil.Process]:
    return psutil.Process(process.pid).children(recursive=True)


def kill(process: subprocess.Popen) -> None:
    """SIGKILL to the driver alone: nobody can tidy up."""
    os.kill(process.pid, signal.SIGKILL)
    process.communicate()


def still_alive(processes: list[psutil.Process], seconds: float = 15.0) -> list[psutil.Process]:
    """Those that live on after some seconds (the server asks its own children to end first)."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        alive = [p for p in processes if p.is_running() and p.status() != psutil.STATUS_ZOMBIE]
        if not alive:
            return []
        time.sleep(0.1)
    return alive


def outcome(run: Path) -> dict:
    """What two runs must agree in to the last bit (JSON keeps doubles exactly)."""
    return {key: value for key, value in read_result(run).items() if key not in ("cost", "forward_runs")}


def stored_system(run: Path) -> dict[str, bytes]:
    """M, b and the rest of the accepted point, as they lie on the disk."""
    state = json.loads((run / "state.json").read_text())["state"]
    folder = run / "run.zarr" / "evaluations" / f"{state['accepted']['number']:03d}" / "system"
    chunks = [file for file in sorted(folder.rglob("c/**/*")) if file.is_file()]
    return {str(file.relative_to(folder)): file.read_bytes() for file in chunks}
