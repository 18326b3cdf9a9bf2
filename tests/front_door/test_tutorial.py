"""The tutorial, typed as it stands."""

from __future__ import annotations

import importlib.util
import re
import shutil
import tomllib
from pathlib import Path

import pytest
from typer.testing import CliRunner

from idic.cli.app import app

DOCS = Path(__file__).parents[2] / "docs"


def test_the_outputs_before_the_identification_are_those_of_today(tmp_path, monkeypatch):
    """Paths, numbers and words of `init` and `check`; the line of the cost depends on the machine."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "110")
    page = (DOCS / "tutorial.md").read_text(encoding="utf-8")
    outputs = re.findall(r"^```text\n(.*?)^```", page, re.MULTILINE | re.DOTALL)

    def assert_printed(command, expected):
        printed = CliRunner().invoke(app, command.split()).output
        told = [[line.rstrip() for line in text.splitlines() if not line.startswith("cost ")]
                for text in (printed, expected)]
        assert told[0] == told[1]

    assert_printed("example demo --reduced --out laboratory", outputs[0].splitlines()[0])
    assert outputs[0].splitlines()[1:] == (tmp_path / "laboratory" / "loads.csv").read_text().splitlines()[:3]
    for name in ("images", "loads.csv", "mesh.inp"):
        (shutil.copytree if name == "images" else shutil.copy)(f"laboratory/{name}", f"my-test/{name}")
    assert_printed("init my-test", outputs[1])
    text = re.search(r"<!-- file: my-test/experiment.toml -->\n```toml\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    (tmp_path / "my-test" / "experiment.toml").write_text(text[1], encoding="utf-8")
    assert_printed("check my-test --no-picture", re.sub(r"picture .*\n", "", outputs[2]))


def test_every_piece_of_an_experiment_file_in_the_docs_can_be_parsed():
    pages = [DOCS.parent / "README.md", *DOCS.rglob("*.md")]
    found = [(page, piece) for page in pages for piece in
             re.findall(r"^```toml\n(.*?)^```", page.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)]
    assert len(found) > 30
    for page, piece in found:
        try:
            tomllib.loads(piece)
        except tomllib.TOMLDecodeError as problem:
            pytest.fail(f"{page.name}: {problem}\n{piece}")


@pytest.mark.slow  # three identifications, a finer mesh and their reports: some 60 s of processor time
def test_every_command_of_the_tutorial_ends_well(tmp_path):
    spec = importlib.util.spec_from_file_location("tutorial", DOCS / "tutorial.py")
    tutorial = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(tutorial)
    page = (DOCS / "tutorial.md").read_text(encoding="utf-8")
    found = tutorial.run_tutorial(tmp_path / "t", page)
    assert found.count("```") == page.count("```")
    assert (tmp_path / "t" / "runs-first" / "report.html").exists()
    for line in ("converged", "discretisation bias", "runs-nu − runs-first", "parameters.csv"):
        assert line in found
