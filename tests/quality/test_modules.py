"""Modules that are named in words, where no import shows them: commands of the docs and preloads of the workers exist."""

from __future__ import annotations

import importlib
import re
from importlib.util import find_spec
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
MODULES = [".".join(file.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
           for file in sorted((ROOT / "idic").rglob("*.py")) if file.name not in ("__main__.py", "guard.py")]


def named(pattern: str, *files: Path) -> set[str]:
    return {name for file in files for name in re.findall(pattern, file.read_text(encoding="utf-8"))}


@pytest.mark.parametrize("module", MODULES)
def test_every_module_can_be_imported(module):
    importlib.import_module(module)


def test_every_module_that_the_docs_start_exists():
    names = named(r"python -m (idic[\w.]*)", ROOT / "README.md", *(ROOT / "docs").glob("*.md"))
    assert len(names) > 2 and [name for name in names if find_spec(name) is None] == []


def test_every_module_that_the_workers_preload_exists():
    names = named(r'\("(idic(?:\.\w+)+)",\)', *(ROOT / "idic").rglob("*.py"), *(ROOT / "flows").glob("*.py"))
    assert len(names) > 2 and [name for name in names if find_spec(name) is None] == []


def test_every_file_of_tests_that_is_started_first_exists():
    names = named(r'"(\w+/test_\w+\.py)"', ROOT / "tests" / "conftest.py")
    assert len(names) > 2 and [name for name in names if not (ROOT / "tests" / name).is_file()] == []
