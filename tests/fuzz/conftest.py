"""A case that asks for more memory than any input here is worth fails like one that hangs."""

from __future__ import annotations

import resource

import psutil
import pytest

MORE = 6 << 30  # bytes of address space beyond what the process has: libraries and stacks reserve a lot of it


@pytest.fixture(scope="module", autouse=True)
def bounded_memory():
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (psutil.Process().memory_info().vms + MORE, hard))
    yield
    resource.setrlimit(resource.RLIMIT_AS, (soft, hard))
