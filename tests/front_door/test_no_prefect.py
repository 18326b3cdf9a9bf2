"""`--no-prefect`: the same bits without a server, and no library of servers is loaded for a small run."""

import json
import subprocess
import sys
import textwrap

import numpy as np
import pytest
import zarr
from typer.testing import CliRunner

from idic.cli.app import app
from idic.store.layout import DESCRIPTION
from idic.virtual_tests.examples import write_example

pytestmark = pytest.mark.usefixtures("shared_server")
WITHOUT = """
    import sys
    from idic.cli import main
    sys.argv = ["idic", *sys.argv[1:]]
    try:
        main()
    finally:
        print("loaded:", sorted(name for name in ("prefect", "distributed", "fastapi") if name in sys.modules))
"""


def started(*arguments):
    """The command in a process of its own; what it prints ends with the servers' libraries that it has loaded."""
    return subprocess.run([sys.executable, "-c", textwrap.dedent(WITHOUT), *map(str, arguments)], capture_output=True,
                          text=True, timeout=300)


def numbers(result):
    """What does not depend on the clock or the machine."""
    return {key: value for key, value in result.items() if key not in ("cost", "sha256")}


@pytest.fixture(scope="module")
def strip(tmp_path_factory):
    folder = tmp_path_factory.mktemp("no_prefect")
    write_example("demo", folder / "test", reduced=True, seed=3)
    return folder


@pytest.fixture(scope="module")
def plain(strip):
    answer = started("identify", strip / "test", "--out", strip / "plain", "--no-prefect")
    assert answer.returncode == 0, answer.stderr
    return strip / "plain", answer


def test_a_small_identification_loads_no_server_and_no_cluster(plain):
    run, answer = plain
    assert answer.stdout.splitlines()[-1] == "loaded: []"
    assert (run / "report.html").exists()
    assert "dashboard" not in answer.stderr


def test_it_gives_the_bits_of_the_flow(strip, plain):
    run, _ = plain
    answer = CliRunner().invoke(app, ["identify", str(strip / "test"), "--out", str(strip / "flow"), "--workers", "0"])
    assert answer.exit_code == 0, answer.stderr
    without, with_flow = (json.loads((folder / "result.json").read_text()) for folder in (run, strip / "flow"))
    assert numbers(without) == numbers(with_flow)
    one, other = (zarr.open_group(folder / "run.zarr", mode="r") for folder in (run, strip / "flow"))
    arrays = dict(one.members(max_depth=None))
    assert arrays.keys() == dict(other.members(max_depth=None)).keys()
    for name, array in arrays.items():
        if isinstance(array, zarr.Array):
            assert np.array_equal(array[...], other[name][...], equal_nan=array.dtype.kind == "f"), name


def test_it_resumes_a_run_of_the_flow_and_refuses_an_earlier_run(strip, plain):
    run, _ = plain
    refused = started("identify", strip / "test", "--out", run, "--no-prefect")
    assert refused.returncode == 2 and "--resume" in refused.stderr
    again = started("identify", strip / "test", "--out", run, "--no-prefect", "--resume")
    assert again.returncode == 0 and (run / DESCRIPTION).exists()


def test_a_diagnosis_without_prefect_loads_no_server(plain):
    run, _ = plain
    answer = started("diagnose", run, "--no-prefect", "--workers", "0")
    assert answer.returncode == 0, answer.stderr
    assert answer.stdout.splitlines()[-1] == "loaded: []"
    assert json.loads((run / "diagnosis.json").read_text())["verdict"] == "none"
