"""Faults while idic works, and whether the end has the bits of an undisturbed run: ``python -m
idic_studies.evidence.faults identify 40 diagnose 20 worker 20 server 3 disk 10 memory 3 clock 6
[--seed 0]``.

identify, diagnose: kills of the driver at random instants, with 0, 1 and 2 workers in turn, several to a run, then
``--resume``. worker: a worker process killed twice, 5 to 40 s apart. server: the Prefect server killed. disk: sizes
of files limited to 10 values (RLIMIT_FSIZE), then resumed without. memory: address space limited, then resumed without.
clock: the wall clock set back and on, by a day at most, every few seconds, with 0, 1 and 2 workers (with a C compiler).
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np
import psutil

from idic.run import read_result
from idic_studies.evidence.hostile.bases import demonstration, longer_demonstration

PROGRAM = "if __name__ == '__main__':\n    from idic.cli import main\n    main()\n"
PATIENCE_S = 600.0  # of a command on a shared machine
AFTERWARDS_S = 15.0  # until the processes of a killed command are gone
# kills of a run, and between which parts of the length of an undisturbed one: a diagnosis goes on where it was
INSTANTS = {"identify": (2, 0.1, 1.1), "diagnose": (5, 0.05, 0.4)}
WORKERS = (0, 1, 2)
WORKER, SERVER = "spawn_main", "uvicorn"  # words of their command lines
SIZES = (0, 1, 100, 1_000, 4_000, 10_000, 20_000, 50_000, 100_000, 300_000)  # bytes that a file may have
SHIFTS_S = (-86_400, -3_600, -1, 1, 3_600, 86_400)  # of the wall clock
NANOSECONDS = struct.Struct("=q")
MAX_JUMPS = 100  # of a run
SPACES = (1_200, 1_600, 2_000)  # MB of address space: libraries and stacks reserve about 1000
say = partial(print, flush=True)


@dataclass
class Bench:
    """An experiment, the ends of its undisturbed commands, and the folder of a campaign."""

    folder: Path
    experiment: Path
    run: Path
    rng: np.random.Generator
    counts: Counter = field(default_factory=Counter)

    def command(self, *words: object, **options: object) -> subprocess.Popen:
        script = self.folder / "idic_command.py"
        script.write_text(PROGRAM)
        return subprocess.Popen([sys.executable, str(script), *map(str, words)], stdout=subprocess.PIPE,
                                stderr=subprocess.PIPE, text=True, start_new_session=True, **options)

    def count(self, what: str, is_right: bool, words: str = "") -> None:
        self.counts[f"{what}: {'as it must be' if is_right else 'WRONG'}"] += 1
        say(f"{time.strftime('%H:%M:%S')} {'right' if is_right else 'WRONG'}: {what}")
        if not is_right:
            say(f"WRONG {what}: {words[-1500:]}")


# commands and their ends ------------------------------------------------------------------------------
def identify(bench: Bench, run: Path, workers: int, experiment: Path | None = None,
             **options: object) -> subprocess.Popen:
    resume = ["--resume"] if (run / "run.zarr").exists() else []
    return bench.command("identify", experiment or bench.experiment, "--out", run, "--workers", workers, "--no-report",
                         "--no-prefect", *resume, **options)


def diagnose(bench: Bench, run: Path, workers: int, **options: object) -> subprocess.Popen:
    if not run.exists():
        shutil.copytree(bench.run, run)
    resume = ["--resume"] if (run / "diagnosis").exists() else []
    return bench.command("diagnose", run, "--workers", workers, "--no-prefect", "--quick", *resume, **options)


def end_of_identify(run: Path) -> object:
    """Result and, of the accepted point, M and b, to the last bit."""
    result = {key: value for key, value in read_result(run).items() if key not in ("cost", "forward_runs")}
    state = json.loads((run / "state.json").read_text())["state"]
    system = run / "run.zarr" / "evaluations" / f"{state['accepted']['number']:03d}" / "system"
    chunks = {str(path.relative_to(system)): path.read_bytes() for path in sorted(system.rglob("c/**/*"))
              if path.is_file()}
    return result, chunks


def end_of_diagnose(run: Path) -> object:
    content = json.loads((run / "diagnosis.json").read_text())
    return {key: value for key, value in content.items() if key not in ("cost", "sha256")}


COMMANDS: dict[str, tuple[Callable[..., subprocess.Popen], Callable[[Path], object]]] = {
    "identify": (identify, end_of_identify), "diagnose": (diagnose, end_of_diagnose)}


def members(process: subprocess.Popen, mark: str) -> list[psutil.Process]:
    """The processes of a command whose command line has a word."""
    processes = []
    for member in family(process):
        try:
            if mark in " ".join(member.cmdline()):
                processes.append(member)
        except psutil.Error:
            continue
    return processes


def family(process: subprocess.Popen) -> list[psutil.Process]:
    try:
        return psutil.Process(process.pid).children(recursive=True)
    except psutil.Error:
        return []


def survivors(processes: list[psutil.Process]) -> list[psutil.Process]:
    """Those that live on some seconds after their driver."""
    end = time.monotonic() + AFTERWARDS_S
    while time.monotonic() < end:
        alive = [member for member in processes if member.is_running() and member.status() != psutil.STATUS_ZOMBIE]
        if not alive:
            return []
        time.sleep(0.1)
    return alive


def finished(process: subprocess.Popen) -> tuple[int, str]:
    try:
        shown, error = process.communicate(timeout=PATIENCE_S)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        shown, error = process.communicate()
        return -1, f"not over after {PATIENCE_S:g} s\n{shown}{error}"
    return process.returncode, shown + error


# faults -----------------------------------------------------------------------------------------------
def kills(bench: Bench, name: str, number: int) -> None:
    """SIGKILL, or SIGTERM now and then, to the driver at random instants."""
    start, end_of = COMMANDS[name]
    undisturbed = bench.folder / f"undisturbed-{name}"
    began = time.monotonic()
    code, _ = finished(start(bench, undisturbed, 0))
    length = time.monotonic() - began
    say(f"{name}: undisturbed in {length:.0f} s, exit code {code}")
    struck, k = 0, 0
    while struck < number:
        struck += _struck(bench, name, WORKERS[k % len(WORKERS)], (code, end_of(undisturbed)), length)
        k += 1


def _struck(bench: Bench, name: str, workers: int, expected: tuple[int, object], length: float) -> int:
    """The kills of one run; in the end it has the exit code and the bits that it must have."""
    (start, end_of), (number, *span), run = COMMANDS[name], INSTANTS[name], bench.folder / name
    struck = 0
    for _ in range(number):
        process = start(bench, run, workers)
        try:
            process.wait(bench.rng.uniform(*span) * length)
            break  # it was over
        except subprocess.TimeoutExpired:
            struck += 1
            _strike(bench, process, f"{name}, {workers} workers")
    code, words = finished(start(bench, run, workers))
    bench.count(f"end of {name} with {workers} workers", (code, end_of(run)) == expected, f"code {code}\n{words}")
    shutil.rmtree(run)
    return struck


def _strike(bench: Bench, process: subprocess.Popen, what: str) -> None:
    processes, is_asked = family(process), bool(bench.rng.integers(4) == 0)
    if is_asked:
        process.send_signal(signal.SIGTERM)
        code, words = finished(process)
        is_right = code in (0, 3, 4, -signal.SIGTERM) and "Traceback" not in words
        bench.count(f"SIGTERM of {what}", is_right, f"code {code}\n{words}")
    else:
        process.kill()
        process.communicate()
    left_over = survivors(processes)
    bench.count(f"{'SIGTERM' if is_asked else 'SIGKILL'}, no process after {what}", not left_over, str(left_over))


def worker_losses(bench: Bench, number: int) -> None:
    """One worker of one, or one of two, killed twice, 5 to 40 s apart, in a run that lasts longer."""
    base = longer_demonstration()
    expected = end_of_identify(base.run)
    for k in range(number):
        run, workers = bench.folder / f"worker-{k}", 1 + k % 2
        process = identify(bench, run, workers, experiment=base.experiment)
        killed = 0
        for pause in (bench.rng.uniform(0.0, 3.0), bench.rng.uniform(5.0, 40.0)):
            while process.poll() is None and not members(process, WORKER):
                time.sleep(0.05)
            try:
                process.wait(pause)
                break
            except subprocess.TimeoutExpired:
                for member in members(process, WORKER)[:1]:
                    member.kill()
                    killed += 1
        code, words = finished(process)
        bench.count(f"{killed} losses of a worker of {workers}",
                    code in (0, 3) and end_of_identify(run) == expected, f"code {code}\n{words}")
        shutil.rmtree(run)


def server_losses(bench: Bench, number: int) -> None:
    """The Prefect server killed at a random instant of a command that has one."""
    expected = _undisturbed(bench)
    for k in range(number):
        run = bench.folder / f"server-{k}"
        process = bench.command("identify", bench.experiment, "--out", run, "--workers", 1, "--no-report",
                                "--prefect")
        while process.poll() is None and not members(process, SERVER):
            time.sleep(0.05)
        time.sleep(bench.rng.uniform(0.0, 15.0))
        for member in members(process, SERVER):
            member.kill()
        processes = family(process)
        code, words = finished(process)
        is_right = code in (0, 3) and end_of_identify(run) == expected and not survivors(processes)
        bench.count("loss of the Prefect server", is_right, f"code {code}\n{words}")
        shutil.rmtree(run)


def disks(bench: Bench, number: int) -> None:
    """No file may be larger than some bytes; then the run goes on without the limit."""
    _limited(bench, "a full disk", [partial(_limit, resource.RLIMIT_FSIZE, size) for size in SIZES[:number]])


def memories(bench: Bench, number: int) -> None:
    """The address space of the process is limited; then the run goes on without the limit."""
    _limited(bench, "little memory", [partial(_limit, resource.RLIMIT_AS, size << 20) for size in SPACES[:number]])


def _end_of_log(run: Path) -> str:
    log = run / "log.txt"
    return log.read_text(errors="replace")[-1200:] if log.is_file() else ""


def clocks(bench: Bench, number: int) -> None:
    """The wall clock of a command and its workers set again and again (`wall_clock.c`)."""
    library, shift = bench.folder / "wall_clock.so", bench.folder / "shift"
    subprocess.run([os.environ.get("CC", "cc"), "-shared", "-fPIC", "-O2", "-o", library,
                    Path(__file__).with_name("wall_clock.c")], check=True)
    expected = _undisturbed(bench)
    for k in range(number):
        run, workers, jumps = bench.folder / f"clock-{k}", WORKERS[k % len(WORKERS)], 0
        shift.write_bytes(NANOSECONDS.pack(0))
        process = identify(bench, run, workers, env=os.environ | {"LD_PRELOAD": str(library),
                                                                  "IDIC_WALL_CLOCK": str(shift)})
        while jumps < MAX_JUMPS:
            try:
                process.wait(bench.rng.uniform(0.5, 4.0))
                break
            except subprocess.TimeoutExpired:
                with open(shift, "r+b") as file:
                    file.write(NANOSECONDS.pack(SHIFTS_S[int(bench.rng.integers(len(SHIFTS_S)))] * 10**9))
                jumps += 1
        code, words = finished(process)
        bench.count(f"clock set in a run with {workers} workers", code in (0, 3) and end_of_identify(run) == expected,
                    f"code {code}, {jumps} jumps\n{words}\n{_end_of_log(run)}")
        bench.counts["jumps of the clock"] += jumps
        shutil.rmtree(run, ignore_errors=True)


def _limit(kind: int, size: int) -> None:
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(kind, (size, size))


def _limited(bench: Bench, what: str, limits: list[Callable[[], None]]) -> None:
    expected = _undisturbed(bench)
    for k, limit in enumerate(limits):
        run = bench.folder / f"limited-{what.rsplit(maxsplit=1)[-1]}-{k}"
        code, words = finished(identify(bench, run, 0, preexec_fn=limit))
        is_said = code in (0, 3) or (code == 2 and "Traceback" not in words and "internal error" not in words)
        bench.count(f"{what}: one message", is_said, f"{limit}: code {code}\n{words}")
        code, words = finished(identify(bench, run, 0))
        bench.count(f"{what}: the same end", code in (0, 3) and end_of_identify(run) == expected,
                    f"{limit}: code {code}\n{words}")
        shutil.rmtree(run, ignore_errors=True)


def _undisturbed(bench: Bench) -> object:
    return end_of_identify(bench.run)


FAULTS: dict[str, Callable[[Bench, int], None]] = {
    "identify": lambda bench, number: kills(bench, "identify", number),
    "diagnose": lambda bench, number: kills(bench, "diagnose", number),
    "worker": worker_losses, "server": server_losses, "disk": disks, "memory": memories, "clock": clocks}


def main(faults: Mapping[str, Callable[[Bench, int], object]] = FAULTS, description: str | None = __doc__) -> int:
    """Exit code 1 where an end was wrong."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("words", nargs="+", metavar="FAULT NUMBER", help=", ".join(faults))
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    base = demonstration()
    with tempfile.TemporaryDirectory(prefix="idic-faults-") as folder:
        bench = Bench(Path(folder), base.experiment, base.run, np.random.default_rng(options.seed))
        for name, number in zip(options.words[::2], options.words[1::2], strict=True):
            faults[name](bench, int(number))
        for what, number in sorted(bench.counts.items()):
            say(f"{number:4d}  {what}")
        return int(any("WRONG" in what for what in bench.counts))


if __name__ == "__main__":
    sys.exit(main())
