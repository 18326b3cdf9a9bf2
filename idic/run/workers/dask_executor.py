"""Dask on this machine (processes on the loopback interface) or an existing cluster, as a `TaskRunner`."""

from __future__ import annotations

import logging
import os
import socket
import time
import uuid
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from idic.errors import InputError
from idic.run.workers.dask_connection import LOOPBACK, connected
from idic.run.workers.dask_settings import be_quiet, cluster_settings
from idic.run.workers.mirrored_runner import check_store
from idic.run.workers.probe import ExperimentToSee, check_workers
from idic.run.workers.runner import SerialRunner, TaskRunner
from idic.run.workers.submission import ALLOWED_FAILURES, LostWorkers, Submission, WatchedCalls
from idic.run.workers.task_limits import TaskLimits, task_limits

MAX_WORKERS = 1024  # processes of this machine
SMALLEST_MEMORY = 350_000_000  # bytes of a worker process
START_ATTEMPTS = 3
_MAX_SETTLE_SECONDS = 10
_SECONDS_BETWEEN_LOOKS = 1.0  # for the worker of a task in the background
_MAX_IMPORT_SECONDS = 60  # on a slow file system; then the jobs are sent without waiting


def default_workers() -> int:
    """Number of processor cores that this process may use."""
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:  # not on this system
        return os.cpu_count() or 1


@contextmanager
def open_cluster(
    workers: int | None = None,
    scheduler: str | None = None,
    memory_limit: str | int | None = None,
    preload: Sequence[str] = (),
    threads: int = 1,
    say: Callable[[str], None] = lambda text: None,
) -> Iterator[TaskRunner]:
    """A runner for the length of a ``with`` block.

    Parameters
    ----------
    workers : int, optional
        Number of processes, one thread each; default one per core. 0: no cluster, all tasks in this process.
    scheduler : str, optional
        Address of an existing Dask scheduler, used instead; `workers` is then ignored.
    memory_limit : str or int, optional
        Per worker, as Dask reads it ("4GB"); default an equal share of the machine.
    preload : sequence of str
        Modules that the workers import while the driver continues, up to its first job.
    threads : int
        Of a simulation, where all tasks are in this process.
    say : callable
        Takes a line for the user: of workers that are lost.

    Raises
    ------
    InputError
        The scheduler cannot be reached, or is on another machine without TLS; a limit of tasks that is none
        (`idic.run.workers.task_limits`).
    """
    if scheduler is None and workers == 0:
        yield SerialRunner(threads)
        return
    limits = task_limits(scheduler)
    be_quiet()
    import dask
    import distributed

    with ExitStack() as stack:
        stack.enter_context(dask.config.set(cluster_settings(ALLOWED_FAILURES)))
        if scheduler is None:
            number = checked_workers(workers) or default_workers()
            client = stack.enter_context(_local(distributed, number, memory_limit))
        else:
            client = stack.enter_context(connected(scheduler))
        runner = DaskRunner(client, preload, limits, client.cluster if scheduler is None else None, say)
        try:
            yield runner
        finally:
            runner.close()


def checked_workers(workers: int | None) -> int | None:
    """The number of ``--workers``; `InputError` where it is none, or more than `MAX_WORKERS`."""
    if workers is not None and not 0 <= workers <= MAX_WORKERS:
        number = str(workers) if abs(workers) < 10**12 else "a number of more than 12 digits"
        raise InputError("not a number of worker processes", key="--workers", expected=f"0 to {MAX_WORKERS}",
                         found=number, remedy="one per core is enough; for several machines use --scheduler")
    return workers


def checked_memory_limit(limit: str | None, workers: int | None, scheduler: str | None) -> int | None:
    """Bytes of ``--memory-limit``, the memory of one worker process.

    Raises
    ------
    InputError
        The text is not a size, is less than the memory of an idle process, or idic starts no worker processes.
    """
    if limit is None:
        return None
    from dask.utils import parse_bytes

    try:
        size = parse_bytes(limit)
    except (ValueError, IndexError, OverflowError):  # no number, no unit, infinite
        size = 0
    if size < SMALLEST_MEMORY:
        raise InputError("not a usable memory limit", key="--memory-limit", found=limit,
                         expected=f"{SMALLEST_MEMORY // 10**6}MB or more for each worker process, e.g. 2GB",
                         remedy="raise the limit (an idle worker takes 0.3 GB) and use fewer --workers")
    if scheduler is not None or workers == 0:
        raise InputError("a memory limit, but idic starts no worker processes", key="--memory-limit",
                         expected="--workers N with N of 1 or more",
                         found="--workers 0" if scheduler is None else "--scheduler",
                         remedy="leave it out; for an existing cluster use `dask worker --memory-limit`")
    return size


def check_scheduler(scheduler: str | None, run: Path | str, experiments: Sequence[ExperimentToSee] = (),
                    say: Callable[[str], None] = lambda text: None, store: str | None = None) -> None:
    """Check an existing scheduler and each of its workers before the first write (None: no check).

    run, experiments, say : as of `check_workers`; store : through which workers without a common disk get their files

    Raises
    ------
    InputError
        As `open_cluster` and `check_workers`.
    """
    if scheduler is not None:
        be_quiet()
        with connected(scheduler) as client:
            if store is None:
                check_workers(client, experiments, run, say)
                return
            check_workers(client, experiments, None, say)
            check_store(client, store)


class DaskRunner:
    """A `TaskRunner` on a connected `distributed.Client`.

    preload : modules that the workers import at once; the first job is sent after these imports. A worker decodes jobs
        in one thread and runs them in another, and Python fails where both import a package for the first time.
    cluster : of workers that are processes of this machine, a core each
    say : takes a line for the user
    """

    sees_files = True

    def __init__(self, client, preload: Sequence[str] = (), limits: TaskLimits | None = None, cluster=None,
                 say: Callable[[str], None] = lambda text: None):
        self._client, self._limits, self._local = client, limits or TaskLimits(), cluster is not None
        self._lost = LostWorkers(client, cluster, self._limits.no_workers, say)
        self._calls = WatchedCalls(client)
        self._imports = {  # the references keep Dask from dropping the tasks
            worker: client.submit(_import_modules, tuple(preload), workers=[worker], key=f"import-{worker}", pure=False)
            for worker in client.nthreads() if preload
        }

    def _after_imports(self) -> None:
        """Wait for the imports of the idle workers."""
        end = time.monotonic() + _MAX_IMPORT_SECONDS
        while self._imports and time.monotonic() < end:
            idle = {worker for worker, keys in self._client.processing().items() if len(keys) <= 1}
            if all(future.done() for worker, future in self._imports.items() if worker in idle):
                break
            time.sleep(0.02)
        self._imports = {}

    @property
    def workers(self) -> int:
        """Number of threads of all workers together."""
        return max(1, sum(self._client.nthreads().values()))

    def threads_for(self, n_jobs: int) -> int:
        """See `TaskRunner.threads_for`: the cores of idle workers of this machine."""
        return max(1, self.workers // max(1, n_jobs)) if self._local else 1

    def close(self) -> None:
        """End what belongs to this runner alone; the client stays open."""
        self._calls.close()

    @property
    def client(self):
        """The `distributed.Client`."""
        return self._client

    @property
    def dashboard(self) -> str | None:
        """Address of the Dask dashboard; None where bokeh is not installed (`pip install idic[dashboard]`)."""
        from importlib.util import find_spec

        return self._client.dashboard_link if find_spec("bokeh") else None

    def stream(self, function, jobs, names, retries=0, progress=None, ahead=None, copies=False,
               watch=None) -> Iterator[Any]:
        """See `TaskRunner.stream`."""
        names = list(names)
        if len(names) != len(jobs):
            raise ValueError(f"{len(jobs)} jobs, {len(names)} names")
        self._after_imports()
        limits = replace(self._limits, retries=max(retries, self._limits.retries))
        submission = Submission(self._client, function, jobs, names, limits, copies,
                                None if watch is None else self._calls.topic, self._lost)
        if watch is not None:
            self._calls.add(submission.token, watch)
        try:
            yield from submission.in_order(progress, ahead or len(jobs))
        finally:
            submission.cancel()
            self._calls.drop(submission.token)

    def map(self, function, jobs, names, retries=0, progress=None) -> list[Any]:
        """See `TaskRunner.map`."""
        return list(self.stream(function, jobs, names, retries, progress))

    def background(self, function, job, name) -> Callable[[], None]:
        """See `TaskRunner.background`."""
        self._after_imports()
        worker = next(iter(self._client.nthreads()), None)
        future = self._client.submit(function, job, key=f"{name}-{uuid.uuid4().hex[:8]}", pure=False,
                                     workers=worker and [worker], allow_other_workers=worker is not None)
        return lambda: _wait(self._client, future, worker)


def _wait(client, future, worker: str | None) -> None:
    """Until the task is over, or lost with its worker.

    Dask gives a task that asked for a worker to others, but not once all workers were lost: it then waits for that
    address for ever.
    """
    with suppress(Exception):
        while not future.done():
            with suppress(TimeoutError):
                future.exception(timeout=_SECONDS_BETWEEN_LOOKS)
            if worker is not None and worker not in client.nthreads():
                future.cancel()
                return


# starting and connecting --------------------------------------------------------------------------
@contextmanager
def _local(distributed, workers: int, memory_limit):
    """A LocalCluster on the loopback interface; its workers end with this process, also after a kill."""
    with _left_to_this_process(distributed.SpecCluster):
        cluster = _started(distributed, workers, memory_limit)
        try:
            with distributed.Client(cluster, set_as_default=False) as client:
                yield client
        finally:
            _close(cluster)


@contextmanager
def _left_to_this_process(kind) -> Iterator[None]:
    """Clusters that an interruption leaves half started or half closed are not closed again at the end of Python, which
    fails with a traceback: their workers end with this process.

    kind : of clusters, with a register of its instances
    """
    earlier_clusters = set(map(id, kind._instances))
    try:
        yield
    finally:
        for cluster in list(kind._instances):
            if id(cluster) not in earlier_clusters:
                cluster.shutdown_on_close = False


def _started(distributed, workers: int, memory_limit, attempts: int = START_ATTEMPTS):
    """The cluster with all its workers; the death of a worker during the start leads to a new attempt."""
    try:
        return distributed.LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            processes=True,
            host=LOOPBACK,
            dashboard_address=f"{LOOPBACK}:{_free_port(8787)}",
            worker_dashboard_address=None,
            memory_limit="auto" if memory_limit is None else memory_limit,
            silence_logs=logging.CRITICAL,
        )
    except RuntimeError as problem:  # "Nanny failed to start"; Dask has closed its processes
        if attempts > 1:
            return _started(distributed, workers, memory_limit, attempts - 1)
        raise InputError(
            "the worker processes die during their start",
            expected=f"{workers} processes of this Python",
            found=f"{START_ATTEMPTS} failed attempts ({problem})",
            remedy="check the free memory and the limit on processes (free, ulimit -a); use fewer --workers, "
            "or --workers 0 for none; --resume continues an interrupted run",
        ) from problem


def _close(cluster) -> None:
    """Close a LocalCluster; an error does not affect the result and is only logged.

    Closing fails inside Dask while a lost worker is being replaced ("can only join a started process"); the function
    waits for the replacement. Remaining worker processes end with this process.
    """
    end = time.monotonic() + _MAX_SETTLE_SECONDS
    while not _settled(cluster) and time.monotonic() < end:
        time.sleep(0.05)
    try:
        cluster.close()
    except Exception as problem:  # noqa: BLE001 - see above
        logging.getLogger(__name__).info("closing the Dask cluster: %r", problem)


def _settled(cluster) -> bool:
    """No worker is being started, and all of them have reported to the scheduler."""
    processes = [getattr(nanny, "process", None) for nanny in cluster.workers.values()]
    starting = any(process is not None and process.status.name in ("init", "starting") for process in processes)
    return not starting and len(cluster.scheduler.workers) >= len(processes)


def _free_port(port: int) -> int:
    """`port` if it is free, otherwise 0 (any port)."""
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((LOOPBACK, port))
        except OSError:
            return 0
    return port


def _import_modules(names: tuple[str, ...]) -> None:
    from importlib import import_module

    for name in names:
        import_module(name)
