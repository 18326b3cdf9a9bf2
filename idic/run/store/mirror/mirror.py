"""Local folders of a worker in place of the folders of the driver: they follow a manifest; large files come when they
are read."""

from __future__ import annotations

import os
import shutil
import uuid
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from idic.errors import InputError
from idic.inside import replace_file
from idic.remote_files import ImageFacts, forget, register
from idic.run.store.mirror.manifest import SMALL_BYTES, ZARR, Entry, Manifest, Scanner, decoded
from idic.run.store.mirror.objects import Objects
from idic.run.store.run_lock import LOCK_NAME

_KEPT = ".kept"  # large files that no manifest lists yet: what a task made is listed once the driver has it
_NEW_BYTES = 64_000_000  # of new files that are read and sent at a time


@dataclass(frozen=True)
class Written:
    """Files that a task made: digest, size and, of small files, content, by AREA/path."""

    files: Manifest


class Mirror:
    """The local folders of one command. See `idic.remote_files.Remote`.

    Parameters
    ----------
    folder : of this process alone
    objects : where contents come from and go to
    moved : paths of the driver -> areas below `folder`
    place : this worker, for messages
    """

    def __init__(self, folder: Path, objects: Objects, moved: Mapping[str, str], place: str):
        self.folder, self._objects, self._place = folder, objects, place
        self.moved = {path: str(folder / area) for path, area in moved.items()}
        self._scanner = Scanner()
        self._manifests: dict[str, Manifest] = {}
        self._listed: dict[str, Entry] = {}
        self._kept = folder / _KEPT
        self._kept.mkdir(parents=True, exist_ok=True)
        register(str(folder), self, self.moved)

    def follow(self, names: tuple[str, ...]) -> None:
        """Bring the folders to the state of these manifests: what is gone or altered is deleted, small files are
        written.

        names : digests of the manifests, which are objects themselves
        """
        if set(names) != set(self._manifests):
            self._manifests = {name: self._manifests.get(name) or decoded(self._objects.get(name)) for name in names}
            self._listed = {key: entry for manifest in self._manifests.values() for key, entry in manifest.items()}
            digests = {entry.sha256 for entry in self._listed.values()}
            for path in list(self._kept.iterdir()):
                if path.name not in digests:
                    path.unlink()
        for path in self._files():
            entry = self._listed.get(self._key(path))
            if entry is None or not self._is(path, entry):
                self._put_aside(path)
        for key, entry in self._listed.items():
            path = str(self.folder / key)
            if os.path.exists(path):
                continue
            if entry.content is not None:
                self._write(path, entry.content)
            elif entry.image is not None and not entry.sha256:
                self._write(path, b"")  # its name counts; its pixels lie in the RUN
            elif not _is_chunk(key):
                self._bring(path, entry)
        self._prune()

    def fetch(self, path: str) -> None:
        """See `idic.remote_files.Remote`."""
        entry = self._listed.get(self._key(path))
        if entry is None:
            return
        if entry.image is not None and not entry.sha256:
            raise InputError("a worker without a common disk needs an image that was not sent", file=path,
                             expected="images of the RUN", found=f"pixels of the experiment folder on {self._place}",
                             remedy="run this command without --store, on workers that see the experiment folder")
        if not os.path.exists(path):
            self._bring(path, entry)

    def image_facts(self, path: str) -> ImageFacts | None:
        """See `idic.remote_files.Remote`."""
        entry = self._listed.get(self._key(path))
        return None if entry is None else entry.image

    def written(self) -> Written:
        """Send the files that are new since `follow`; a new group counts whole."""
        entries = {self._key(path): self._scanner.entry(path) for path in self._files()}
        changed = {key for key, entry in entries.items() if not _same(self._listed.get(key), entry)}
        groups = tuple(key.removesuffix("zarr.json") for key in changed if key.endswith("/zarr.json"))
        new_entries = {key: entry for key, entry in entries.items() if key in changed
                       or key.startswith(groups)} if changed else {}
        batch: list[bytes] = []
        for key, entry in new_entries.items():
            if entry.size > SMALL_BYTES:
                batch.append((self.folder / key).read_bytes())
                if sum(map(len, batch)) > _NEW_BYTES:
                    self._objects.put(batch)
                    batch = []
        if batch:
            self._objects.put(batch)
        return Written(new_entries)

    def drop(self) -> None:
        """Delete the folders."""
        forget(str(self.folder))
        shutil.rmtree(self.folder, ignore_errors=True)

    def _files(self) -> list[str]:
        """All files but those of groups that were never finished, except where the driver builds the group."""
        paths = []
        for base, folders, names in os.walk(self.folder):
            folders[:] = [name for name in folders if self._counts(os.path.join(base, name))]
            paths += [os.path.join(base, name) for name in names
                      if name != LOCK_NAME and not name.endswith((".tmp", ".partial"))]
        return paths

    def _counts(self, folder: str) -> bool:
        """Whether a folder is no leftover of a task that failed, and none of this class."""
        name = os.path.basename(folder)
        if name.startswith(".") and name.endswith((".tmp", ".old")):
            return f"{self._key(folder)}/zarr.json" in self._listed
        return name != _KEPT

    def _is(self, path: str, entry: Entry) -> bool:
        if entry.image is not None and not entry.sha256:
            return True
        return _same(self._scanner.entry(path), entry)

    def _put_aside(self, path: str) -> None:
        """Take a file out of the folders; a large one is kept under its digest until the next manifest."""
        entry = self._scanner.entry(path)
        if entry.content is not None:
            os.unlink(path)
        else:
            replace_file(path, self._kept / entry.sha256)

    def _bring(self, path: str, entry: Entry) -> None:
        stored = self._kept / entry.sha256
        if stored.exists():
            os.makedirs(os.path.dirname(path), exist_ok=True)
            replace_file(stored, path)
        else:
            self._write(path, self._objects.get(entry.sha256) if entry.content is None else entry.content)

    def _write(self, path: str, content: bytes) -> None:
        os.makedirs(os.path.dirname(path), exist_ok=True)
        temporary = f"{os.path.dirname(path)}/.{uuid.uuid4().hex[:12]}.tmp"
        with open(temporary, "wb") as stream:
            stream.write(content)
        replace_file(temporary, path)

    def _prune(self) -> None:
        """Delete folders without files: an absent array or group has no folder."""
        for base, _, _ in os.walk(self.folder, topdown=False):
            if base not in (str(self.folder), str(self._kept)) and not os.listdir(base):
                os.rmdir(base)

    def _key(self, path: str) -> str:
        return os.path.relpath(path, self.folder).replace(os.sep, "/")


def _same(earlier: Entry | None, entry: Entry) -> bool:
    return earlier is not None and earlier.sha256 == entry.sha256


def _is_chunk(key: str) -> bool:
    """Whether a file is a chunk of an array, which is large and read in parts."""
    return f"{ZARR}/" in key and not key.endswith("/zarr.json")
