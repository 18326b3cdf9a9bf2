"""What all tests share: where the public data lies."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import pytest

# the background jobs of a shell ignore Ctrl-C, and so would every process that a test starts and interrupts
signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session")
def shared_data():
    """A function: the path of a data set, or a skip with the reason where it is absent."""
    root = Path(os.environ.get("IDIC_SHARED_DATA", Path(__file__).resolve().parents[2] / "shared" / "data"))

    def path(name: str) -> Path:
        if not (root / name).exists():
            pytest.skip(f"no data set {name} in {root} (set IDIC_SHARED_DATA)")
        return root / name

    return path
