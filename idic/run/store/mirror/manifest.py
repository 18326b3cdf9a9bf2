"""The list of files that workers may read: path, digest and size of each; small ones with their content."""

from __future__ import annotations

import base64
import hashlib
import json
import os
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from idic.errors import InputError
from idic.remote_files import ImageFacts
from idic.run.store.layout import EXPERIMENTS

SMALL_BYTES = 4096  # of a file that travels inside the list: descriptions of arrays, most numbers of a point
ZARR = ".zarr"


@dataclass(frozen=True)
class Entry:
    """A file of the driver.

    sha256 : of its content, "" where its content is never sent; content : of a small file
    image : what is known of an image file
    """

    size: int
    sha256: str = ""
    content: bytes | None = None
    image: ImageFacts | None = None


Manifest = Mapping[str, Entry]  # by AREA/path, with slashes


def digest_of(content: bytes) -> str:
    """The name of a content."""
    return hashlib.sha256(content).hexdigest()


def encoded(manifest: Manifest) -> bytes:
    """A manifest as the content of an object."""
    plain = {}
    for key, entry in manifest.items():
        fields: dict = {"size": entry.size, "sha256": entry.sha256}
        if entry.content is not None:
            fields["content"] = base64.b64encode(entry.content).decode("ascii")
        if entry.image is not None:
            fields["image"] = [entry.image.size, entry.image.ends_sha256, entry.image.entries]
        plain[key] = fields
    return zlib.compress(json.dumps(plain).encode(), 1)


def decoded(content: bytes) -> Manifest:
    """The inverse of `encoded`."""
    entries = {}
    for key, fields in json.loads(zlib.decompress(content)).items():
        image = fields.get("image")
        facts = None if image is None else ImageFacts(image[0], image[1], tuple(map(tuple, image[2])))
        small = fields.get("content")
        entries[key] = Entry(fields["size"], fields["sha256"], None if small is None else base64.b64decode(small),
                             facts)
    return entries


class Scanner:
    """Digests of files, kept while size, time and number of a file are the same."""

    def __init__(self) -> None:
        self._known: dict[str, tuple[tuple, Entry]] = {}

    def entry(self, path: str) -> Entry:
        """The entry of a file as it is now."""
        status = os.stat(path)
        age = (status.st_ino, status.st_mtime_ns, status.st_size)
        cached = self._known.get(path)
        if cached is None or cached[0] != age:
            with open(path, "rb") as stream:
                if status.st_size <= SMALL_BYTES:
                    content = stream.read()
                    cached = age, Entry(len(content), digest_of(content), content)
                else:
                    cached = age, Entry(status.st_size, hashlib.file_digest(stream, "sha256").hexdigest())
            self._known[path] = cached
        return cached[1]

    def expect(self, path: str, entry: Entry) -> None:
        """Take over the digest of a file that was just written."""
        status = os.stat(path)
        self._known[path] = ((status.st_ino, status.st_mtime_ns, status.st_size), entry)


def run_files(run: Path) -> Iterator[str]:
    """The files of a RUN that a task may read: its JSON files and Zarr stores, groups under construction included."""
    folders = [run, *(folder for folder in sorted((run / EXPERIMENTS).glob("*")) if folder.is_dir())]
    for folder in folders:
        for path in sorted(folder.glob("*.json")):
            if not path.name.startswith("."):
                yield str(path)
        for store in sorted(folder.glob(f"*{ZARR}")):
            yield from _files_below(store)


def _files_below(store: Path) -> Iterator[str]:
    for base, folders, names in os.walk(store):
        folders[:] = [name for name in folders if not name.endswith(".old")]
        for name in names:
            if not name.endswith((".tmp", ".partial")):
                yield os.path.join(base, name)


def inside(folder: Path, relative: str) -> Path:
    """A path below a folder; `InputError` where it would lie outside, by its name or by a link."""
    path = folder / relative
    if os.path.isabs(relative) or ".." in Path(relative).parts or not path.resolve().is_relative_to(folder.resolve()):
        raise InputError("a file of a worker would lie outside of the RUN", file=folder, expected="a path inside it",
                         found=relative, remedy="check which programs have access to the scheduler and to the store")
    return path
