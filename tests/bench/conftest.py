"""Measurements are printed as they come, and once more at the end: the table of docs/evidence/measurements.md."""

from __future__ import annotations

import os

import pytest

ROWS: list[tuple[str, str, str]] = []


@pytest.fixture
def measured(capsys):
    """``measured(what, figure, against)`` prints a line and keeps it for the table."""

    def note(what: str, figure: str, against: str) -> None:
        ROWS.append((what, figure, against))
        with capsys.disabled():
            print(f"\n{what}: {figure}; {against}")

    return note


def pytest_terminal_summary(terminalreporter):
    if not ROWS:
        return
    load = f"; load of the machine at the end {os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else ""
    terminalreporter.section("speed")
    terminalreporter.write_line(f"{os.cpu_count()} cores{load}")
    for row in (("what", "figure", "against"), ("---", "---", "---"), *ROWS):
        terminalreporter.write_line("| " + " | ".join(row) + " |")
