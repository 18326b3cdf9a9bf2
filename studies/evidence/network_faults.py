"""An existing scheduler that is lost, and a network that is silent between scheduler and worker for 5, 30 and 120 s:
``python -m idic_studies.evidence.network_faults scheduler 3 cut 3 unplugged 3 abandoned 1``.

cut: the worker reaches the scheduler through a relay of this process, which stops forwarding and goes on; nothing is
closed. unplugged (as root, with iproute2): the worker runs in a network namespace behind a router in another one, which
drops every packet, as a cable that is pulled from a switch; a worker that ends by itself is started again, as by
`deploy/compose.yaml`. abandoned: it is not, and the run is to end without workers. Afterwards the run has the bits of
the undisturbed one, or ends with one message and goes on.
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
ROUTER, FAR = "idic-router", "idic-worker"  # network namespaces
ADDRESSES = {"near": "10.77.0.1", "by-near": "10.77.0.2", "by-far": "10.77.1.1", "far": "10.77.1.2"}
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


    def silence(self) -> None:
        self.is_silent.set()

    def resume(self) -> None:
        self.is_silent.clear()

    def close(self) -> None:
        self.is_over.set()
        self.place.close()


class Router:
    """A network namespace between this one and that of a worker, which forwards their packets or drops them."""

    def __init__(self) -> None:
        self.close()
        for name in (ROUTER, FAR):
            _ip("netns", "add", name)
            _ip("-n", name, "link", "set", "lo", "up")
        for here, there, ends in ((None, ROUTER, ("near", "by-near")), (ROUTER, FAR, ("by-far", "far"))):
            _ip(*_of(here), "link", "add", f"idic-{ends[0]}", "type", "veth", "peer", "name", f"idic-{ends[1]}",
                "netns", there)
            for namespace, end in zip((here, there), ends, strict=True):
                _ip(*_of(namespace), "addr", "add", f"{ADDRESSES[end]}/24", "dev", f"idic-{end}")
                _ip(*_of(namespace), "link", "set", f"idic-{end}", "up")
        _ip("route", "add", "10.77.1.0/24", "via", ADDRESSES["by-near"])
        _ip("-n", FAR, "route", "add", "default", "via", ADDRESSES["by-far"])
        self.resume()

    def _forward(self, value: int) -> None:
        _ip("netns", "exec", ROUTER, "sh", "-c", f"echo {value} > /proc/sys/net/ipv4/ip_forward")

    def silence(self) -> None:
        self._forward(0)

    def resume(self) -> None:
        self._forward(1)

    def close(self) -> None:
        """Remove the namespaces; their interfaces go with them."""
        for name in (ROUTER, FAR):
            subprocess.run(["ip", "netns", "delete", name], stderr=subprocess.DEVNULL, check=False)


def _ip(*words: str) -> None:
    subprocess.run(["ip", *words], check=True)


def _of(namespace: str | None) -> list[str]:
    return ["-n", namespace] if namespace else []


@contextmanager
def cluster(way: type[Relay] | type[Router] | None, is_restarted: bool = False,
            ) -> Iterator[tuple[str, subprocess.Popen, Relay | Router | None]]:
    """Address and process of a scheduler with one worker; `way`: what lies between them."""
    with socket.create_server((HOST, 0)) as probe:
        port = probe.getsockname()[1]
    environment = dict(os.environ) | {"DASK_LOGGING__DISTRIBUTED": "critical", "OMP_NUM_THREADS": "1"}
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "env": environment}
    listens = "0.0.0.0" if way is Router else HOST
    link: Relay | Router | None = Relay(port) if way is Relay else Router() if way is Router else None
    scheduler = subprocess.Popen([sys.executable, "-m", "dask", "scheduler", "--host", listens, "--port",
                                  str(port), "--dashboard-address", f"{HOST}:0"], **quiet)
    _wait_for(port)
    prefix, place, target = [], HOST, f"{HOST}:{link.port if isinstance(link, Relay) else port}"
    if isinstance(link, Router):
        prefix, place, target = ["ip", "netns", "exec", FAR], ADDRESSES["far"], f"{ADDRESSES['near']}:{port}"
    command = [*prefix, sys.executable, "-m", "dask", "worker", f"tcp://{target}", "--host", place, "--nthreads", "1",
               "--dashboard-address", f"{HOST}:0"]
    is_over = threading.Event()
    keeper = threading.Thread(target=_keep, args=(command, quiet, is_restarted, is_over))
    keeper.start()
    try:
        yield f"tcp://{HOST}:{port}", scheduler, link
    finally:
        if isinstance(link, Relay):
            link.close()
        is_over.set()
        keeper.join()
        _stop(scheduler)
        if isinstance(link, Router):
            link.close()


def _keep(command: list[str], options: dict, is_restarted: bool, is_over: threading.Event) -> None:
    """Run a worker until it is over, a new one after one that has ended."""
    worker = subprocess.Popen(command, **options)
    while not is_over.wait(1.0):
        if is_restarted and worker.poll() is not None:
            worker = subprocess.Popen(command, **options)
    _stop(worker)


def _stop(process: subprocess.Popen) -> None:
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


def _begun(bench: Bench, run: Path, address: str, no_workers: str = "wait") -> subprocess.Popen:
    """An identification on a scheduler, in its first evaluations."""
    process = bench.command("identify", bench.experiment, "--out", run, "--scheduler", address, "--no-report",
                            "--no-prefect", env=os.environ | {"IDIC_NO_WORKERS": no_workers})
    while process.poll() is None and not (run / "run.json").exists():
        time.sleep(0.05)
    return process


def scheduler_losses(bench: Bench, number: int) -> None:
    """The scheduler killed at a random instant: one message, then `--resume` without it gives the same bits."""
    expected = end_of_identify(bench.run)
    for k in range(number):
        run = bench.folder / f"scheduler-{k}"
        with cluster(None) as (address, scheduler, _):
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
    """Silence of a relay between scheduler and worker."""
    for silence_s in SILENCES_S[:number]:
        _silence(bench, Relay, silence_s)


def unplugged(bench: Bench, number: int) -> None:
    """Silence of a router between scheduler and worker."""
    for silence_s in SILENCES_S[:number]:
        _silence(bench, Router, silence_s)


def abandoned(bench: Bench, number: int) -> None:
    """A worker that does not come back after a silence."""
    for _ in range(number):
        _silence(bench, Router, SILENCES_S[-1], "end")


def _silence(bench: Bench, way: type[Relay] | type[Router], silence_s: float, no_workers: str = "wait") -> None:
    """The run ends by itself, or with one message and then with `--resume`; with the same bits."""
    expected, run = end_of_identify(bench.run), bench.folder / f"{way.__name__}-{silence_s:g}-{no_workers}"
    what = f"{silence_s:g} s without a network ({way.__name__.lower()}, {no_workers})"
    with cluster(way, no_workers == "wait") as (address, _, link):
        process = _begun(bench, run, address, no_workers)
        assert link is not None
        link.silence()
        time.sleep(silence_s)
        bench.count(f"{what}: within the run", process.poll() is None)
        link.resume()
        code, words = finished(process)
    say(f"code {code}: {words.strip().splitlines()[-4:]}")
    bench.count(f"{what}: an end or one message", code in (0, 2, 3) and "Traceback" not in words,
                f"code {code}\n{words}")
    if code == 2:
        code, words = finished(bench.command("identify", bench.experiment, "--out", run, "--workers", 0, "--no-report",
                                             "--no-prefect", "--resume"))
    bench.count(f"{what}: the same end", code in (0, 3) and end_of_identify(run) == expected, f"code {code}\n{words}")


FAULTS = {"scheduler": scheduler_losses, "cut": cuts, "unplugged": unplugged, "abandoned": abandoned}


if __name__ == "__main__":
    sys.exit(main(FAULTS, __doc__))
