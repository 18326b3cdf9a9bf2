"""What a process reads and writes outside of the folders of a case: audit events of Python, inotify for C libraries."""

from __future__ import annotations

import ctypes
import os
import struct
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

# inotify(7): access, modification, attributes, moves, creation, deletion, opening
EVENTS = 0x001 | 0x002 | 0x004 | 0x040 | 0x080 | 0x100 | 0x200 | 0x020
HEADER = struct.Struct("iIII")
WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND
CHANGES = {"os.mkdir", "os.rename", "os.remove", "os.rmdir", "os.symlink", "os.link", "os.truncate", "os.chmod",
           "shutil.rmtree", "shutil.move", "shutil.copyfile"}
NAMES = {"os.symlink": slice(1, 2), "os.link": slice(1, 2), "os.rename": slice(0, 2), "shutil.move": slice(0, 2),
         "shutil.copyfile": slice(0, 2)}  # the arguments that are opened or changed; else the first
PROGRAMS = {"subprocess.Popen", "os.system", "os.exec", "os.posix_spawn", "os.spawn", "pickle.find_class"}

OF_CODE = ("numpy", "idic", "builtins", "_codecs", "numba", "copyreg", "llvmlite")  # copies in memory, compiled code

_active: list[Watch] = []
_hook_lock = threading.Lock()
_hooked = False


class Watch:
    """Collects what must not happen: ``events`` is a list of (kind, path).

    writable : folders in which a case may write; secret : a folder that nothing may open or change
    """

    def __init__(self, writable: list[Path], secret: Path):
        self.writable = [os.path.realpath(folder) for folder in writable]
        self.secret = os.path.realpath(secret)
        self.events: list[tuple[str, str]] = []
        self._is_looking = False

    def take(self, event: str, arguments: tuple) -> None:
        """An audit event of this process."""
        if self._is_looking:  # what this method does itself
            return
        if event in PROGRAMS:
            self._add_program(event, arguments)
            return
        for path in arguments[NAMES.get(event, slice(0, 1))]:
            if isinstance(path, (str, bytes)):
                self._add_path(event, os.fsdecode(path), arguments)

    def _add_program(self, event: str, arguments: tuple) -> None:
        if event == "pickle.find_class" and str(arguments[0]).split(".")[0] in OF_CODE:
            return
        if event == "subprocess.Popen" and arguments[0] == sys.executable:  # servers and helpers of idic
            return
        self.events.append(("program", f"{event} {arguments[:2]!r}"[:200]))

    def _add_path(self, event: str, path: str, arguments: tuple) -> None:
        self._is_looking = True
        try:
            flags = arguments[2] if event == "open" and len(arguments) > 2 and isinstance(arguments[2], int) else 0
            if os.sep not in path and (event != "open" or flags & getattr(os, "O_NOFOLLOW", 0)):
                return  # a name in an open folder (idic.inside): it leads nowhere
            resolved = os.path.realpath(path)
            if resolved == self.secret or resolved.startswith(self.secret + os.sep):
                self.events.append(("read outside", f"{event} {path}"))
            elif (event in CHANGES or flags & WRITING) and not self._may_write(resolved):
                self.events.append(("write outside", f"{event} {path}"))
        except (OSError, ValueError):  # no path
            return
        finally:
            self._is_looking = False

    def _may_write(self, path: str) -> bool:
        return path == os.devnull or any(path == folder or path.startswith(folder + os.sep) for folder in self.writable)


def _hear(event: str, arguments: tuple) -> None:
    if _active and (event == "open" or event in CHANGES or event in PROGRAMS):
        _active[-1].take(event, arguments)


@contextmanager
def watched(writable: list[Path], secret: Path) -> Iterator[Watch]:
    """A watch for the length of a ``with`` block; the audit hook of Python cannot be removed, and rests afterwards."""
    global _hooked
    with _hook_lock:
        if not _hooked:
            sys.addaudithook(_hear)
            _hooked = True
    watch, descriptor = Watch(writable, secret), _inotify(secret)
    _active.append(watch)
    try:
        yield watch
    finally:
        _active.remove(watch)
        if descriptor is not None:
            watch.events += [("read outside", name) for name in _heard(descriptor)]
            os.close(descriptor)


@contextmanager
def unwatched() -> Iterator[None]:
    """Without the watches, for what the campaign itself does in a case: they cost more than copying a small file."""
    resting, _active[:] = list(_active), []
    try:
        yield
    finally:
        _active[:] = resting


def _inotify(folder: Path) -> int | None:
    """A descriptor that hears of every access to a folder and its folders; None where the system has no inotify."""
    try:
        libc = ctypes.CDLL(None, use_errno=True)
        descriptor = libc.inotify_init1(os.O_NONBLOCK | os.O_CLOEXEC)
    except (OSError, AttributeError):
        return None
    if descriptor < 0:
        return None
    for place in (folder, *(path for path in folder.rglob("*") if path.is_dir())):
        libc.inotify_add_watch(descriptor, os.fsencode(place), EVENTS)
    return descriptor


def _heard(descriptor: int) -> list[str]:
    """The accesses so far, as (mask, name)."""
    try:
        data = os.read(descriptor, 1 << 16)
    except BlockingIOError:
        return []
    events, place = [], 0
    while place < len(data):
        _, mask, _, length = HEADER.unpack_from(data, place)
        name = data[place + HEADER.size : place + HEADER.size + length].rstrip(b"\0").decode(errors="replace")
        events.append(f"inotify {mask:#x} {name}")
        place += HEADER.size + length
    return events
