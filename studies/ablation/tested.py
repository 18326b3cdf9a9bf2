"""The trace of tests: a plug-in of pytest.

    IDIC_TRACE=FILE python -m pytest -p idic_studies.ablation.tested tests/diagnose

Tests hold the recordings for which a threshold or a procedure was made: what decides in none of the drawn worlds may
decide there.
"""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

from idic_studies.ablation.trace import traced


def pytest_load_initial_conftests(early_config: Any) -> None:
    """Begin the trace before a test imports the diagnosis."""
    early_config.idic_ledger = traced()


def pytest_runtest_teardown(item: Any, nextitem: Any) -> None:
    """Write the ledger of all tests of this process so far, after the last test of every file."""
    target = os.environ.get("IDIC_TRACE")
    if target and (nextitem is None or nextitem.path != item.path):
        content = item.config.idic_ledger.content
        Path(target).write_text(json.dumps(content, indent=0, sort_keys=True), encoding="utf-8")
