"""`--no-prefect`: the same bits without a server, and no library of servers is loaded for a small run."""

import json
import subprocess
import sys
import textwrap

import numpy as np
import pytest
import zarr
from typer.testing import CliRunner
from virtual_tests.small_strip import write_small_strip

from idic.cli.app import app
from idic.experiment_file import load_experiment
from idic.report import expected_cost
from idic.run import Workplace

pytestmark = pytest.mark.usefixtures("shared_server")
# what an identification begins without: the methods of SciPy load where they are used, files of few experiments where
# they are read, and the end of a run where it is reached
LATE = ("scipy.interpolate", "scipy.io", "scipy.ndimage", "scipy.optimize", "scipy.spatial", "scipy.special", "h5py",
        "meshio", "cv2", "matplotlib", "pandas", "xarray", "jinja2", "dask", "idic.run.joint_result",
        "idic.run.postprocess", "idic.report.result.record")
WITHOUT = """
    import sys
    from idic.cli import main
    import idic.run.identify

    print("too soon:", [name for name in {late!r} if name in sys.modules])

    def command(*words):
        sys.argv = ["idic", *words, "--no-prefect"]
        try:
            main()
        except SystemExit as end:
            print("code:", end.code)
        print("loaded:", sorted(name for name in ("prefect", "distributed", "fastapi") if name in sys.modules))

    command(*sys.argv[1:])
"""


def numbers(result):
    """What does not depend on the clock or the machine."""
    return {key: value for key, value in result.items() if key not in ("cost", "sha256")}


@pytest.fixture(scope="module")
def strip(tmp_path_factory):
    folder = tmp_path_factory.mktemp("no_prefect")
    write_small_strip(folder / "test")
    return folder


def without_prefect(*arguments):
    """A command in another process: first and last lines of what it printed, and what it said meanwhile."""
    words = [textwrap.dedent(WITHOUT).replace("{late!r}", repr(LATE)), *map(str, arguments)]
    answer = subprocess.run([sys.executable, "-c", *words], capture_output=True, text=True, timeout=900)
    assert answer.returncode == 0, answer.stderr
    lines = answer.stdout.splitlines()
    return [lines[0], *lines[-2:]], answer.stderr


@pytest.fixture(scope="module")
def plain(strip):
    """The RUN of an identification, lines of what it printed, and what it said meanwhile."""
    return strip / "plain", *without_prefect("identify", strip / "test", "--out", strip / "plain")


def here(*arguments):
    return CliRunner().invoke(app, list(map(str, arguments)))


def test_a_small_identification_loads_no_server_and_no_cluster(plain):
    run, printed, said = plain
    assert printed == ["too soon: []", "code: 0", "loaded: []"], said
    assert (run / "report.html").exists()
    assert "dashboard" not in said


@pytest.mark.slow  # a whole diagnosis; the one of diagnose/test_diagnosis_runs.py has a server and a worker
def test_a_small_diagnosis_loads_no_server_and_no_cluster(plain):
    printed, said = without_prefect("diagnose", plain[0], "--workers", "0")
    assert printed[1:] == ["code: 0", "loaded: []"], said
    assert json.loads((plain[0] / "diagnosis.json").read_text())["verdict"] == "none"


def test_it_gives_the_bits_of_the_flow(strip, plain):
    run, *_ = plain
    answer = here("identify", strip / "test", "--out", strip / "flow", "--no-report")
    assert answer.exit_code == 0, answer.stderr
    assert "report" not in answer.stdout + answer.stderr and not (strip / "flow" / "report.html").exists()
    without, with_flow = (json.loads((folder / "result.json").read_text()) for folder in (run, strip / "flow"))
    assert numbers(without) == numbers(with_flow)
    one, other = (zarr.open_group(folder / "run.zarr", mode="r") for folder in (run, strip / "flow"))
    arrays = dict(one.members(max_depth=None))
    assert arrays.keys() == dict(other.members(max_depth=None)).keys()
    for name, array in arrays.items():
        if isinstance(array, zarr.Array):
            assert np.array_equal(array[...], other[name][...], equal_nan=array.dtype.kind == "f"), name


def test_a_small_identification_has_worker_processes_only_where_the_user_names_them(strip):
    worth_workers = expected_cost(load_experiment(strip / "test")).worth_workers
    assert Workplace().worthwhile(worth_workers).workers == 0
    assert Workplace(2).worthwhile(worth_workers).workers == 2
    assert Workplace(memory_limit="2GB").worthwhile(worth_workers).workers is None  # of each worker: one per core


def test_it_refuses_an_earlier_run_and_resumes_it_where_that_is_asked(strip, plain):
    run, *_ = plain
    refused = here("identify", strip / "test", "--out", run, "--no-prefect")
    assert refused.exit_code == 2 and "--resume" in refused.stderr
    again = here("identify", strip / "test", "--out", run, "--no-prefect", "--resume", "--no-report")
    assert again.exit_code == 0 and (run / "run.json").exists()
