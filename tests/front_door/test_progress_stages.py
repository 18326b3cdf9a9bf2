"""Stages, bars and expected times as a pipe or a log file sees them."""

from __future__ import annotations

import io
import time
from datetime import datetime

import pytest
from rich.console import Console
from typer.testing import CliRunner
from virtual_tests.small_strip import SMALL

from idic.cli.app import app, terminal, wide_console
from idic.cli.progress import SETTLED_GAIN, Pace, duration, evaluations_left, progress_view
from idic.cli.tables import show
from idic.report import batch_lines
from idic.virtual_tests import EXAMPLES, strip


def test_stages_are_numbered_and_steps_keep_the_number_of_their_stage(tmp_path):
    said = io.StringIO()
    (tmp_path / "run.zarr").mkdir()
    with progress_view(Console(file=said, width=200), tmp_path, ("reading", "fit", "report")) as view:
        view.stage("reading images")
        view.stage("fit of the model")
        view.stage("a repeated step")
        view.stage("report")
    lines = said.getvalue().splitlines()
    assert [line.partition(" s  ")[2] for line in lines] == [
        "stage 1 of 3: reading images", "stage 2 of 3: fit of the model", "stage 2 of 3: a repeated step",
        "stage 3 of 3: report"]
    assert [line.partition(" s  ")[2] for line in (tmp_path / "log.txt").read_text(encoding="utf-8").splitlines()] == [
        line.partition(" s  ")[2] for line in lines]


def test_a_pace_gives_the_time_that_is_left():
    pace = Pace(100.0, 10)  # ten were there before
    assert pace.left(130.0, 10, 100) is None
    assert pace.left(130.0, 40, 100) == pytest.approx(60.0)
    assert pace.left(190.0, 100, 100) is None
    assert [pace.due(t, 15.0) for t in (110.0, 116.0, 120.0, 132.0)] == [False, True, False, True]


def history(*values):
    return [{"accepted": True, "phi": value} for value in values]


def test_expected_evaluations_follow_the_gains_of_the_last_two_steps():
    """Gains that fall tenfold per step need as many steps as there are decades to a settled gain, and one to
    confirm."""
    assert evaluations_left(history(5.0, 4.0)) is None
    assert evaluations_left(history(*(1000.0 + 10.0**-k for k in range(-3, 0)))) == 1 + 5
    assert evaluations_left(history(100.0, 50.0, 50.0 - 0.1 * SETTLED_GAIN)) == 1


def test_a_step_that_gains_more_than_the_last_one_promises_no_time():
    """Objectives of an identification that ended seven evaluations later: it was promised 34 further ones."""
    values = (31120.8, 30851.7, 30818.5, 30816.2, 30677.4, 30413.2, 30372.1)
    assert [evaluations_left(history(*values[:k])) for k in (5, 6)] == [None, None]
    assert 4 <= evaluations_left(history(*values)) <= 8  # four more came


def test_durations_are_rounded_to_what_a_person_plans_with():
    assert [duration(t) for t in (0.2, 61.0, 200.0, 9000.0)] == ["1 s", "61 s", "3 min", "2.5 h"]


@pytest.mark.slow
def test_the_log_of_a_demonstration_counts_from_the_start_of_the_command(tmp_path, monkeypatch):
    """The line of the report once jumped by the time that the images took."""
    def late(*_):
        time.sleep(3.0)
        return strip(SMALL)

    monkeypatch.setitem(EXAMPLES, "demo", late)
    began = datetime.now()
    answer = CliRunner().invoke(app, ["demo", "--out", str(tmp_path / "demo"), "--no-prefect", "--workers", "0"])
    assert answer.exit_code == 0, answer.output
    lines = [line.split(maxsplit=3) for line in (tmp_path / "demo" / "run" / "log.txt").read_text().splitlines()]
    stamps = [(datetime.fromisoformat(f"{day} {clock}") - began).total_seconds() for day, clock, *_ in lines]
    shown = [float(seconds) for _, _, seconds, _ in lines]
    assert "report" in lines[-1][-1] and shown[0] > 3.0
    assert [-1.3 < stamp - seconds < 0.5 for stamp, seconds in zip(stamps, shown, strict=True)] == [True] * len(lines)


ODD = "runs/[old]/[/x] :warning: [bold]"


def test_brackets_in_a_message_a_path_or_a_name_are_shown_as_they_are(tmp_path, monkeypatch, capsys):
    """Rich takes them for markup: it drops ``[old]``, and ``[/x]`` raises MarkupError."""
    said = io.StringIO()
    with progress_view(Console(file=said, width=200, force_terminal=True), tmp_path, (ODD,)) as view:
        view.stage(ODD)
        view.tasks(ODD, 1, 3)
        view.said(f"a: bad input ({ODD})")
    assert f"a: bad input ({ODD})" in said.getvalue()
    monkeypatch.setenv("COLUMNS", "300")
    row = {"name": ODD, "status": "bad_input", "reason": ODD, "iterations": None, "image_chi2_dof": None,
           "wall_s": None, "parameters": {ODD: {"value": 1.0, "std": 0.1, "unit": "[mm]"}}}
    show(wide_console(), batch_lines({"runs": [row], "converged": 0, "groups": []}))
    assert capsys.readouterr().out.count(ODD) == 3
    for console in (wide_console(), terminal(), terminal(stderr=True)):
        console.print(f"results  {ODD}", highlight=False)
    answer = capsys.readouterr()
    assert (answer.out + answer.err).count(ODD) == 3
