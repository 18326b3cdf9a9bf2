"""An existing scheduler that is lost, and a network that is silent between scheduler and worker for 5, 30 and 120 s:
``python -m idic_studies.evidence.network_faults scheduler 3 cut 3``.

The worker reaches the scheduler through a relay of this process, which stops forwarding and goes on, as a cable that is
pulled; nothing is closed. Afterwards the run has the bits of the undisturbed one, or ends with one message and goes on.
"""

from __future__ import annotations

import os
import select
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path


from idic_studies.evidence.faults import Bench, end_of_identify, finished, main, say

HOST = "127.0.0.1"
SILENCES_S = (5.0, 30.0, 120.0)
STARTED_S = 60.0  # until a scheduler listens on a busy machine
CHUNK = 1 << 16


class Relay:
    """Forwards TCP connections to a port of this machine, unless it is silent."""

    def __init__(self, target: int):
        self.target, self.is_silent, self.is_over = target, threading.Event(), threading.Event()
        self.place = socket.create_server((HOST, 0))
        self.port = self.place.getsockname()[1]
        threading.Thread(target=self._accept, daemon=True).start()

    def _accept(self) -> None:
        with suppress(OSError):
            while not self.is_over.is_set():
                near, _ = self.place.accept()
                far = socket.create_connection((HOST, self.target))
                for pair in ((near, far), (far, near)):
                    threading.Thread(target=self._forward, args=pair, daemon=True).start()

    def _forward(self, source: socket.socket, target: socket.socket) -> None:
        with suppress(OSError):
            while not self.is_over.is_set():
                if self.is_silent.is_set():
                    time.sleep(0.05)
                    continue
                if select.select([source], [], [], 0.2)[0]:
                    data = source.recv(CHUNK)
                    if not data:
                        break
                    target.sendall(data)
        for end in (source, target):
            with suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)


@contextmanager
def cluster(through: bool) -> Iterator[tuple[str, subprocess.Popen, Relay | None]]:
    """Address and process of a scheduler with one worker; `through`: the worker reaches it by a relay."""
    with socket.create_server((HOST, 0)) as probe:
        port = probe.getsockname()[1]
    environment = dict(os.environ) | {"DASK_LOGGING__DISTRIBUTED": "critical", "OMP_NUM_THREADS": "1"}
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "env": environment}
    scheduler = subprocess.Popen([sys.executable, "-m", "dask", "scheduler", "--host", HOST, "--port",
                                  str(port), "--dashboard-address", f"{HOST}:0"], **quiet)
    _wait_for(port)
    relay = Relay(port) if through else None
    worker = subprocess.Popen([sys.executable, "-m", "dask", "worker",
                               f"tcp://{HOST}:{relay.port if relay else port}", "--host", HOST, "--nthreads", "1",
                               "--dashboard-address", f"{HOST}:0"], **quiet)
    try:
        yield f"tcp://{HOST}:{port}", scheduler, relay
    finally:
        if relay:
            relay.is_over.set()
            relay.place.close()
        for process in (worker, scheduler):
            process.send_signal(signal.SIGTERM)
            with suppress(subprocess.TimeoutExpired):
                process.wait(20)
            process.kill()
            process.wait()


def _wait_for(port: int) -> None:
    end = time.monotonic() + STARTED_S
    while time.monotonic() < end:
        with suppress(OSError), socket.create_connection((HOST, port)):
            return
        time.sleep(0.1)
    raise TimeoutError(f"nothing listens on port {port}")


def _begun(bench: Bench, run: Path, address: str) -> subprocess.Popen:
    """An identification on a scheduler, in its first evaluations."""
    process = bench.command("identify", bench.experiment, "--out", run, "--scheduler", address, "--no-report",
                            "--no-prefect")
    while process.poll() is None and not (run / "run.json").exists():
        time.sleep(0.05)
    return process


def scheduler_losses(bench: Bench, number: int) -> None:
    """The scheduler killed at a random instant: one message, then `--resume` without it gives the same bits."""
    expected = end_of_identify(bench.run)
    for k in range(number):
        run = bench.folder / f"scheduler-{k}"
        with cluster(False) as (address, scheduler, _):
            process = _begun(bench, run, address)
            with suppress(subprocess.TimeoutExpired):
                process.wait(bench.rng.uniform(0.0, 4.0))
            scheduler.kill()
            code, words = finished(process)
        bench.count("loss of the scheduler: one message", code in (0, 2, 3, 4) and "Traceback" not in words,
                    f"code {code}\n{words}")
        say(f"code {code}: {words.strip().splitlines()[-3:]}")
        code, words = finished(bench.command("identify", bench.experiment, "--out", run, "--workers", 0, "--no-report",
                                             "--no-prefect", "--resume"))
        bench.count("loss of the scheduler: the same end", code in (0, 3) and end_of_identify(run) == expected,
                    f"code {code}\n{words}")


def cuts(bench: Bench, number: int) -> None:
    """Silence between scheduler and worker; the run ends by itself, with the same bits."""
    expected = end_of_identify(bench.run)
    for k, silence_s in enumerate(SILENCES_S[:number]):
        run = bench.folder / f"cut-{k}"
        with cluster(True) as (address, _, relay):
            process = _begun(bench, run, address)
            assert relay is not None
            relay.is_silent.set()
            time.sleep(silence_s)
            relay.is_silent.clear()
            code, words = finished(process)
        bench.count(f"{silence_s:g} s without a network: the same end",
                    code in (0, 3) and end_of_identify(run) == expected, f"code {code}\n{words}")


FAULTS = {"scheduler": scheduler_losses, "cut": cuts}


if __name__ == "__main__":
    sys.exit(main(FAULTS, __doc__))
