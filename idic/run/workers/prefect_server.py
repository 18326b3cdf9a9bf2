"""A Prefect server for the duration of a run if none is configured.

A server started by Prefect itself is slow (all services, a limit of 20 s) and survives a killed run. This one starts in
the background at the begin of a command, on the loopback interface, and always ends with this process (`parent_guard`).
It answers only those who know its key, drawn for each start: other users share the loopback interface, and so do the
pages of a browser. Prefect itself is not imported here.
"""

from __future__ import annotations

import http.client
import os
import secrets
import shutil
import socket
import subprocess
import sys
import tempfile
import threading
import time
import tomllib
from importlib.metadata import version
from pathlib import Path
from typing import Any

from idic.errors import InputError
from idic.run.store.run_lock import run_lock
from idic.run.workers import parent_guard
from idic.run.workers.working_folder import cache_folder, empty_folder

LOOPBACK = "127.0.0.1"
PASSWORD = "PREFECT_API_AUTH_STRING"  # of the server that the environment names, as Prefect calls it
START_SECONDS = 120.0  # a start takes 3 to 9 s on an idle machine, up to 25 s on a busy one
_STOP_SECONDS = 5.0
_MAX_RESTARTS = 5  # of a server that dies during a run
_CONFIGURED_SECONDS = 10.0

QUIET = {  # no telemetry, no requests to other hosts, no console output
    "DO_NOT_TRACK": "1",
    "PREFECT_SERVER_ANALYTICS_ENABLED": "false",
    "PREFECT_CLIENT_SERVER_VERSION_CHECK_ENABLED": "false",
    "PREFECT_CLOUD_ENABLE_ORCHESTRATION_TELEMETRY": "false",
    "PREFECT_TELEMETRY_ENABLE_RESOURCE_METRICS": "false",
    "PREFECT_LOGGING_LEVEL": "WARNING",
    "PREFECT_LOGGING_HANDLERS_CONSOLE_LEVEL": "CRITICAL",  # idic raises and reports each error once
    "PREFECT_LOGGING_HANDLERS_DEBUG_LEVEL": "CRITICAL",
}
_SERVER_ONLY = {  # services that a single run does not need: block types, schedules, automations
    "PREFECT__SERVER_FINAL": "1",
    "PREFECT_LOGGING_HANDLERS_CONSOLE_LEVEL": "WARNING",  # into the server's log file
    "PREFECT_API_BLOCKS_REGISTER_ON_START": "false",
    "PREFECT_SERVER_SERVICES_SCHEDULER_ENABLED": "false",
    "PREFECT_SERVER_SERVICES_LATE_RUNS_ENABLED": "false",
    "PREFECT_SERVER_SERVICES_FOREMAN_ENABLED": "false",
    "PREFECT_SERVER_SERVICES_PAUSE_EXPIRATIONS_ENABLED": "false",
    "PREFECT_SERVER_SERVICES_CANCELLATION_CLEANUP_ENABLED": "false",
    "PREFECT_SERVER_SERVICES_TRIGGERS_ENABLED": "false",
    "PREFECT_SERVER_LOGS_STREAM_OUT_ENABLED": "false",
    # states of tasks once a second together: one by one they are most of the work of the server
    "PREFECT_SERVER_SERVICES_TASK_RUN_RECORDER_BATCH_SIZE": "100",
    "PREFECT_SERVER_SERVICES_TASK_RUN_RECORDER_FLUSH_INTERVAL": "1",
}


_running: list[PrefectServer] = []  # servers of this process


class PrefectServer:
    """A server that is starting or running; get one from `start`.

    Attributes
    ----------
    url : str
        Address of its API.
    dashboard : str
        Address of its pages, for a browser.
    owned : bool
        False: the user configured it, or a caller in this process started it; `close` does not stop it.
    home : Path or None
        PREFECT_HOME of a server that idic started.
    password : str or None
        Of its API and its pages, ``user:key``, where idic started it.
    """

    def __init__(self, url: str, owned: bool):
        self.url, self.owned = url, owned
        self._process: subprocess.Popen | None = None
        self._changing = threading.Lock()  # held while a new server process replaces the old one
        self._watched = False
        self.home: Path | None = None
        self.password: str | None = None
        self._log: Path | None = None
        self._first_start: Any = None  # held while the server may be creating the shared database
        self._temporary: Path | None = None
        self._lender: PrefectServer | None = None

    @property
    def dashboard(self) -> str:
        return self.url.removesuffix("/api")

    def wait(self, seconds: float = START_SECONDS) -> str:
        """Return the API address as soon as the server answers; a configured server on another machine is not checked.

        Raises
        ------
        InputError
            The server does not answer in time; the message quotes the end of its log.
        """
        if not self.owned:
            return self._wait_for_configured()
        end = time.monotonic() + seconds
        while not _answers(self.url):
            if self._process.poll() is not None:
                if self._temporary is not None:
                    raise self._failure("it stopped while starting")
                self._restart_elsewhere()
            if time.monotonic() > end:
                raise self._failure(f"no answer within {seconds:g} s")
            time.sleep(0.05)
        self._release_first_start()
        if not self._watched:
            self._watched = True
            threading.Thread(target=self._replace_when_dead, args=(self._process,), daemon=True).start()
        return self.url

    def _wait_for_configured(self) -> str:
        if self._lender is not None:
            self.url = self._lender.wait()
            return self.url
        end = time.monotonic() + _CONFIGURED_SECONDS
        while self.url.startswith(f"http://{LOOPBACK}:") and not _answers(self.url):
            if time.monotonic() > end:
                raise InputError(
                    "the configured Prefect server does not answer",
                    key="PREFECT_API_URL",
                    expected=f"a server at {self.url}",
                    found="nothing",
                    remedy="start it (`prefect server start`), or remove the setting: the run then starts its own",
                )
            time.sleep(0.2)
        return self.url

    def close(self) -> None:
        """Stop the server if it is owned. Safe to call twice."""
        if self in _running:
            _running.remove(self)
        self._stop_process()
        self._release_first_start()
        if self._temporary is not None:
            shutil.rmtree(self._temporary, ignore_errors=True)
            self._temporary = None
        if self.owned and os.environ.get("PREFECT_API_URL") == self.url:
            del os.environ["PREFECT_API_URL"]
            os.environ.pop(PASSWORD, None)

    def __enter__(self) -> PrefectServer:
        return self

    def __exit__(self, *_) -> None:
        self.close()

    # starting -------------------------------------------------------------------------------------
    def _launch(self, home: Path, port: int | None = None) -> None:
        self.home = home
        home.mkdir(parents=True, exist_ok=True)
        port = port or _free_port()
        self.password = self.password or f"idic:{secrets.token_urlsafe(18)}"
        self._log = home / f"server-{port}.log"
        self.url = f"http://{LOOPBACK}:{port}/api"
        command = [sys.executable, parent_guard.__file__, "uvicorn", "--factory",
                   "idic_flows.server_app:create_app"]
        command += ["--host", LOOPBACK, "--port", str(port), "--log-level", "error", "--lifespan", "on"]
        command += ["--timeout-graceful-shutdown", "1"]
        with open(self._log, "ab") as log:
            self._process = subprocess.Popen(
                command, stdin=subprocess.PIPE, stdout=log, stderr=log,
                env=_server_environment(home, port, self.password), close_fds=True,
                cwd=empty_folder(),
            )
        os.environ["PREFECT_API_URL"] = self.url
        os.environ[PASSWORD] = self.password
        os.environ["PREFECT_HOME"] = str(home)

    def _replace_when_dead(self, process: subprocess.Popen) -> None:
        """Restart a server that dies during a run, at its address and with its database: the client of Prefect repeats
        its requests for a minute, and the run continues."""
        for _ in range(_MAX_RESTARTS):
            process.wait()
            with self._changing:
                if self._process is not process:  # it was stopped on purpose
                    return
                process.stdin.close()
                self._launch(self.home, int(self.url.removesuffix("/api").rpartition(":")[2]))
                process = self._process

    def _restart_elsewhere(self) -> None:
        """Start again with an empty database and another port: the shared database or the port may be unusable."""
        self._stop_process()
        self._release_first_start()
        self._temporary = Path(tempfile.mkdtemp(prefix="idic-prefect-"))
        self._launch(self._temporary)

    def _stop_process(self) -> None:
        with self._changing:
            process, self._process = self._process, None
        if process is None:
            return
        process.terminate()
        try:
            process.wait(_STOP_SECONDS)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        process.stdin.close()
        if self._log is not None and self._temporary is None:
            self._log.unlink(missing_ok=True)

    def _release_first_start(self) -> None:
        if self._first_start is not None:
            first_start, self._first_start = self._first_start, None
            first_start.__exit__(None, None, None)

    def _failure(self, reason: str) -> InputError:
        tail = self._log.read_text(errors="replace").strip().splitlines()[-5:] if self._log else []
        self.close()
        return InputError(
            "the Prefect server for this run did not start",
            expected=f"an answer from {self.url}",
            found="\n    ".join([reason, *tail]),
            remedy="start one yourself (`prefect server start`) and set PREFECT_API_URL to its address, "
            "or update the package: pip install --upgrade idic",
        )

    @classmethod
    def start(cls, environment=os.environ) -> PrefectServer:
        """Start a server in the background and return at once, or return a handle on the configured server.

        A server that this process started already is shared. ``PREFECT_API_URL`` in the environment then points to the
        server: import Prefect after this call, or use `idic_flows.settings.connected`.
        """
        for name, value in QUIET.items():
            environment.setdefault(name, value)
        _bypass_proxies(environment)
        url = configured_url(environment)
        if url is not None:
            return _borrowed(url)
        server = cls("", owned=True)
        _running.append(server)
        home = Path(environment["PREFECT_HOME"]) if environment.get("PREFECT_HOME") else _default_home()
        try:
            home.mkdir(parents=True, exist_ok=True)
            first_start = run_lock(home)
            first_start.__enter__()
        except (InputError, OSError):  # another run is creating the database, or the folder is not writable
            server._restart_elsewhere()
            return server
        server._first_start = first_start
        server._launch(home)
        return server


def _borrowed(url: str) -> PrefectServer:
    """A handle on a server that is started and stopped elsewhere."""
    server = PrefectServer(url, owned=False)
    server._lender = next((lender for lender in _running if lender.url == url), None)
    server.home = server._lender.home if server._lender else None
    server.password = server._lender.password if server._lender else os.environ.get(PASSWORD)
    return server


def configured_url(environment=os.environ) -> str | None:
    """The server configured by the environment or the active Prefect profile; else None."""
    if environment.get("PREFECT_API_URL"):
        return environment["PREFECT_API_URL"]
    home = Path(environment.get("PREFECT_HOME") or Path.home() / ".prefect")
    profiles = _toml(Path(environment.get("PREFECT_PROFILES_PATH") or home / "profiles.toml"))
    active = environment.get("PREFECT_PROFILE") or profiles.get("active")
    return profiles.get("profiles", {}).get(active, {}).get("PREFECT_API_URL")


def _default_home() -> Path:
    """One database per user and Prefect version, as its creation is the slowest part of the start."""
    return cache_folder() / f"prefect-{version('prefect')}"


def _server_environment(home: Path, port: int, password: str) -> dict[str, str]:
    unwanted = {"PREFECT_API_URL", "PREFECT_PROFILE", "PREFECT_API_KEY"}
    environment = {name: value for name, value in os.environ.items() if name not in unwanted}
    pages = ",".join(f"http://{host}:{port}" for host in (LOOPBACK, "localhost"))
    return {**environment, **QUIET, **_SERVER_ONLY, "PREFECT_HOME": str(home), PASSWORD: password,
            "PREFECT_SERVER_API_AUTH_STRING": password, "PREFECT_SERVER_CORS_ALLOWED_ORIGINS": pages}


def _bypass_proxies(environment) -> None:
    """Exempt this machine from the proxy settings."""
    for name in ("NO_PROXY", "no_proxy"):
        listed = [item for item in environment.get(name, "").split(",") if item]
        if LOOPBACK not in listed:
            environment[name] = ",".join([*listed, LOOPBACK, "localhost"])


def _answers(url: str) -> bool:
    host, port = url.removeprefix("http://").removesuffix("/api").split(":")
    connection = http.client.HTTPConnection(host, int(port), timeout=2.0)
    try:
        connection.request("GET", "/api/health")
        return connection.getresponse().status == 200
    except (OSError, http.client.HTTPException):
        return False
    finally:
        connection.close()


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind((LOOPBACK, 0))
        return probe.getsockname()[1]


def _toml(path: Path) -> dict:
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
