"""Prefect without a configured server: ours starts in the background, shows named tasks, and leaves nobody behind."""

import base64
import http.client
import http.server
import json
import os
import signal
import sqlite3
import subprocess
import sys
import textwrap
import threading
import time
from contextlib import closing
from pathlib import Path
from urllib.parse import urlsplit

import psutil
import pytest

from idic.errors import InputError
from idic.run import PASSWORD, PrefectServer, run_lock
from idic.run.workers import prefect_server
from idic.run import configured_url


@pytest.fixture(scope="module")
def cache(tmp_path_factory, _session_server):
    """A cache folder of its own, so that the tests leave the user's database alone. Creating one takes 9 s of CPU time:
    the database is a copy of that of the server that other tests share, whose first start has created it."""
    folder = tmp_path_factory.mktemp("cache")
    with pytest.MonkeyPatch.context() as patch:
        for name in ("XDG_CACHE_HOME", "LOCALAPPDATA"):
            patch.setenv(name, str(folder))
        patch.setenv("HOME", str(folder))
        home = prefect_server._default_home()
    home.mkdir(parents=True)
    with (closing(sqlite3.connect(Path(_session_server["PREFECT_HOME"]) / "prefect.db")) as source,
          closing(sqlite3.connect(home / "prefect.db")) as copy):
        source.backup(copy)
    return folder


@pytest.fixture
def unconfigured(monkeypatch, cache, tmp_path):
    """An environment in which nobody has configured Prefect."""
    for name in [name for name in os.environ if name.startswith("PREFECT_")]:
        monkeypatch.delenv(name)
    for name, value in {"XDG_CACHE_HOME": cache, "LOCALAPPDATA": cache, "HOME": tmp_path}.items():
        monkeypatch.setenv(name, str(value))
    for name in ("PREFECT_API_URL", "PREFECT_HOME", PASSWORD):  # PrefectServer.start sets them; monkeypatch takes back
        monkeypatch.setenv(name, "")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_a_flow_runs_against_our_server_and_its_tasks_have_names(unconfigured):
    started = time.monotonic()
    with PrefectServer.start() as server:
        assert time.monotonic() - started < 1.0  # s: it starts in the background, 0.1 s measured
        assert os.environ["PREFECT_API_URL"] == server.url and server.owned
        from example_flow import example
        from idic_flows.settings import connected

        with connected(server):
            assert example([1, 2, 3]) == [1, 4, 9]
            wanted = {"simulate it000", "frames it000", "step it000"}
            assert _wait_for_names(server, wanted) == wanted
        process = psutil.Process(server._process.pid)
    assert not process.is_running()
    assert "PREFECT_API_URL" not in os.environ and PASSWORD not in os.environ


def test_a_server_listens_on_the_loopback_interface_and_answers_its_own_run_only(unconfigured):
    """Neither other users of the machine, nor other web pages, nor pages whose name leads here; a second start shares
    it."""
    with PrefectServer.start() as server:
        server.wait()
        assert server.password == os.environ[PASSWORD] and len(server.password) > 20
        assert _ask(server).status == 200
        assert _ask(server, password=None).status == 401
        assert _ask(server, password="idic:guess").status == 401
        assert _ask(server, Host="evil.example").status == 400
        strange, own = (_ask(server, Origin=page).getheader("Access-Control-Allow-Origin")
                        for page in ("https://evil.example", server.dashboard))
        assert strange is None and own == server.dashboard
        with PrefectServer.start() as late:
            assert not late.owned and late.wait() == server.url and late.home == server.home
        assert server.wait() == server.url  # it still answers
        connections = psutil.Process(server._process.pid).net_connections("tcp")
        assert {c.laddr.ip for c in connections if c.status == psutil.CONN_LISTEN} == {"127.0.0.1"}


@pytest.mark.slow  # two starts of a server
def test_every_server_has_a_password_of_its_own(unconfigured):
    passwords = []
    for _ in range(2):
        with PrefectServer.start() as server:
            passwords.append(server.password)
    assert len(set(passwords)) == 2


@pytest.mark.parametrize("password, found", [(None, "none"), ("idic:guess", "another one")])
def test_a_configured_server_that_refuses_the_password_is_bad_input_and_no_bug(unconfigured, monkeypatch, password,
                                                                              found):
    class Closed(http.server.BaseHTTPRequestHandler):
        def do_GET(self):
            self.send_response(200 if self.path.endswith("/health") else 401)
            self.send_header("content-length", "2")
            self.end_headers()
            self.wfile.write(b"{}")

        do_POST = do_GET

        def log_message(self, *_):
            pass

    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), Closed) as closed:
        threading.Thread(target=closed.serve_forever, daemon=True).start()
        monkeypatch.setenv("PREFECT_API_URL", f"http://127.0.0.1:{closed.server_port}/api")
        if password:
            monkeypatch.setenv(PASSWORD, password)
        with PrefectServer.start() as server:
            from idic_flows.settings import connected
            from prefect.client.orchestration import get_client

            with (pytest.raises(InputError, match=f"(?s){PASSWORD}.*found: {found}"), connected(server),
                  get_client(sync_client=True) as client):
                client.read_flow_runs()
        closed.shutdown()


def test_an_error_inside_a_flow_is_said_once_and_by_us(shared_server):
    code = """
        from idic.run.workers.prefect_server import PrefectServer
        from idic.errors import InputError
        with PrefectServer.start() as server:
            from idic_flows.settings import connected
            with connected(server):
                from prefect import flow, task
                @task
                def refuse():
                    raise InputError("odd")
                @flow
                def run():
                    refuse()
                try:
                    run()
                except InputError:
                    print("raised")
    """
    answer = subprocess.run([sys.executable, "-c", textwrap.dedent(code)], capture_output=True, text=True, timeout=120)
    assert (answer.stdout, answer.stderr) == ("raised\n", "")


def test_while_another_run_creates_the_shared_database_ours_has_its_own(unconfigured):
    home = prefect_server._default_home()
    with run_lock(home), PrefectServer.start() as server:
        assert server.home != home
        temporary = server.home
    assert not temporary.exists()


@pytest.mark.slow  # two starts, one of them with a new database
def test_a_damaged_database_costs_a_second_attempt_not_the_run(unconfigured, monkeypatch, tmp_path):
    monkeypatch.setenv("PREFECT_HOME", str(tmp_path / "home"))
    (tmp_path / "home").mkdir()
    (tmp_path / "home" / "prefect.db").write_bytes(b"no database " * 100)
    with PrefectServer.start() as server:
        server.wait()
        temporary = server.home
        assert temporary != tmp_path / "home"
    assert not temporary.exists()


def test_a_server_that_does_not_answer_is_said(unconfigured):
    server = PrefectServer.start()
    with pytest.raises(InputError, match="did not start") as problem:
        server.wait(seconds=0.0)
    assert "PREFECT_API_URL" in problem.value.remedy
    assert server._process is None


@pytest.mark.skipif(os.name != "posix", reason="sends SIGKILL")
def test_the_server_ends_when_its_driver_is_killed(unconfigured):
    code = """
        from idic.run.workers.prefect_server import PrefectServer
        server = PrefectServer.start()
        server.wait()
        print(server._process.pid, flush=True)
        import time; time.sleep(60)
    """
    driver = subprocess.Popen([sys.executable, "-c", textwrap.dedent(code)], stdout=subprocess.PIPE, text=True)
    try:
        server = psutil.Process(int(driver.stdout.readline()))
        children = server.children(recursive=True)
    finally:
        os.kill(driver.pid, signal.SIGKILL)
    driver.communicate(timeout=10)  # nobody keeps the pipe open
    _, alive = psutil.wait_procs([server, *children], timeout=10)
    assert not [process for process in alive if process.status() != psutil.STATUS_ZOMBIE]  # dead, but not yet collected


@pytest.mark.slow  # two starts of a server
def test_a_server_that_dies_gets_a_successor_at_its_address(unconfigured):
    with PrefectServer.start() as server:
        url, first = server.wait(), server._process
        os.kill(first.pid, signal.SIGKILL)
        first.wait()
        end = time.monotonic() + prefect_server.START_SECONDS
        while server._process is first and time.monotonic() < end:
            time.sleep(0.05)
        assert server.wait() == url
        second = psutil.Process(server._process.pid)
    _, alive = psutil.wait_procs([second], timeout=10)
    assert not alive, "close() ends the successor, and nobody starts a third"


# a server that the user chose ---------------------------------------------------------------------
def test_a_server_in_the_environment_is_used_and_left_running(unconfigured, monkeypatch):
    monkeypatch.setenv("PREFECT_API_URL", "https://prefect.lab.example/api")
    with PrefectServer.start() as server:
        assert not server.owned and server.wait() == "https://prefect.lab.example/api"
        assert server.dashboard == "https://prefect.lab.example"
    assert os.environ["PREFECT_API_URL"] == "https://prefect.lab.example/api"


def test_a_configured_server_that_is_dead_is_said(unconfigured, monkeypatch):
    monkeypatch.setenv("PREFECT_API_URL", "http://127.0.0.1:1/api")
    monkeypatch.setattr(prefect_server, "_CONFIGURED_SECONDS", 0.1)
    with PrefectServer.start() as server, pytest.raises(InputError, match="does not answer"):
        server.wait()


def test_a_server_in_the_active_profile_is_used(tmp_path):
    profiles = 'active = "lab"\n[profiles.lab]\nPREFECT_API_URL = "https://lab/api"\n[profiles.other]\n'
    (tmp_path / "profiles.toml").write_text(profiles)
    assert configured_url({"PREFECT_HOME": str(tmp_path)}) == "https://lab/api"
    assert configured_url({"PREFECT_HOME": str(tmp_path), "PREFECT_PROFILE": "other"}) is None


def _ask(server, password="", **headers):
    """The answer to a question for the names of the task runs; password : None asks without one."""
    address = urlsplit(server.url)
    if password is not None:
        known = base64.b64encode((password or server.password).encode()).decode()
        headers["Authorization"] = f"Basic {known}"
    connection = http.client.HTTPConnection(address.hostname, address.port, timeout=10)
    connection.request("POST", f"{address.path}/task_runs/filter", "{}",
                       {"Content-Type": "application/json", **headers})
    answer = connection.getresponse()
    answer.content = answer.read()
    connection.close()
    return answer


def _wait_for_names(server, wanted):
    """Names of the task runs that the server knows, waiting for events that are still on their way (names follow)."""
    end = time.monotonic() + 20
    while True:
        names = {run["name"] for run in json.loads(_ask(server).content)}
        if names == wanted or time.monotonic() > end:
            return names
        time.sleep(0.1)
