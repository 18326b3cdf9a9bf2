"""Measurements are printed as they come, and once more at the end: the table of docs/evidence/measurements.md."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest
from threadpoolctl import threadpool_limits

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "tests"))  # the specimens of the tests are measured, too

# one thread of linear algebra, here and in the processes that are started: a plugin may have imported NumPy already
for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(name, "1")
threadpool_limits(1)

ROWS: list[tuple[str, str, str]] = []


@pytest.fixture
def measured(capsys):
    """``measured(what, figure, against)`` prints a line and keeps it for the table."""

    def note(subject: str, figure: str, against: str) -> None:
        ROWS.append((subject, figure, against))
        with capsys.disabled():
            print(f"\n{subject}: {figure}; {against}")

    return note


@pytest.fixture(scope="session")
def shared_data():
    """A function: the path of a data set, or a skip with the reason where it is absent."""
    root = Path(os.environ.get("IDIC_SHARED_DATA", ROOT.parent / "shared" / "data"))

    def path(name: str) -> Path:
        if not (root / name).exists():
            pytest.skip(f"no data set {name} in {root} (set IDIC_SHARED_DATA)")
        return root / name

    return path


def pytest_terminal_summary(terminalreporter):
    if not ROWS:
        return
    load = f"; load of the machine at the end {os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else ""
    terminalreporter.section("speed")
    terminalreporter.write_line(f"{os.cpu_count()} cores{load}")
    for row in (("what", "figure", "against"), ("---", "---", "---"), *ROWS):
        terminalreporter.write_line("| " + " | ".join(row) + " |")
