"""The files of a RUN between the driver, who keeps it, and workers that do not see its disk.

Before tasks are sent the driver lists what the RUN holds and stores what is new; after a task it takes what the worker
wrote. The way is an object storage (``--store s3://bucket/prefix``) or the connections of Dask (``--store driver``).
"""

from __future__ import annotations

import hashlib
import os
import platform
import secrets
import shutil
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from idic.errors import InputError
from idic.experiment_file import inputs_of
from idic.run.store.mirror.adopt import adopt
from idic.run.store.mirror.manifest import SMALL_BYTES, Entry, Manifest, Scanner, digest_of, encoded, inside, run_files
from idic.run.store.mirror.mirror import Written
from idic.run.store.mirror.objects import BATCH_BYTES, StoredObjects
from idic.run.workers.probe import ExperimentToSee
from idic.run.workers.served_objects import ObjectServer, read_file

DRIVER = "driver"  # --store driver
_INCOMING = ".incoming"  # RUN/.incoming: what workers have sent and no task has reported yet
_KEPT_LISTS = 3  # lists of files whose objects stay in the storage


@dataclass(frozen=True)
class Way:
    """How a worker reaches the files of a command.

    url : of the storage, "" where the driver serves; session : names this command; areas : paths of the driver and the
    folders that stand for them
    """

    url: str
    session: str
    areas: Mapping[str, str]


class Exchange:
    """The driver's side.

    Parameters
    ----------
    client : distributed.Client
    store : URL of fsspec, or ``driver``
    run : the RUN folder; experiments : what the tasks read besides
    """

    def __init__(self, client, store: str, run: Path, experiments: Sequence[ExperimentToSee]):
        self.run, self._scanner = run, Scanner()
        self._run_area = f"run/{run.name}"
        self._experiments = experiments
        self._kept: deque[set[str]] = deque(maxlen=_KEPT_LISTS)
        self._files: dict[str, str] = {}  # digest -> a file of the driver
        self._lists: dict[str, bytes] = {}
        self._stored: dict[str, int] = {}
        self._fixed: str | None = None
        session = f"idic-{secrets.token_hex(8)}"
        self._server, self._objects = None, None
        if store == DRIVER:
            shutil.rmtree(run / _INCOMING, ignore_errors=True)
            self._server = ObjectServer(client, session, self._found, run / _INCOMING)
            url = ""
        else:
            url = f"{store.rstrip('/')}/{run.name}-{_own_name(run)}"
            self._objects = StoredObjects(url, "the driver")
            self._stored = self._objects.sizes()
        self._fixed_files, areas = self._experiment_files()
        self.way = Way(url, session, {str(run): self._run_area, str(run.resolve()): self._run_area, **areas})

    def publish(self) -> tuple[str, str]:
        """Make all that tasks may read available; returns the digests of the lists of files that a task needs."""
        if self._fixed is None:
            self._fixed = self._listed(*self._fixed_files)
        entries, paths = {}, {}
        for path in run_files(self.run):
            with suppress(FileNotFoundError):  # removed meanwhile
                entry = self._scanner.entry(path)
                key = f"{self._run_area}/{os.path.relpath(path, self.run).replace(os.sep, '/')}"
                entries[key], paths[key] = entry, path
        current = self._listed(entries, paths)
        self._kept.append({current, *(entry.sha256 for entry in entries.values())})
        self._forget_old()
        return self._fixed, current

    def take(self, written: Written) -> None:
        """Write what a worker has made into the RUN."""
        prefix = f"{self._run_area}/"
        files = {key.removeprefix(prefix): entry for key, entry in written.files.items() if key.startswith(prefix)}
        adopt(self.run, files, self._content, self._scanner)
        for key, entry in files.items():
            self._files[entry.sha256] = str(inside(self.run, key))
            if entry.size > SMALL_BYTES and self._objects is not None:
                self._stored[entry.sha256] = entry.size
            if self._server is not None:
                (self.run / _INCOMING / entry.sha256).unlink(missing_ok=True)

    def put(self, content: bytes) -> str:
        """Make a content available under its digest, which is returned."""
        name = digest_of(content)
        self._lists[name] = content
        if self._objects is not None and self._stored.get(name) != len(content):
            self._objects.put([content])
            self._stored[name] = len(content)
        return name

    def drop(self, names: Sequence[str]) -> None:
        """Delete contents of `put`, or of workers."""
        for name in names:
            self._lists.pop(name, None)
            self._stored.pop(name, None)
        if self._objects is not None:
            self._objects.delete(names)

    def close(self) -> None:
        """End the server; the objects of the RUN's present state stay, for ``--resume``."""
        if self._server is not None:
            self._server.close()
            shutil.rmtree(self.run / _INCOMING, ignore_errors=True)

    def _experiment_files(self) -> tuple[tuple[Manifest, dict[str, str]], dict[str, str]]:
        """The list of all files of the experiments, their paths, and the areas of their folders."""
        entries: dict[str, Entry] = {}
        paths: dict[str, str] = {}
        areas: dict[str, str] = {}
        for experiment in self._experiments:
            inputs = inputs_of(experiment.path, experiment.overrides)
            folder = experiment.path if os.path.isdir(experiment.path) else os.path.dirname(experiment.path)
            area = areas.setdefault(str(inputs.folder), f"experiment-{len(areas)}/{inputs.folder.name}")
            areas[os.path.abspath(folder)] = area
            for path in inputs.read_files:
                key = f"{area}/{path.relative_to(inputs.folder).as_posix()}"
                entries[key], paths[key] = self._scanner.entry(str(path)), str(path)
            for path, facts in inputs.images.items():
                entries[f"{area}/{path.relative_to(inputs.folder).as_posix()}"] = Entry(facts.size, image=facts)
        return (entries, paths), areas

    def _listed(self, entries: Manifest, paths: Mapping[str, str]) -> str:
        """Store what a list names and the list; returns the digest of the list."""
        batch: list[bytes] = []
        for key, path in paths.items():
            entry = entries[key]
            if entry.content is not None:
                continue
            self._files[entry.sha256] = path
            if self._objects is not None and self._stored.get(entry.sha256) != entry.size:
                batch.append(Path(path).read_bytes())
                self._stored[entry.sha256] = entry.size
                if sum(map(len, batch)) > BATCH_BYTES:
                    self._objects.put(batch)
                    batch = []
        if batch and self._objects is not None:
            self._objects.put(batch)
        return self.put(encoded(entries))

    def _forget_old(self) -> None:
        """Delete objects that none of the last lists names."""
        needed = set().union(*self._kept) | {self._fixed} | {entry.sha256 for entry in self._fixed_files[0].values()}
        for name in [name for name in self._files if name not in needed]:
            del self._files[name]
        if len(self._kept) == _KEPT_LISTS:
            self.drop([name for name in {*self._lists, *self._stored} if name not in needed])

    def _found(self, sha256: str) -> bytes | None:
        """A content that a worker asks for."""
        if sha256 in self._lists:
            return self._lists[sha256]
        path = self._files.get(sha256)
        return None if path is None else read_file(path)

    def _content(self, entry: Entry) -> bytes:
        """The checked content of a file that a worker reported."""
        content = entry.content
        if content is None and self._server is not None:
            content = self._server.received(entry.sha256) or self._found(entry.sha256)
        elif content is None and self._objects is not None:
            return self._objects.get(entry.sha256)
        if content is None or digest_of(content) != entry.sha256:
            raise InputError("a file that a worker reported did not arrive", file=self.run,
                             expected=f"{entry.size} bytes",
                             found="none" if content is None else "another content",
                             remedy="run the command again with --resume")
        return content


@contextmanager
def open_exchange(client, store: str, run: Path | str, experiments: Sequence[ExperimentToSee]) -> Iterator[Exchange]:
    """An exchange for the length of a ``with`` block."""
    exchange = Exchange(client, store, Path(run).absolute(), experiments)
    try:
        yield exchange
    finally:
        exchange.close()


def _own_name(run: Path) -> str:
    """Tells the RUN folders of one storage apart; the same for a run that is resumed."""
    return hashlib.sha256(f"{platform.node()}:{run.resolve()}".encode()).hexdigest()[:12]
