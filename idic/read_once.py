"""Files that many experiments of one command share: their mesh, the headers of their images.

A diagnosis opens the same folder with some hundred overrides. Within `files_read_once`, what was read from a file is
kept while the file has the same size and time. Elsewhere every file is read anew.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import Any, TypeVar

Content = TypeVar("Content")
_kept: ContextVar[dict[tuple[str, str], tuple[tuple[int, int], Any]] | None] = ContextVar("read files", default=None)


@contextmanager
def files_read_once() -> Iterator[None]:
    """Keep what `read_once` reads for the length of a ``with`` block, of the outermost one where they are nested."""
    if _kept.get() is not None:
        yield
        return
    token = _kept.set({})
    try:
        yield
    finally:
        _kept.reset(token)


def read_once(read: Callable[[Path], Content], path: Path) -> Content:
    """The content of a file; within `files_read_once`, later calls return the same object: do not change it."""
    kept = _kept.get()
    if kept is None:
        return read(path)
    key = (f"{read.__module__}.{read.__qualname__}", str(path))
    stamp = _stamp(path)
    known = kept.get(key)
    if known is None or stamp is None or known[0] != stamp:
        content = read(path)
        if stamp is not None:
            kept[key] = stamp, content
        return content
    return known[1]


def _stamp(path: Path) -> tuple[int, int] | None:
    """Size and time of a file; None where there is none: the reader says what is wrong."""
    try:
        facts = path.stat()
    except OSError:
        return None
    return facts.st_size, facts.st_mtime_ns


__all__ = ["files_read_once", "read_once"]
