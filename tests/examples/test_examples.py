"""The examples of docs/examples run as they are printed; each is short, and writes the picture of the gallery."""

import re
import runpy
import subprocess
from pathlib import Path

import matplotlib
import pytest
from matplotlib import pyplot
from typer.testing import CliRunner

from idic.cli.app import app

FOLDER = Path(__file__).parents[2] / "docs" / "examples"
SCRIPTS = sorted(FOLDER.glob("*.py"))
GALLERY = (FOLDER / "README.md").read_text(encoding="utf-8")
SAYS = {  # what a reader of the gallery must find on the screen
    "not_determined": ("no force: it scales the stress", "cannot be told apart from geometry.thickness"),
    "too_much_noise": ("by more than the noise",),
    "wrong_model": ("not matched within the noise", "Plasticity (yield stress"),
    "several_tests": ("converged",),
}
every_example = pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.stem)


@pytest.fixture
def commands_in_this_process(monkeypatch):
    """`idic …` of an example without another interpreter: 2 s less for each."""
    def command(words, check=False):
        assert words[0] == "idic"
        answer = CliRunner().invoke(app, words[1:], catch_exceptions=False)
        print(answer.output)
        assert answer.exit_code == 0 or not check, answer.output
        return subprocess.CompletedProcess(words, answer.exit_code)

    monkeypatch.setattr(subprocess, "run", command)
    matplotlib.use("Agg")
    yield
    pyplot.close("all")


@every_example
def test_an_example_runs_and_draws_its_picture(script, tmp_path, monkeypatch, capsys, commands_in_this_process):
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(script), run_name="__main__")
    assert (tmp_path / f"{script.stem}.png").stat().st_size > 5000
    printed = " ".join(capsys.readouterr().out.split())
    assert all(text in printed for text in SAYS.get(script.stem, ("±",))), printed


@every_example
def test_an_example_is_short_and_takes_the_public_door(script):
    text = script.read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 40 and max(map(len, text.splitlines())) <= 120
    assert not re.search(r"from idic|import idic\.", text)


@every_example
def test_an_example_is_in_the_gallery_with_picture_and_command(script):
    assert f"({script.stem}.png)" in GALLERY and f"python docs/examples/{script.name}" in GALLERY
    assert (FOLDER / f"{script.stem}.png").exists()


def test_there_are_ten_examples():
    assert len(SCRIPTS) == 10
