"""The failure gallery says what idic says: the cases that need no simulation, made and run again."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[2] / "docs"


def gallery():
    spec = importlib.util.spec_from_file_location("failures", DOCS / "failures.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules["failures"] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module


def test_every_case_is_on_the_page_once():
    page = (DOCS / "failures.md").read_text(encoding="utf-8")
    for case in gallery().CASES:
        assert page.count(f"## {case.title}\n") == 1


@pytest.mark.slow  # each makes its own test: 10 s of processor time
@pytest.mark.parametrize("name", ["no-value", "wrong-key"])
def test_the_texts_on_bad_input_are_those_of_today(tmp_path, name):
    module = gallery()
    case = next(case for case in module.CASES if case.name == name)
    said = module.run(case, tmp_path / name)
    assert said[-1]["code"] == 2 and not (tmp_path / name / "run").exists()
    page = (DOCS / "failures.md").read_text(encoding="utf-8")
    assert said[-1]["said"].strip().replace(said[-1]["folder"] + "/", "") in page
