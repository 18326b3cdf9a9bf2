"""A RUN that another version of idic made is refused by one message; nothing of it is changed."""

import json
import shutil

import pytest
from typer.testing import CliRunner

import idic
from idic.cli.app import app
from idic.errors import InputError


@pytest.fixture
def other(small, tmp_path):
    """The RUN of a version with another number."""
    run = shutil.copytree(small.run, tmp_path / "run")
    file = run / "run.zarr" / "zarr.json"
    content = json.loads(file.read_text())
    content["attributes"]["schema"] = "idic.run/1"
    file.write_text(json.dumps(content))
    return run


def contents(run):
    """All files but the log of what happened."""
    return {path: path.read_bytes() for path in run.rglob("*") if path.is_file() and path.name != "log.txt"}


@pytest.mark.parametrize("words", ["identify EXPERIMENT --resume --no-prefect --out RUN", "report RUN",
                                   "diagnose RUN --no-prefect", "systematic RUN", "fields RUN --out OUT"])
def test_every_command_refuses_it_and_leaves_it_as_it_is(words, other, small, tmp_path):
    before = contents(other)
    places = {"RUN": str(other), "EXPERIMENT": str(small.experiment), "OUT": str(tmp_path / "out")}
    answer = CliRunner().invoke(app, [places.get(word, word) for word in words.split()])
    assert answer.exit_code == 2, answer.stderr
    assert "another version of idic made this RUN" in answer.stderr and "into a new RUN" in answer.stderr
    assert contents(other) == before


def test_python_refuses_it(other):
    with pytest.raises(InputError, match="another version of idic"):
        idic.load_result(other).fields.simulated  # noqa: B018
