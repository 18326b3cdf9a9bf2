"""Nobody is reached and nobody is let in, unless the user says so: keys, telemetry, where a whole run connects to."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest
from one_thread import ONE_THREAD

from idic.errors import InputError
from idic.virtual_tests import write_example
from idic.run import PrefectServer, open_cluster
from idic.run.workers.dask_connection import check_client_key
from idic.run.workers.prefect_server import QUIET, _server_environment

posix = pytest.mark.skipif(os.name != "posix", reason="no such rights on this system")
SPY = '''
import json, os, sys

def watch(event, arguments):
    if event in ("socket.connect", "socket.sendto") and isinstance(arguments[1], tuple):
        with open(os.environ["IDIC_TEST_SPY"], "a") as file:
            file.write(json.dumps([event, str(arguments[1][0]), os.getpid()]) + "\\n")
    elif event == "socket.bind" and isinstance(arguments[1], tuple):
        with open(os.environ["IDIC_TEST_SPY"], "a") as file:
            file.write(json.dumps([event, str(arguments[1][0]), os.getpid()]) + "\\n")

sys.addaudithook(watch)
'''


# keys -----------------------------------------------------------------------------------------------
@pytest.fixture
def key(tmp_path):
    file = tmp_path / "key.pem"
    file.write_text("-----BEGIN PRIVATE KEY-----")
    return file


@posix
@pytest.mark.parametrize("mode", [0o644, 0o604, 0o666, 0o660, 0o602])
def test_a_private_key_that_others_can_read_or_change_is_refused(key, mode):
    key.chmod(mode)
    with pytest.raises(InputError, match="others can read") as problem:
        check_client_key({"client": {"key": str(key)}})
    assert "chmod 600" in problem.value.remedy


@posix
@pytest.mark.parametrize("mode", [0o600, 0o400])
def test_a_private_key_with_safe_permissions_is_accepted(key, mode):
    key.chmod(mode)
    check_client_key({"client": {"key": str(key)}})


@posix
@pytest.mark.skipif(os.name == "posix" and os.getuid() != 0, reason="only root can give files away")
def test_the_group_may_read_a_key_of_roots_but_not_one_of_the_users(key):
    """Secrets that containers and clusters mount belong to root, and the group is the reader's."""
    key.chmod(0o640)
    check_client_key({"client": {"key": str(key)}})
    os.chown(key, 10001, 10001)
    with pytest.raises(InputError, match="others can read"):
        check_client_key({"client": {"key": str(key)}})


def test_a_missing_key_file_is_reported_and_no_key_is_accepted(tmp_path):
    with pytest.raises(InputError, match="cannot be read"):
        check_client_key({"client": {"key": str(tmp_path / "none.pem")}})
    check_client_key({})
    check_client_key({"client": {"key": None}})


@posix
def test_the_key_is_looked_at_before_anybody_is_called(key, monkeypatch):
    import dask
    import distributed  # noqa: F401 (its defaults, before they are covered: they would go with the cover)

    key.chmod(0o644)
    with dask.config.set({"distributed.comm.tls.client.key": str(key)}):
        with pytest.raises(InputError, match="others can read"), open_cluster(scheduler="tls://127.0.0.1:1"):
            pass


# telemetry ------------------------------------------------------------------------------------------
OFF = {"DO_NOT_TRACK": "1", "PREFECT_SERVER_ANALYTICS_ENABLED": "false",
       "PREFECT_CLIENT_SERVER_VERSION_CHECK_ENABLED": "false",
       "PREFECT_CLOUD_ENABLE_ORCHESTRATION_TELEMETRY": "false", "PREFECT_TELEMETRY_ENABLE_RESOURCE_METRICS": "false"}


def test_the_telemetry_of_prefect_is_off_for_driver_and_server(tmp_path):
    environment = {"PREFECT_API_URL": "https://prefect.lab.example/api"}
    PrefectServer.start(environment)  # a configured one: nothing is started
    assert {name: environment.get(name) for name in OFF} == OFF
    assert {name: _server_environment(tmp_path, 4200, "user:key").get(name) for name in OFF} == OFF
    assert OFF.items() <= QUIET.items()


def test_prefect_understands_these_settings():
    """A setting that it no longer knows would do nothing, silently."""
    code = ("from prefect.settings import get_current_settings as s; c = s(); "
            "print(c.server.analytics_enabled, c.client.server_version_check_enabled, "
            "c.cloud.enable_orchestration_telemetry, c.telemetry.enable_resource_metrics)")
    answer = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=dict(os.environ) | OFF)
    assert answer.stdout.split() == ["False"] * 4, answer.stderr


@pytest.mark.slow
def test_a_whole_run_connects_to_this_machine_only_and_listens_there_only(tmp_path):
    """Driver, workers and Prefect server, each with a hook on every connection that its Python makes."""
    (tmp_path / "spy").mkdir()
    (tmp_path / "spy" / "sitecustomize.py").write_text(SPY)
    write_example("demo", tmp_path / "test", reduced=True)
    environment = dict(os.environ) | ONE_THREAD | {
        "PYTHONPATH": os.pathsep.join([str(tmp_path / "spy"), os.environ.get("PYTHONPATH", "")]),
        "IDIC_TEST_SPY": str(tmp_path / "connections.txt")}
    for name in [name for name in environment if name.startswith("PREFECT_")]:
        del environment[name]
    answer = subprocess.run([sys.executable, "-m", "idic", "identify", tmp_path / "test", "--out", tmp_path / "run",
                             "--prefect", "--workers", "1"], env=environment, capture_output=True, text=True,
                            timeout=900)
    assert answer.returncode == 0, answer.stderr
    seen = [json.loads(line) for line in (tmp_path / "connections.txt").read_text().splitlines()]
    assert len({process for _, _, process in seen}) >= 3, "driver, worker and server"
    assert {host for event, host, _ in seen if event == "socket.bind"} <= {"127.0.0.1", "localhost", "::1"}
    assert {host for event, host, _ in seen if event != "socket.bind"} <= {"127.0.0.1", "localhost", "::1"}
