"""The commands of the studies where these are not installed: one message, exit code 2, nothing is written."""

import sys

import pytest
from typer.testing import CliRunner

from idic.cli.app import app
from idic.errors import InputError
from idic.studies import studies_module


class NotInstalled:
    """Comes first among the finders of modules and finds no studies."""

    @staticmethod
    def find_spec(name, path=None, target=None):
        if name == "idic_studies":
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)


@pytest.fixture
def without_studies(monkeypatch):
    """An interpreter in which `pip install .` alone was made."""
    for name in [name for name in sys.modules if name.split(".")[0] == "idic_studies"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setattr(sys, "meta_path", [NotInstalled, *sys.meta_path])


@pytest.mark.parametrize(("command", "arguments"), [
    ("study", ["bulge"]), ("trial", []), ("gallery", []), ("example bulge", []), ("example polycarbonate", []),
    ("example polycarbonate-plans", [])])
def test_a_command_of_the_studies_says_how_to_install_them(command, arguments, without_studies, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    answer = CliRunner().invoke(app, [*command.split(), *arguments, "--out", "x"])
    assert answer.exit_code == 2, answer.stderr
    assert answer.stderr.startswith(f"idic: idic {command}: the studies are not installed\n")
    assert answer.stderr.endswith("pip install ./studies\n")
    assert len(answer.stderr.splitlines()) == 4 and not list(tmp_path.iterdir())


def test_what_is_missing_in_the_studies_themselves_is_an_error_of_its_own():
    with pytest.raises(ModuleNotFoundError, match="no_such_module"):
        studies_module("no_such_module", "idic study")


def test_the_product_needs_no_studies(without_studies, tmp_path):
    answer = CliRunner().invoke(app, ["example", "no_such_example", "--out", str(tmp_path / "x")])
    assert "bulge" in answer.stderr and "polycarbonate-plans" in answer.stderr
    with pytest.raises(InputError):
        studies_module("examples", "idic example bulge")
