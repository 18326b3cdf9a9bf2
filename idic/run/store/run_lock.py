"""One process per RUN folder: an advisory lock that the operating system releases at the end of the process."""

from __future__ import annotations

import json
import os
import socket
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import psutil

from idic.errors import InputError
from idic.inside import folder_inside, open_inside
from idic.run.store.result_file import read_json

try:
    import fcntl
except ImportError:
    fcntl = None
try:
    import msvcrt
except ImportError:  # not on Windows; without either, the process number in the file decides
    msvcrt = None

LOCK_NAME = "run.lock"
# On Windows no other process can read a locked byte: the lock is here, behind the process number of its holder
LOCKED_BYTE = 1 << 30


class RunBusy(InputError):
    """Another process holds the lock; the caller may wait."""


@contextmanager
def run_lock(run: Path | str) -> Iterator[Path]:
    """Hold the lock of a RUN folder for the length of a ``with`` block.

    The lock of a process that has ended is taken over. The file itself stays (deleting it would open a race between two
    waiting processes); it is emptied at the end of the block.

    Raises
    ------
    RunBusy
        Another running process holds the lock.
    """
    path = Path(run) / LOCK_NAME
    folder_inside(run)
    with open_inside(run, LOCK_NAME, "a+b") as stream:  # its end drops the system's lock
        descriptor = stream.fileno()
        owned_by_system = _try_system_lock(descriptor)
        if owned_by_system is False or (owned_by_system is None and process_lives(_read_holder(path))):
            raise _refusal(path)
        _write_holder(descriptor)
        try:
            yield path
        finally:
            os.ftruncate(descriptor, 0)


def is_held(run: Path | str) -> bool:
    """Whether a process works on this RUN, as far as the file of its lock tells; nothing is locked or written."""
    return process_lives(_read_holder(Path(run) / LOCK_NAME))


def this_process() -> dict:
    """What tells this process from all others, also from a later one with its number; `process_started` in s after the
    boot."""
    return {"pid": os.getpid(), "host": socket.gethostname(), "process_started": _started(psutil.Process())}


def _try_system_lock(descriptor: int) -> bool | None:
    """True: held now. False: another process holds it. None: this file system has no locks."""
    if fcntl is None:
        return None if msvcrt is None else _lock_of_windows(descriptor)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        return None
    return True


def _lock_of_windows(descriptor: int) -> bool:
    """The same by ``LockFile``; the end of the process or the closing of the file releases it."""
    os.lseek(descriptor, LOCKED_BYTE, os.SEEK_SET)
    try:
        msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined]
    except OSError:
        return False
    return True


def _write_holder(descriptor: int) -> None:
    holder = this_process() | {"locked": time.strftime("%Y-%m-%d %H:%M:%S")}
    os.ftruncate(descriptor, 0)
    os.lseek(descriptor, 0, os.SEEK_SET)
    os.write(descriptor, json.dumps(holder).encode())


def _read_holder(path: Path) -> dict:
    try:
        holder = read_json(path)
    except (OSError, ValueError):
        return {}
    return holder if isinstance(holder, dict) else {}


def process_lives(holder: Mapping) -> bool:
    """Whether the process that `this_process` described exists; on another host it is assumed to exist."""
    if not holder:
        return False
    if holder.get("host") != socket.gethostname():
        return True
    try:
        started = _started(psutil.Process(int(holder["pid"])))
        return abs(started - holder.get("process_started", started)) < 1.0  # s; a later process may reuse the number
    except (psutil.Error, KeyError, ValueError, TypeError, OverflowError):
        return False


def _started(process: psutil.Process) -> float:
    """Start time of a process in s after the boot; a change of the clock shifts both times alike."""
    return process.create_time() - psutil.boot_time()


def _refusal(path: Path) -> RunBusy:
    holder = _read_holder(path)
    owner = f"process {holder.get('pid', '?')} on {holder.get('host', '?')} since {holder.get('locked', '?')}"
    return RunBusy(
        "another idic process works on this RUN folder",
        file=path.parent,
        found=owner,
        remedy=f"wait for it to end, or take another folder; if no such process runs any more, delete {path}",
    )
