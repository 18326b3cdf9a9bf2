"""Tasks on workers that do not see the disk of the driver: each runs on local folders that stand for RUN and
experiment."""

from __future__ import annotations

import os
import platform
import secrets
import tempfile
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, fields, is_dataclass, replace
from pathlib import Path
from typing import Any

from idic.errors import InputError
from idic.remote_files import relocated_text
from idic.run.store.mirror.manifest import digest_of
from idic.run.store.mirror.mirror import Mirror, Written
from idic.run.store.mirror.objects import Objects, StoredObjects
from idic.run.workers.exchange import Exchange, Way, open_exchange
from idic.run.workers.probe import ExperimentToSee
from idic.run.workers.runner import TaskRunner, problem_of
from idic.run.workers.served_objects import ANSWER_SECONDS, ServedObjects


@dataclass(frozen=True)
class MirroredJob:
    """A job with what its worker needs to read files. lists : digests of the lists of files"""

    function: Callable[[Any], Any]
    job: Any
    way: Way
    lists: tuple[str, ...]


@dataclass(frozen=True)
class MirroredResult:
    """The result of a job and the files that it wrote."""

    value: Any
    written: Written

    @property
    def failed(self) -> str:
        """As of the value (`idic.run.workers.runner.problem_of`)."""
        return problem_of(self.value)


def run_mirrored(job: MirroredJob) -> MirroredResult:
    """Do a job on the local folders of this worker (a task); one at a time, as they follow the list of the job."""
    with _one_at_a_time:
        mirror = _mirror(job.way)
        mirror.follow(job.lists)
        value = job.function(relocated(job.job, mirror.moved))
        return MirroredResult(value, mirror.written())


def relocated(value: Any, moved: Mapping[str, str]) -> Any:
    """A job with other folders in its paths: texts and paths in records, mappings and lists."""
    if isinstance(value, str):
        return relocated_text(value, moved)
    if isinstance(value, Path):
        return Path(relocated_text(str(value), moved))
    if isinstance(value, Mapping):
        return {key: relocated(item, moved) for key, item in value.items()}
    if type(value) in (tuple, list):
        return type(value)(relocated(item, moved) for item in value)
    if is_dataclass(value) and not isinstance(value, type):
        return replace(value,
                       **{part.name: relocated(getattr(value, part.name), moved)
                          for part in fields(value) if part.init})
    return value


def drop_mirror(session: str) -> None:
    """Delete the local folders of a command on a worker."""
    with _one_at_a_time:
        mirror = _mirrors.pop(session, None)
        if mirror is not None:
            mirror.drop()


_one_at_a_time = threading.Lock()
_mirrors: dict[str, Mirror] = {}


def _mirror(way: Way) -> Mirror:
    if way.session not in _mirrors:
        place, folder = this_worker()
        _mirrors[way.session] = Mirror(Path(folder) / f"{way.session}-{os.getpid()}", objects_of(way, place), way.areas,
                                       place)
    return _mirrors[way.session]


def objects_of(way: Way, place: str) -> Objects:
    """What a worker reads from and writes to."""
    return StoredObjects(way.url, place) if way.url else ServedObjects(way.session, place)


def this_worker() -> tuple[str, str]:
    """The name of this worker for messages, and its local folder."""
    from distributed import get_worker

    worker = get_worker()
    return f"the worker {worker.address} on {platform.node()}", worker.local_directory


class MirroredRunner:
    """A `TaskRunner` whose workers do not see the disk of the driver."""

    sees_files = False

    def __init__(self, inner: TaskRunner, exchange: Exchange):
        self._inner, self._exchange = inner, exchange

    @property
    def workers(self) -> int:
        return self._inner.workers

    @property
    def dashboard(self) -> str | None:
        return self._inner.dashboard

    def threads_for(self, n_jobs: int) -> int:
        return self._inner.threads_for(n_jobs)

    def stream(self, function, jobs, names, retries=0, progress=None, ahead=None, copies=False,
               watch=None) -> Iterator[Any]:
        """See `TaskRunner.stream`; the files of a job are in the RUN before its result comes."""
        if not jobs:
            return
        lists = self._exchange.publish()
        sent = [MirroredJob(function, job, self._exchange.way, lists) for job in jobs]
        for result in self._inner.stream(run_mirrored, sent, names, retries, progress, ahead, copies, watch):
            self._exchange.take(result.written)
            yield result.value

    def map(self, function, jobs, names, retries=0, progress=None) -> list[Any]:
        """See `TaskRunner.map`."""
        return list(self.stream(function, jobs, names, retries, progress))

    def background(self, function, job, name) -> Callable[[], None]:
        """See `TaskRunner.background`."""
        return self._inner.background(run_mirrored,
                                      MirroredJob(function, job, self._exchange.way, self._exchange.publish()), name)


@contextmanager
def without_common_disk(runner: TaskRunner, store: str | None, run: Path | str,
                        experiments: Sequence[ExperimentToSee]) -> Iterator[TaskRunner]:
    """The runner itself, or with a store one whose workers need no common disk.

    Parameters
    ----------
    runner : on an existing cluster
    store : URL of fsspec, or ``driver``; None: the disk is common
    run, experiments : what the tasks read and write
    """
    if store is None:
        yield runner
        return
    client = runner.client  # type: ignore[attr-defined]
    with open_exchange(client, store, run, experiments) as exchange:
        try:
            yield MirroredRunner(runner, exchange)
        finally:
            with suppress(Exception):  # workers that are gone have nothing to delete
                client.run(drop_mirror, exchange.way.session)


def check_store(client, store: str) -> None:
    """Let every worker of a cluster read from a store and write to it; the objects of this probe are deleted.

    Raises
    ------
    InputError
        The driver or a worker cannot; it is named.
    """
    with tempfile.TemporaryDirectory(prefix="idic-") as nowhere, open_exchange(client, store, nowhere, ()) as exchange:
        token = secrets.token_bytes(16)
        name = exchange.put(token)
        try:
            for worker in client.nthreads():
                future = client.submit(_try_store, (exchange.way, name), workers=[worker],
                                       key=f"store-{name[:8]}-{worker}",
                                       pure=False)
                future.result(timeout=ANSWER_SECONDS)
        finally:
            exchange.drop([name, digest_of(token[::-1])])


def _try_store(job: tuple[Way, str]) -> None:
    """Read an object and write its content reversed (a task)."""
    way, name = job
    objects = objects_of(way, this_worker()[0])
    objects.put([objects.get(name)[::-1]])


def checked_store(store: str | None, scheduler: str | None) -> str | None:
    """The option ``--store``; `InputError` where idic starts the workers itself, which see the disk of this machine."""
    if store is not None and scheduler is None:
        raise InputError("a store, but no cluster", key="--store (or IDIC_STORE)", expected="--scheduler ADDRESS",
                         found=store,
                         remedy="leave --store out: worker processes of this machine see its disk")
    return store


def refuse_store(store: str | None, command: str) -> None:
    """`InputError` where ``--store`` is given to a command whose workers read the files of this machine."""
    if store is not None:
        raise InputError(f"idic {command} does not send files to its workers", key="--store (or IDIC_STORE)",
                         expected="workers with access to this disk", found=store,
                         remedy="leave --store out and use a common disk, or run each experiment by idic identify "
                         "--store, which takes several experiments too (also idic diagnose, idic systematic)")
