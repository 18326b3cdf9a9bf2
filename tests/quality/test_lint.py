"""Ruff and mypy read the package, the flows and the studies; their rules stand in pyproject.toml."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


def _run(*command: str) -> None:
    done = subprocess.run([sys.executable, "-m", *command], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, f"{' '.join(command)}\n{done.stdout}{done.stderr}"


def test_ruff_finds_nothing_in_the_packages():
    pytest.importorskip("ruff", reason="ruff comes with the extra: test")
    _run("ruff", "check", "idic", "flows", "studies")


def test_tests_and_docs_use_no_undefined_name_and_no_unused_import():
    pytest.importorskip("ruff", reason="ruff comes with the extra: test")
    _run("ruff", "check", "--select", "F,E9", "tests", "docs")


def test_the_type_checker_finds_nothing_in_the_packages():
    """About 30 s of processor time in a new checkout, 2 s with its cache."""
    pytest.importorskip("mypy", reason="mypy comes with the extra: test")
    _run("mypy")
