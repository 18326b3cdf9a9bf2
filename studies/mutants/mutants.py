"""Mutants: how one is read, applied to a copy of the checkout, and looked for by its tests."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

CHECKOUT = Path(__file__).resolve().parents[2]
LEFT_BEHIND = (".git", ".venv", "shared", "build")  # no part of the product or its tests
TESTS_FAILED = 1  # exit code of pytest; others are a collection that failed, no tests, and the like


@dataclass(frozen=True)
class Mutant:
    """A text of one file that is replaced by a wrong one, and arguments of pytest: one of these tests should fail."""

    name: str
    file: str
    text: str
    mutated: str
    tests: tuple[str, ...]


def mutants() -> list[Mutant]:
    """Those of ``mutants.toml``."""
    tables = tomllib.loads((Path(__file__).parent / "mutants.toml").read_text(encoding="utf-8"))["mutant"]
    return [Mutant(**table | {"tests": tuple(table["tests"])}) for table in tables]


def copied_checkout(folder: Path) -> Path:
    """A copy of the checkout below a folder, compiled kernels included."""
    return Path(shutil.copytree(CHECKOUT, folder / "idic", symlinks=True, ignore=shutil.ignore_patterns(*LEFT_BEHIND)))


@contextmanager
def applied(mutant: Mutant, checkout: Path) -> Iterator[None]:
    """The checkout with the mutant; afterwards as before, its file as old as it was: compiled kernels stay valid.

    Raises
    ------
    ValueError
        The text of the mutant does not occur in its file once.
    """
    file = checkout / mutant.file
    original, age = file.read_text(encoding="utf-8"), file.stat()
    if original.count(mutant.text) != 1:
        raise ValueError(f"{mutant.name}: its text occurs {original.count(mutant.text)} times in {mutant.file}; "
                         "write in mutants.toml what stands there now")
    file.write_text(original.replace(mutant.text, mutant.mutated), encoding="utf-8")
    try:
        yield
    finally:
        file.write_text(original, encoding="utf-8")
        os.utime(file, ns=(age.st_atime_ns, age.st_mtime_ns))


def caught(mutant: Mutant, checkout: Path) -> str | None:
    """The first test that fails with the mutant in a copy of the checkout; None where all pass.

    Raises
    ------
    RuntimeError
        The tests could not be run.
    """
    environment = os.environ | {"PYTHONPATH": str(checkout)}
    environment.setdefault("IDIC_SHARED_DATA", str(CHECKOUT.parent / "shared" / "data"))
    with applied(mutant, checkout):
        command = [sys.executable, "-m", "pytest", "-x", "-q", "-n", "0", "-p", "no:cacheprovider", *mutant.tests]
        answer = subprocess.run(command, cwd=checkout, env=environment, capture_output=True, text=True, check=False)
    if answer.returncode == 0:
        return None
    failed = re.search(r"^(?:FAILED|ERROR) (\S+)", answer.stdout, re.MULTILINE)
    if answer.returncode != TESTS_FAILED or failed is None:
        raise RuntimeError(f"{mutant.name}: pytest ended with {answer.returncode}:\n{answer.stdout}{answer.stderr}")
    return failed[1]
