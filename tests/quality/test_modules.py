"""Modules that are named in words, where no import shows them: commands of the docs and preloads of the workers
exist."""

from __future__ import annotations

import ast
import importlib
import re
from importlib.util import find_spec
from pathlib import Path

from quality.called import called
from quality.sources import modules

ROOT = Path(__file__).parents[2]
MODULES = modules()


def named(pattern: str, *files: Path) -> set[str]:
    return {name for file in files for name in re.findall(pattern, file.read_text(encoding="utf-8"))}


def test_every_module_can_be_imported():
    for name, file in MODULES.items():
        if file.name not in ("__main__.py", "guard.py"):
            importlib.import_module(name)


def test_every_module_that_the_docs_start_exists():
    names = named(r"python -m (idic[\w.]*)", ROOT / "README.md", *(ROOT / "docs").rglob("*.md"))
    assert len(names) > 2 and [name for name in names if find_spec(name) is None] == []


def test_every_module_that_the_workers_preload_exists():
    names = named(r'\("(idic(?:\.\w+)+)",\)', *MODULES.values())
    assert len(names) > 2 and [name for name in names if find_spec(name) is None] == []


def test_every_file_of_tests_that_is_started_first_exists():
    names = named(r'"(\w+/test_\w+\.py)"', ROOT / "tests" / "conftest.py")
    assert len(names) > 2 and [name for name in names if not (ROOT / "tests" / name).is_file()] == []


def without_remedy(text: str) -> list[int]:
    """Lines in which an `InputError` is made that does not say what to do."""
    calls = [node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Call)
             and called(node) == "InputError"] if "InputError" in text else []
    return [call.lineno for call in calls if not {word.arg for word in call.keywords} & {"remedy", None}]


def test_every_refusal_of_an_input_says_what_to_do():
    assert without_remedy("InputError('bad', found=1)") == [1] and not without_remedy("InputError('bad', remedy='x')")
    found = {str(file.relative_to(ROOT)): without_remedy(file.read_text(encoding="utf-8"))
             for file in MODULES.values()}
    assert {file: lines for file, lines in found.items() if lines} == {}
