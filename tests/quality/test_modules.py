"""Modules that are named in words, where no import shows them: commands of the docs and preloads of the workers
exist."""

from __future__ import annotations

import ast
import importlib
import re
from importlib.util import find_spec
from pathlib import Path

from quality.called import called

ROOT = Path(__file__).parents[2]
FOLDERS = {"idic": "idic", "flows": "idic_flows", "studies": "idic_studies"}  # and their packages
SOURCES = {folder: [file for file in sorted((ROOT / folder).rglob("*.py")) if (file.parent / "__init__.py").exists()]
           for folder in FOLDERS}
MODULES = [".".join((FOLDERS[folder], *file.relative_to(ROOT / folder).with_suffix("").parts)).removesuffix(".__init__")
           for folder, files in SOURCES.items() for file in files if file.name not in ("__main__.py", "guard.py")]


def named(pattern: str, *files: Path) -> set[str]:
    return {name for file in files for name in re.findall(pattern, file.read_text(encoding="utf-8"))}


def test_every_module_can_be_imported():
    for module in MODULES:
        importlib.import_module(module)


def test_every_module_that_the_docs_start_exists():
    names = named(r"python -m (idic[\w.]*)", ROOT / "README.md", *(ROOT / "docs").rglob("*.md"))
    assert len(names) > 2 and [name for name in names if find_spec(name) is None] == []


def test_every_module_that_the_workers_preload_exists():
    names = named(r'\("(idic(?:\.\w+)+)",\)', *(file for files in SOURCES.values() for file in files))
    assert len(names) > 2 and [name for name in names if find_spec(name) is None] == []


def test_every_file_of_tests_that_is_started_first_exists():
    names = named(r'"(\w+/test_\w+\.py)"', ROOT / "tests" / "conftest.py")
    assert len(names) > 2 and [name for name in names if not (ROOT / "tests" / name).is_file()] == []


def without_remedy(text: str) -> list[int]:
    """Lines in which an `InputError` is made that does not say what to do."""
    calls = [node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Call)
             and called(node) == "InputError"]
    return [call.lineno for call in calls if not {word.arg for word in call.keywords} & {"remedy", None}]


def test_every_refusal_of_an_input_says_what_to_do():
    assert without_remedy("InputError('bad', found=1)") == [1] and not without_remedy("InputError('bad', remedy='x')")
    found = {str(file.relative_to(ROOT)): without_remedy(file.read_text(encoding="utf-8"))
             for files in SOURCES.values() for file in files}
    assert {file: lines for file, lines in found.items() if lines} == {}
