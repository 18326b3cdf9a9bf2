"""What all tests share: where the public data lies."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import pytest

# the background jobs of a shell ignore Ctrl-C, and so would every process that a test starts and interrupts
signal.signal(signal.SIGINT, signal.default_int_handler)

# one thread for each process: the workers of pytest-xdist share the cores, and threads of linear algebra would wait
# for one another; set before NumPy is imported
for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(name, "1")


@pytest.fixture(scope="session")
def shared_data():
    """A function: the path of a data set, or a skip with the reason where it is absent."""
    root = Path(os.environ.get("IDIC_SHARED_DATA", Path(__file__).resolve().parents[2] / "shared" / "data"))

    def path(name: str) -> Path:
        if not (root / name).exists():
            pytest.skip(f"no data set {name} in {root} (set IDIC_SHARED_DATA)")
        return root / name

    return path
