"""What all tests share: where the public data lies, and the order of the files."""

from __future__ import annotations

import gc
import json
import os
import signal
import time
from contextlib import contextmanager
from pathlib import Path

import psutil
import pytest
import typer.main
import typer.testing
from threadpoolctl import threadpool_limits

# the background jobs of a shell ignore Ctrl-C, and so would every process that a test starts and interrupts
signal.signal(signal.SIGINT, signal.default_int_handler)

# one thread for each process: the workers of pytest-xdist share the cores, and threads of linear algebra would wait
# for one another; a plugin may have imported NumPy already, so that this process is told, too
for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ.setdefault(name, "1")
threadpool_limits(1)

# the processes that tests start keep the bytecode of the package: without it each compiles 500 modules, 1.5 s
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

# The files of the longest tests, in the order of their start, so that none of them is left to one process at the end.
# The first process begins with what needs no kernel (a server), while the second compiles those of most runs.
# One file of laws only: it compiles them all, and those that come in the middle of the session find them on the disk.
FIRST = ("workers/test_prefect_server.py", "faults/test_resume.py", "faults/test_damage.py",
         "workers/test_dask_executor.py", "laws/test_law_contract.py", "identify/test_imperfect_records.py",
         "diagnose/test_diagnosis_runs.py", "run/test_flow.py", "front_door/test_no_prefect.py",
         "laws/test_user_laws.py", "front_door/test_story.py", "external/test_faults.py",
         "twins/test_joint_experiments.py", "identify/test_loop.py", "front_door/test_commands.py",
         "experiment_file/test_init_and_check.py", "identify/test_parallel_steps.py", "diagnose/test_refits.py",
         "workers/test_without_common_disk.py", "equality/test_equality.py", "trial/test_real_thickness.py",
         "volumes/test_volume_equations.py", "twins/test_stereo.py", "twins/test_standard_deviations.py")
ROOT = Path(__file__).parent


def pytest_configure(config):
    """pytest-xdist sorts files by the number of their tests; the order of `FIRST` stays instead."""
    if hasattr(config.option, "loadscopereorder"):
        config.option.loadscopereorder = False


def pytest_collection_modifyitems(items):
    place = {ROOT / name: number for number, name in enumerate(FIRST)}
    items.sort(key=lambda item: place.get(item.path, len(FIRST)))


def pytest_collection_finish():
    """Thousands of collected tests stay until the end: the search for cyclic garbage leaves them out, and comes less
    often. It took 8 % of the time of the tests of the report alone."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(50_000, 20, 20)
    typer.main.get_command = typer.testing._get_command = _kept(typer.main.get_command)


def _kept(build):
    """The commands of `idic` are built from their functions once, not anew for each of a thousand tests (30 ms); again
    where more have been registered."""
    known = {}

    def get_command(program):
        size = len(program.registered_commands), len(program.registered_groups)
        if size == (1, 0):  # of a test's own
            return build(program)
        if (program, size) not in known:
            known[program, size] = build(program)
        return known[program, size]

    return get_command


@pytest.fixture(scope="session")
def shared_data():
    """A function: the path of a data set, or a skip with the reason where it is absent."""
    root = Path(os.environ.get("IDIC_SHARED_DATA", Path(__file__).resolve().parents[2] / "shared" / "data"))

    def path(name: str) -> Path:
        if not (root / name).exists():
            pytest.skip(f"no data set {name} in {root} (set IDIC_SHARED_DATA)")
        return root / name

    return path


@pytest.fixture(scope="module", autouse=True)
def _no_wait_for_the_disk(request):
    """What is written in this process is not synchronised, which is a third of the time of a small identification.
    Power cuts are tested in faults/ and store/, and every command in a process of its own synchronises."""
    with pytest.MonkeyPatch.context() as patch:
        if request.path.relative_to(ROOT).parts[0] not in ("faults", "store"):
            patch.setattr(os, "fsync", lambda descriptor: None)
        yield


@pytest.fixture(scope="session")
def session_folder(tmp_path_factory):
    """The folder that all processes of pytest-xdist share."""
    base = tmp_path_factory.getbasetemp()
    return base.parent if "PYTEST_XDIST_WORKER" in os.environ else base


@pytest.fixture(scope="module")
def gallery(session_folder):
    """A function: kind of `gallery.KINDS` -> its finished RUN, read only; `FinishedRun.copied` gives one to change."""
    from gallery import opened

    with opened(session_folder / "gallery", _held) as finished:
        yield finished


@pytest.fixture(scope="session")
def _session_server(session_folder):
    """What a Prefect server sets in the environment of those that use it; the processes of pytest-xdist share one."""
    folder = session_folder / "prefect"
    (folder / "users").mkdir(parents=True, exist_ok=True)
    settings, own, server = folder / "settings.json", folder / "users" / str(os.getpid()), None
    own.touch()
    with _held(folder):
        if not settings.exists():
            server = _start_session_server(folder, settings)
    yield json.loads(settings.read_text())
    own.unlink()
    if server is not None:
        while any(psutil.pid_exists(int(user.name)) for user in (folder / "users").iterdir()):
            time.sleep(0.1)
        server.close()


@contextmanager
def _held(folder):
    """The lock of a folder, as soon as it is free."""
    from idic.errors import InputError
    from idic.run import run_lock

    while True:
        lock = run_lock(folder)
        try:
            lock.__enter__()
            break
        except InputError:
            time.sleep(0.1)
    try:
        yield
    finally:
        lock.__exit__(None, None, None)


def _start_session_server(folder, settings):
    """A server whose home is the folder; what it sets is written as JSON."""
    from idic.run import PrefectServer

    before = dict(os.environ)
    try:
        for variable in [variable for variable in before if variable.startswith("PREFECT_")]:
            del os.environ[variable]
        os.environ["PREFECT_HOME"] = str(folder / "home")
        server = PrefectServer.start()
        server.wait()
        set_by_it = {name: value for name, value in os.environ.items() if name.startswith("PREFECT_")}
        settings.write_text(json.dumps(set_by_it))
    finally:
        os.environ.clear()
        os.environ.update(before)
    return server


@pytest.fixture(scope="module")
def shared_server(_session_server):
    """The commands of this module use one Prefect server, as they do where the user has configured one: its start takes
    longer than their runs. What a command does with a server of its own is seen in faults/, workers/ and run/."""
    with pytest.MonkeyPatch.context() as patch:
        for variable, value in _session_server.items():
            patch.setenv(variable, value)
        yield


@pytest.fixture(scope="session")
def hostile_folder(tmp_path_factory):
    """A folder whose files are programs and settings for those who work in it, and the marks that they would leave.

    What each of them does today is seen in tests/safety/test_working_folder.py.
    """
    folder, marks = tmp_path_factory.mktemp("hostile"), tmp_path_factory.mktemp("marks")
    logging = {"version": 1, "handlers": {"evil": {"()": "os.mkdir", "path": str(marks / "NAME")}},
               "root": {"handlers": ["evil"]}}
    for name in ("toml", "env"):
        (folder / f"{name}.yml").write_text(json.dumps(logging).replace("NAME", f"prefect_{name}"))
    (folder / "prefect.toml").write_text(f'[logging]\nconfig_path = "{folder / "toml.yml"}"\n')
    (folder / ".env").write_text(f"PREFECT_LOGGING_CONFIG_PATH={folder / 'env.yml'}\n")
    (folder / ".numba_config.yaml").write_text(f"cache_dir: {marks / 'numba'}\n")
    (folder / "matplotlibrc").write_text("evil.setting: 1\n")  # Matplotlib complains about what it does not know
    for module in ("numba", "yaml", "json", "prefect", "distributed", "idic_flows", "sitecustomize"):
        (folder / f"{module}.py").write_text(f"import os\nos.mkdir({str(marks / module)!r})\n")
    return folder, marks
