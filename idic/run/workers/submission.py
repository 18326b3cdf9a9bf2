"""The jobs of one call on a Dask cluster: results in job order, lost workers, and jobs that straggle."""

from __future__ import annotations

import queue
import time
import uuid
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from idic.errors import InputError
from idic.run.workers.runner import JobKillsWorkers, Watch, problem_of, told
from idic.run.workers.task_limits import HERE, MAX_WITHOUT_S, NO_WORKERS, WAIT, TaskLimits

ALLOWED_FAILURES = 8  # deaths of workers before a job fails; deaths caused by other jobs count too
_FETCH_SECONDS = 5.0  # of a result, before the first look whether its worker is still there
_LOOK_SECONDS = 1.0  # between looks for tasks that straggle, and for workers
_REMARK_AFTER_S = 60.0  # without one of the workers


@dataclass(frozen=True)
class WatchedJob:
    """A job whose worker tells when it starts and ends.

    topic : of Dask's events, to which the driver listens; call : token of the call; number : of the job in it
    """

    function: Callable[[Any], Any]
    job: Any
    topic: str
    call: str
    number: int


def run_watched(watched: WatchedJob) -> Any:
    """Do a job and tell the driver of its start and its end (a task)."""
    from distributed import get_worker

    worker, attempt = get_worker(), uuid.uuid4().hex

    def tell(**message) -> None:
        with suppress(Exception):  # the worker is being closed
            worker.log_event(watched.topic, {"call": watched.call, "attempt": attempt} | message)

    tell(job=watched.number, place=f"worker {worker.address}")
    try:
        result = watched.function(watched.job)
    except BaseException as problem:
        tell(problem=told(problem))
        raise
    tell(problem=problem_of(result))
    return result


class WatchedCalls:
    """The calls of one client whose watches are told by events of the cluster, each before the result that it is
    about."""

    def __init__(self, client):
        self._client, self.topic = client, f"idic-{client.id}"
        self._watches: dict[str, Watch] = {}
        self._listens = False

    def add(self, call: str, watch: Watch) -> None:
        """Tell `watch` of the jobs of a call from now on."""
        self._watches[call] = watch
        if not self._listens:
            self._client.subscribe_topic(self.topic, self._hear_job)
            self._client.subscribe_topic("all", self._hear_cluster)
            self._listens = True

    def drop(self, call: str) -> None:
        """Tell no more."""
        self._watches.pop(call, None)

    def close(self) -> None:
        """Listen no more; a scheduler that tells a client which is gone logs an error."""
        if self._listens:
            self._listens = False
            with suppress(Exception):  # the scheduler may be gone
                for topic in (self.topic, "all"):
                    self._client.unsubscribe_topic(topic)

    def _hear_job(self, event: tuple[float, Mapping]) -> None:
        message = event[1]
        watch = self._watches.get(message["call"])
        if watch is None:
            return
        if "place" in message:
            watch.started(message["job"], message["attempt"], message["place"])
        else:
            watch.ended(message["attempt"], message["problem"])

    def _hear_cluster(self, event: tuple[float, Mapping]) -> None:
        if event[1].get("action") == "remove-worker":
            for watch in list(self._watches.values()):
                watch.lost(f"worker {event[1]['worker']}")


class LostWorkers:
    """Watches the number of workers while a call waits for its jobs.

    A worker of this machine that is gone for good is replaced: Dask itself gives up on one that is lost a second time
    while it starts again.

    Parameters
    ----------
    client : of Dask
    cluster : of workers of this machine; None: an existing one, whose workers come and go
    no_workers : as of `TaskLimits`
    say : takes a line for the user
    """

    def __init__(self, client, cluster, no_workers: str, say: Callable[[str], None]):
        self._client, self._cluster, self._choice, self._say = client, cluster, no_workers, say
        self._expected = 1 if cluster is None else len(cluster.worker_spec)
        self._looked = self._complete = time.monotonic()
        self._any = self._complete
        self._remarked = False

    def look(self) -> bool:
        """Replace and remark; whether the jobs are to be done in this process.

        Raises
        ------
        InputError
            No worker has been there for too long, and the run is to end then.
        """
        clock = time.monotonic()
        if clock - self._looked < _LOOK_SECONDS:
            return False
        self._looked = clock
        try:
            number = len(self._client.nthreads())
        except Exception:  # noqa: BLE001  (the scheduler cannot be asked; its jobs tell when it is lost)
            return False
        self._any = clock if number else self._any
        if number >= self._expected:
            if self._remarked:
                self._say(f"{number} of {self._expected} workers are there again")
            self._complete, self._remarked = clock, False
            return False
        if self._cluster is not None and not self._cluster.loop.asyncio_loop.is_closed():
            self._cluster.loop.add_callback(_replace_closed, self._cluster)
        if clock - self._complete > _REMARK_AFTER_S and not self._remarked:
            self._remarked = True
            self._say(f"{number} of {self._expected} workers for {clock - self._complete:.0f} s: "
                      + ("the others do their jobs" if number else "the jobs wait"))
        return self._is_over(clock - self._any)

    def _is_over(self, without_s: float) -> bool:
        if without_s < MAX_WITHOUT_S or self._choice == WAIT:
            return False
        if self._choice == HERE:
            return True
        raise InputError("there are no workers", expected="at least one worker process",
                         found=f"none for {without_s:.0f} s",
                         remedy=f"check memory and cluster, then run the command again with --resume; "
                                f"{NO_WORKERS}=wait waits for workers, {NO_WORKERS}=here goes on without")


def _replace_closed(cluster) -> None:
    """Start a worker in the place of each that has closed (in the loop of the cluster)."""
    for name, nanny in list(cluster.workers.items()):
        if nanny.status.name in ("closed", "failed"):
            del cluster.workers[name]
    if set(cluster.worker_spec) - set(cluster.workers):
        cluster.scale(len(cluster.worker_spec))


class Submission:
    """The submitted and completed jobs of one call; a job has a second copy where its first one straggles."""

    def __init__(self, client, function: Callable, jobs: Sequence, names: list[str], limits: TaskLimits, copies: bool,
                 topic: str | None = None, lost: LostWorkers | None = None):
        self._client, self._function, self._jobs = client, function, jobs
        self._names, self._limits, self._copies = names, limits, copies
        self._lost, self._topic = lost, topic  # of events; None: without a watch
        self.token = uuid.uuid4().hex[:8]  # keys are unique: Dask would answer a known key from memory
        self._waiting: dict[Any, int] = {}  # future -> its job
        self._began: dict[int, float] = {}
        self._twice: set[int] = set()
        self._arrived: queue.SimpleQueue = queue.SimpleQueue()
        self._slowest = 0.0

    def in_order(self, progress, ahead: int) -> Iterator[Any]:
        total, submitted, count, back = len(self._jobs), 0, 0, {}
        for number in range(total):
            while submitted < min(total, number + max(1, ahead)):
                self._submit(submitted)
                submitted += 1
            while number not in back:
                future, index = self._next()
                try:
                    back[index] = self._function(self._jobs[index]) if future is None else self._result(future, index)
                except JobKillsWorkers as problem:
                    back[index] = problem  # in the place of its result: what earlier jobs did is not lost
                count += 1
                if progress is not None:
                    progress(count, total)
            result = back.pop(number)
            if isinstance(result, JobKillsWorkers):
                raise result
            yield result

    def _submit(self, index: int, copy: str = "", workers: list[str] | None = None) -> None:
        key = f"{self._names[index]}{copy}-{self.token}-{index}"
        function, job = self._function, self._jobs[index]
        if self._topic is not None:
            function, job = run_watched, WatchedJob(function, job, self._topic, self.token, index)
        future = self._client.submit(function, job, key=key, pure=False,
                                     retries=self._limits.retries, workers=workers)
        self._waiting[future] = index
        self._began.setdefault(index, time.monotonic())
        future.add_done_callback(self._arrived.put)

    def _next(self) -> tuple[Any | None, int]:
        """The next job that is done, its other copy being cancelled; no future: it is to be done in this process."""
        while True:
            if self._lost is not None and self._lost.look():
                return None, self._taken_back()
            try:
                future = self._arrived.get(timeout=_LOOK_SECONDS)
            except queue.Empty:
                self._copy_stragglers()
                continue
            index = self._waiting.pop(future, None)
            if index is None:
                continue  # the second copy of a job that is done
            copies = [copy for copy, job_index in self._waiting.items() if job_index == index]
            if future.status != "finished" and copies:
                continue  # the other copy may succeed
            for copy in copies:
                del self._waiting[copy]
            if copies:
                self._client.cancel(copies, force=True)
            self._slowest = max(self._slowest, time.monotonic() - self._began[index])
            return future, index

    def _taken_back(self) -> int:
        """The first waiting job, which no worker does any more."""
        index = min(self._waiting.values())
        futures = [future for future, number in self._waiting.items() if number == index]
        for future in futures:
            del self._waiting[future]
        self._client.cancel(futures, force=True)
        return index

    def _copy_stragglers(self) -> None:
        """Give jobs that take too long to free workers as well; the first result counts."""
        limit = self._limits.straggles_after(self._slowest)
        late = [index for index in dict.fromkeys(self._waiting.values())
                if index not in self._twice and time.monotonic() - self._began[index] > limit]
        if not (self._copies and late):
            return
        idle_workers = [worker for worker, keys in self._client.processing().items() if not keys]
        for index, worker in zip(late, idle_workers, strict=False):
            self._twice.add(index)
            self._submit(index, "-again", [worker])

    def _result(self, future, index: int):
        from distributed import KilledWorker
        from distributed.client import FutureCancelledError

        try:
            return self._fetched(future, index)
        except KilledWorker as problem:
            killer = JobKillsWorkers(
                f"the worker processes keep dying on {self._names[index]}",
                found=f"{ALLOWED_FAILURES + 1} deaths; memory is the usual reason",
                remedy="use fewer --workers, a smaller model or image region, or a machine with more memory; "
                "then run the command again with --resume",
            )
            killer.job = index
            raise killer from problem
        except FutureCancelledError as problem:
            raise InputError(
                "the connection to the Dask scheduler was lost",
                found=str(problem),
                remedy="check that the scheduler still runs, then run the command again with --resume",
            ) from problem

    def _fetched(self, future, index: int):
        """The result of a job that is done; where its worker was lost with it, of the same job done again.

        Dask computes it again by itself as long as there are workers. Each pause between two looks is twice as long, so
        that a large result arrives at last.
        """
        pause_s = _FETCH_SECONDS
        while True:
            try:
                return future.result(timeout=pause_s)
            except TimeoutError:
                if future.status == "error":  # of the job itself
                    raise
            if self._lost is not None and self._lost.look():
                self._client.cancel([future], force=True)
                return self._function(self._jobs[index])
            pause_s *= 2.0

    def cancel(self) -> None:
        if self._waiting:
            self._client.cancel(list(self._waiting), force=True)
            self._waiting = {}
