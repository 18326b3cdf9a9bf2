"""The how-to pages: one screen each, every snippet of experiment.toml is read, every command exists with its
options."""

import re
import shlex
import tomllib
from pathlib import Path

import pytest
from typer.main import get_command

from experiment_file.small_experiment import TOML
from idic.cli.app import app
from idic.experiment_file import ExperimentFile

FOLDER = Path(__file__).parents[2] / "docs" / "how-to"
PAGES = sorted(FOLDER.glob("*.md"))
every_page = pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)


def blocks(page, language):
    return re.findall(rf"^```{language}\n(.*?)^```", page.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)


def completed(snippet):
    """The small experiment with the tables of the snippet in the place of its own."""
    base, tables = tomllib.loads(TOML), tomllib.loads(snippet)
    if "fields" in tables.get("experiment", {}):
        del base["experiment"]["images"]
    for name, table in tables.items():
        base[name] = {**base.get(name, {}), **table} if isinstance(table, dict) and name != "material" else table
    return base


@every_page
def test_a_page_is_one_screen(page):
    text = page.read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 60 and len(text.split()) <= 350


@every_page
def test_the_tables_of_a_page_are_read(page):
    for snippet in blocks(page, "toml"):
        ExperimentFile.model_validate(completed(snippet))


@every_page
def test_the_commands_of_a_page_exist(page):
    commands = get_command(app).commands
    lines = [line for block in blocks(page, "sh") for line in block.splitlines() if line.startswith("idic ")]
    for line in lines:
        _, name, *words = shlex.split(line, comments=True)
        known = {option for parameter in commands[name].params
                 for option in (*parameter.opts, *parameter.secondary_opts)}
        assert {word for word in words if word.startswith("--")} <= known, line


def test_the_laws_of_the_page_exist():
    from idic.laws import all_laws

    rows = re.findall(r"^\| .*? \| (`.*)\|$", (FOLDER / "choose-a-law.md").read_text(encoding="utf-8"), re.MULTILINE)
    named = {name for row in rows for name in re.findall(r"`(\w+)`", row)}
    assert len(named) > 10 and named <= set(all_laws())


@every_page
def test_schedulers_on_other_machines_have_addresses_that_are_accepted(page):
    for address in re.findall(r"--scheduler (\S+)", page.read_text(encoding="utf-8")):
        assert address.startswith("tls://"), address
