"""The tutorial, typed as it stands."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[2] / "docs"


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
