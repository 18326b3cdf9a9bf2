"""Where the folders of the fuzzing lie: in memory where there is room. A RUN is 360 files and folders, copied dozens of
times; on a disk a copy costs ten times the processor time."""

from __future__ import annotations

import os
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory, mkdtemp

MEMORY, ROOM = "/dev/shm", 1 << 30  # a file system; bytes


@cache
def scratch() -> str | None:
    """The parent of scratch folders; None: the usual one."""
    if not os.access(MEMORY, os.W_OK):
        return None
    space = os.statvfs(MEMORY)
    return MEMORY if space.f_bavail * space.f_frsize > ROOM else None


def lasting_folder(name: str) -> Path:
    """A new folder for what all tests of this process copy; gone at its end."""
    return Path(mkdtemp(prefix=f"{name}-", dir=_session().name))


@cache
def _session() -> TemporaryDirectory:
    return TemporaryDirectory(prefix="idic-fuzz-", dir=scratch())
