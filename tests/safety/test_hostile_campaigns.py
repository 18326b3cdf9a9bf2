"""A small fixed part of the campaigns of hostile input: every case ends well or with one message, and opens nothing
outside of its folder. At length: ``python -m idic_studies.evidence.hostile``."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from idic_studies.evidence.hostile.bases import Base
from idic_studies.evidence.hostile.campaigns import CAMPAIGNS
from idic_studies.evidence.hostile.counting import run_campaign
from idic_studies.evidence.hostile.watch import watched

NUMBERS = {"forged": 6, "damaged": 6, "exports": 30, "requests": 12, "commands": 15}  # cases of a few seconds


@pytest.mark.parametrize("name", CAMPAIGNS)
def test_a_part_of_a_campaign_ends_well(gallery, name):
    step = gallery("step")
    folder = Path.cwd()
    try:
        base = Base(step.experiment, step.run, {"options.max_iterations": 1})
        tally = run_campaign(name, CAMPAIGNS[name](base), NUMBERS[name], 20_000)
    finally:
        os.chdir(folder)
    assert tally.cases == NUMBERS[name] and not tally.failures
    assert tally.outcomes["refused"] > 0


@pytest.mark.parametrize(("act", "kind"), [
    (lambda secret, work: (secret / "a.txt").read_text(), "read outside"),
    (lambda secret, work: os.listdir(secret), "read outside"),
    (lambda secret, work: np.fromfile(secret / "a.txt", dtype="u1"), "read outside"),
    (lambda secret, work: (work.parent / "elsewhere").write_text("x"), "write outside"),
    (lambda secret, work: (work.parent / "made").mkdir(), "write outside"),
    (lambda secret, work: os.symlink(secret, work.parent / "link"), "write outside"),
    (lambda secret, work: os.system("true"), "program"),
    (lambda secret, work: (work / "inside.txt").write_text("x"), None)])
def test_the_watch_sees_what_is_opened(tmp_path, act, kind):
    secret, work = tmp_path / "secret", tmp_path / "work"
    secret.mkdir()
    work.mkdir()
    (secret / "a.txt").write_text("secret")
    with watched([work], secret) as watch:
        act(secret, work)
    assert {event for event, _ in watch.events} == ({kind} if kind else set())
