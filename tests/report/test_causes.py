"""`idic check` names what is wrong with a recording by its motion, and says nothing of a sound one."""

import pytest
from report.cause_worlds import SOUND, WRONG
from typer.testing import CliRunner

from idic.cli.app import app


def checked(folder) -> list[str]:
    """The warnings of `idic check`."""
    shown = CliRunner().invoke(app, ["check", str(folder), "--no-picture"])
    assert shown.exit_code in (0, 2), shown.output
    lines = shown.output.splitlines()
    return [" ".join(lines)] if shown.exit_code else [line for line in lines if line.startswith("warning")]


@pytest.mark.parametrize("name", WRONG)
def test_what_is_wrong_is_named(tmp_path, name):
    world, told = WRONG[name]
    assert told in " ".join(checked(world().write(tmp_path / "test")))


@pytest.mark.parametrize("name", SOUND)
def test_nothing_is_named_of_a_sound_test(tmp_path, name):
    assert not [line for line in checked(SOUND[name]().write(tmp_path / "test")) if "speckle" not in line]
