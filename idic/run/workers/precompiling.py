"""Kernels compiled in a process of its own while this one does something else; both share numba's disk cache."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

from idic.run.workers import parent_guard
from idic.run.workers.working_folder import empty_folder


@contextmanager
def compiling_meanwhile(module: str) -> Iterator[None]:
    """Run a module that compiles kernels beside a ``with`` block; at its end that process ends, too."""
    process = subprocess.Popen([sys.executable, parent_guard.__file__, module],
                               stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
                               cwd=empty_folder())
    try:
        yield
    finally:
        process.kill()
        process.communicate()
