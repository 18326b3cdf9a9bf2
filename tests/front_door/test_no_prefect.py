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
from idic.store.layout import DESCRIPTION

pytestmark = pytest.mark.usefixtures("shared_server")
WITHOUT = """
    import sys
    from idic.cli import main

    def command(*words):
        sys.argv = ["idic", *words, "--no-prefect"]
        try:
            main()
        except SystemExit as end:
            print("code:", end.code)
        print("loaded:", sorted(name for name in ("prefect", "distributed", "fastapi") if name in sys.modules))

    test, run = sys.argv[1:]
    command("identify", test, "--out", run)
    command("diagnose", run, "--workers", "0")
"""


def numbers(result):
    """What does not depend on the clock or the machine."""
    return {key: value for key, value in result.items() if key not in ("cost", "sha256")}


@pytest.fixture(scope="module")
def strip(tmp_path_factory):
    folder = tmp_path_factory.mktemp("no_prefect")
    write_small_strip(folder / "test")
    return folder


@pytest.fixture(scope="module")
def plain(strip):
    """Identification and diagnosis in one other process: the RUN, what they printed and what they said meanwhile."""
    arguments = [textwrap.dedent(WITHOUT), str(strip / "test"), str(strip / "plain")]
    answer = subprocess.run([sys.executable, "-c", *arguments], capture_output=True, text=True, timeout=900)
    assert answer.returncode == 0, answer.stderr
    return strip / "plain", answer.stdout.splitlines(), answer.stderr


def here(*arguments):
    return CliRunner().invoke(app, list(map(str, arguments)))


def test_a_small_identification_and_its_diagnosis_load_no_server_and_no_cluster(plain):
    run, printed, said = plain
    assert [line for line in printed if line.startswith(("code: ", "loaded: "))] == ["code: 0", "loaded: []"] * 2, said
    assert (run / "report.html").exists()
    assert "dashboard" not in said
    assert json.loads((run / "diagnosis.json").read_text())["verdict"] == "none"


def test_it_gives_the_bits_of_the_flow(strip, plain):
    run, *_ = plain
    answer = here("identify", strip / "test", "--out", strip / "flow", "--workers", "0", "--no-report")
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


def test_it_refuses_an_earlier_run_and_resumes_it_where_that_is_asked(strip, plain):
    run, *_ = plain
    refused = here("identify", strip / "test", "--out", run, "--no-prefect")
    assert refused.exit_code == 2 and "--resume" in refused.stderr
    again = here("identify", strip / "test", "--out", run, "--no-prefect", "--resume", "--no-report")
    assert again.exit_code == 0 and (run / DESCRIPTION).exists()
