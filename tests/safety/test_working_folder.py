"""Nothing in the folder where a command is started is a program or a setting for it."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from virtual_tests.small_strip import write_small_strip

from idic.virtual_tests import write_example
from idic.run.workers import working_folder
from idic.run import empty_folder, in_empty_folder

SERVER = """
from idic.run.workers.prefect_server import PrefectServer
with PrefectServer.start() as server:
    print(server.wait())
"""


def start(folder, *arguments, own_server=False):
    """A Python program in a folder, where no Prefect is configured if it has `own_server`."""
    environment = {name: value for name, value in os.environ.items()
                   if not (own_server and name in ("PREFECT_API_URL", "PREFECT_API_AUTH_STRING"))}
    return subprocess.run([sys.executable, *map(str, arguments)], cwd=folder, env=environment, capture_output=True,
                          text=True, timeout=300)


@pytest.mark.parametrize("code, mark", [
    ("from prefect.logging.configuration import setup_logging; setup_logging()", "prefect_env"),
    ("import os; from numba.core import config; os.mkdir(config.CACHE_DIR)", "numba")])
def test_the_folder_would_do_harm(hostile_folder, code, mark):
    """As long as this passes, the tests below see something."""
    folder, marks = hostile_folder
    started = subprocess.run([sys.executable, "-P", "-c", code], cwd=folder, capture_output=True, timeout=60)
    assert (marks / mark).is_dir(), started.stderr
    (marks / mark).rmdir()


def test_a_command_obeys_no_file_of_its_working_folder(hostile_folder, tmp_path):
    folder, marks = hostile_folder
    write_small_strip(tmp_path / "test")
    relative = os.path.relpath(tmp_path / "test", folder)
    answer = start(folder, "-m", "idic", "check", relative, "--out", "mesh.png")
    assert answer.returncode == 0, answer.stderr
    assert answer.stdout.splitlines()[-1] == "picture      mesh.png" and (folder / "mesh.png").is_file()
    assert not list(marks.iterdir()) and "evil" not in answer.stderr


def test_a_server_obeys_no_file_of_the_working_folder(hostile_folder):
    folder, marks = hostile_folder
    answer = start(folder, "-P", "-c", SERVER, own_server=True)
    assert answer.returncode == 0 and "127.0.0.1" in answer.stdout, answer.stderr
    assert not list(marks.iterdir())


@pytest.mark.slow  # a whole identification, 40 s of CPU time
def test_an_identification_obeys_no_file_of_the_working_folder(hostile_folder, tmp_path):
    folder, marks = hostile_folder
    write_example("demo", tmp_path / "test", reduced=True)
    answer = start(folder, "-m", "idic", "identify", tmp_path / "test", "--out", tmp_path / "run", "--workers", "1",
                   "--prefect", own_server=True)
    assert answer.returncode == 0, answer.stderr
    assert not list(marks.iterdir()) and "evil" not in answer.stderr


def test_relative_paths_of_the_environment_begin_where_the_user_is(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    environment = {"IDIC_LAWS": os.pathsep.join(["mine.py", "/far/theirs.py"]), "MPLCONFIGDIR": "settings",
                   "PATH": "bin"}
    with in_empty_folder(environment) as began:
        assert began == tmp_path and not list(Path.cwd().iterdir())
    assert Path.cwd() == tmp_path
    assert environment == {"IDIC_LAWS": os.pathsep.join([str(tmp_path / "mine.py"), "/far/theirs.py"]),
                           "MPLCONFIGDIR": str(tmp_path / "settings"), "PATH": "bin"}


def test_a_folder_that_is_not_empty_is_not_taken(tmp_path, monkeypatch):
    monkeypatch.setattr(working_folder, "cache_folder", lambda: tmp_path)
    first = empty_folder()
    assert first == tmp_path / "empty" == empty_folder()
    (first / "prefect.toml").touch()
    other = empty_folder()
    assert other != first and not list(other.iterdir())
    other.rmdir()


@pytest.mark.skipif(os.name != "posix", reason="permissions of POSIX")
def test_a_folder_in_which_others_may_write_is_not_taken(tmp_path, monkeypatch):
    monkeypatch.setattr(working_folder, "cache_folder", lambda: tmp_path)
    (tmp_path / "empty").mkdir()
    (tmp_path / "empty").chmod(0o777)
    other = empty_folder()
    assert other != tmp_path / "empty"
    other.rmdir()


def test_a_worker_keeps_the_path_of_the_command():
    """Worker processes load the module of the command once more."""
    code = "import sys; sys.path.insert(0, '/mine'); import idic.__main__; print(sys.path[0])"
    answer = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert answer.stdout.strip() == "/mine", answer.stderr
