"""The image files of a RUN: their content when they were ingested, and whether it has changed.

The identity of an experiment hashes the ends of every image alone, as it is asked for at every start of a worker. Here
whole files are hashed, once at ingest, and again on ``--resume`` where size or time of a file have changed.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping
from pathlib import Path

from idic.errors import InputError
from idic.images import Stack

FILES = "files"  # attribute of ingested frames


def files_of(stack: Stack, frames: Iterable[int]) -> list[Path]:
    """The files of some frames, each once; none for images that are no files."""
    entries = getattr(stack, "entries", None)
    return [] if entries is None else list(dict.fromkeys(entries[k].path for k in frames))


def describe(path: Path) -> dict:
    """Size, time of the last change and content of a file, for JSON."""
    status = path.stat()
    return {"name": path.name, "size": status.st_size, "mtime_ns": status.st_mtime_ns, "sha256": _content(path)}


def refuse_changed(stack: Stack, descriptions: Iterable[Mapping]) -> None:
    """Check that the files of a stack are unchanged since they were ingested.

    descriptions : their descriptions of then, in the same order

    Raises
    ------
    InputError
        A file has changed, is missing or is another one.
    """
    paths = files_of(stack, range(stack.n_frames))
    for path, description in zip(paths, descriptions, strict=False):
        status = path.stat()
        if (status.st_size, status.st_mtime_ns) == (description["size"], description["mtime_ns"]):
            continue
        if status.st_size != description["size"] or _content(path) != description["sha256"]:
            raise InputError("an image has changed since this run began", file=path,
                             expected=f"the content that was ingested (sha256 {description['sha256'][:16]})",
                             found="other content", remedy="restore the image, or identify it again into a new RUN")


def _content(path: Path) -> str:
    if path.is_dir():
        files = [file for file in sorted(path.rglob("*")) if file.is_file()]
        contents = repr([(str(file.relative_to(path)), _content(file)) for file in files])
        return hashlib.sha256(contents.encode()).hexdigest()
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
