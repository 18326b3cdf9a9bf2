"""Files of the driver in a process that does not see its disk: where they lie here, and how one comes when it is read.

A worker without a common disk has a local folder in place of the RUN folder and of every experiment (a mirror,
`idic.run.store.mirror`). Those who read files ask here: `here` for the local path of a path of the driver, `fetch`
before
they open a file that may not have come yet, `image_facts` for what the driver read from an image that never comes.
Without a mirror, which is the ordinary case, all three do nothing.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol


@dataclass(frozen=True)
class ImageFacts:
    """What an image file holds besides its pixels.

    size : bytes; ends_sha256 : digest of its ends (`idic.experiment_file.recording.ends_of`); entries : the fields of
    each `idic.readers.images.ImageEntry` after its path
    """

    size: int
    ends_sha256: str
    entries: tuple[tuple[Any, ...], ...]


class Remote(Protocol):
    """Another machine, as a local folder sees it."""

    def fetch(self, path: str) -> None:
        """Bring a file to its local path, unless it is there or the other machine has none of that name."""

    def image_facts(self, path: str) -> ImageFacts | None:
        """What is known of an image; None for other files."""


_remotes: dict[str, Remote] = {}  # local folder -> where its files come from
_moved: dict[str, str] = {}  # path of the driver -> local folder
_recorders: list[set[str]] = []


def register(folder: str, remote: Remote, moved: Mapping[str, str]) -> None:
    """Let the files of a local folder come from another machine.

    moved : paths of the driver, and the local folders (below `folder`) that stand for them
    """
    _remotes[folder] = remote
    _moved.update(moved)


def forget(folder: str) -> None:
    """End `register`."""
    _remotes.pop(folder, None)
    for name in [name for name, place in _moved.items() if _is_inside(place, folder)]:
        del _moved[name]


def here(path: str) -> str:
    """The local path of a path of the driver; unchanged where the disk is common."""
    return relocated_text(path, _moved) if _moved else path


def relocated_text(text: str, moved: Mapping[str, str]) -> str:
    """A path below one of these folders, moved; any other text as it is. The deepest folder counts."""
    for folder in sorted(moved, key=len, reverse=True):
        if _is_inside(text, folder):
            return moved[folder] + text[len(folder):]
    return text


def fetch(path: Path | str) -> None:
    """Bring a file that may be on another machine; nothing happens where it is not in a mirror."""
    for recorder in _recorders:
        recorder.add(os.fspath(path))
    remote = _remote_of(path) if _remotes else None
    if remote is not None:
        remote.fetch(os.fspath(path))


@contextmanager
def fetched_files() -> Iterator[set[str]]:
    """The files that `fetch` is called for during a ``with`` block."""
    paths: set[str] = set()
    _recorders.append(paths)
    try:
        yield paths
    finally:
        _recorders.remove(paths)


def image_facts(path: Path | str) -> ImageFacts | None:
    """What is known of an image on another machine; None for an ordinary file."""
    remote = _remote_of(path) if _remotes else None
    return None if remote is None else remote.image_facts(os.fspath(path))


def _remote_of(path: Path | str) -> Remote | None:
    text = os.fspath(path)
    return next((remote for folder, remote in _remotes.items() if _is_inside(text, folder)), None)


def _is_inside(path: str, folder: str) -> bool:
    return path == folder or path.startswith(folder + os.sep)
