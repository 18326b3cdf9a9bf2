"""Every fault that was found once is met by a message, or read, for ever."""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import pytest
from base_experiments import base_folder
from commands import assert_fair, check, contents, copy_of, idic
from known_faults import ACCEPTED, REFUSED, REFUSED_SETTINGS

from idic.cli.outcomes import BAD_INPUT, DONE
from idic.readers import foreign_mesh


@pytest.fixture(autouse=True)
def short_wait(monkeypatch):
    monkeypatch.setattr(foreign_mesh, "SECONDS", 1.0)


@pytest.mark.skipif(sys.platform == "win32", reason="pipes and links as files")
@pytest.mark.parametrize("name", REFUSED)
def test_a_known_fault_is_refused_with_one_message(name):
    with copy_of(base_folder("warm")) as folder:
        REFUSED[name](folder)
        answer = check(folder)
        assert answer.code == BAD_INPUT, f"{answer.shown}"


@pytest.mark.skipif(sys.platform == "win32", reason="pipes and links as files")
@pytest.mark.parametrize("name", ACCEPTED)
def test_what_only_looks_odd_is_read(name):
    with copy_of(base_folder("warm")) as folder:
        ACCEPTED[name](folder)
        answer = check(folder)
        assert answer.code == DONE, answer.said


@pytest.mark.parametrize("name", REFUSED_SETTINGS)
def test_a_known_fault_in_a_setting_is_refused_with_one_message(name):
    with copy_of(base_folder("warm")) as folder:
        before = contents(folder)
        answer = idic("check", folder, "--no-picture", "--set", REFUSED_SETTINGS[name])
        assert_fair(answer, (BAD_INPUT,))
        assert contents(folder) == before


@pytest.mark.skipif(sys.platform == "win32", reason="pipes and links as files")
@pytest.mark.parametrize("name", [*REFUSED, *ACCEPTED])
def test_init_writes_an_experiment_or_one_message_for_such_a_folder(name):
    with copy_of(base_folder("warm")) as folder:
        (REFUSED | ACCEPTED)[name](folder)
        if (folder / "experiment.toml").is_file():
            (folder / "experiment.toml").unlink()
        answer = idic("init", folder)
        assert_fair(answer, (DONE, BAD_INPUT))


def test_a_result_nested_beyond_reading_is_refused():
    with tempfile.TemporaryDirectory(prefix="idic-fuzz-") as scratch:
        (Path(scratch) / "result.json").write_text('{"a": ' + "[" * 100_000 + "]" * 100_000 + "}")
        assert_fair(idic("compare", scratch, scratch, "--out", f"{scratch}/page"), (BAD_INPUT,))
        assert_fair(idic("report", scratch), (BAD_INPUT,))
