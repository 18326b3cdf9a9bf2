"""The interface of a task runner, and its serial implementation without a cluster."""

from __future__ import annotations

import uuid
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any, Protocol

from idic.errors import InputError

Progress = Callable[[int, int], None]  # (count, total)
MAX_TOLD = 500  # characters of a problem that a watch is told


class JobKillsWorkers(InputError):
    """The processes of one job die repeatedly; other jobs may succeed.

    job : its number among the jobs of the call, where it is known
    """

    job: int | None = None


class Watch(Protocol):
    """Is told what becomes of the jobs of a call; from any thread, and comes back at once.

    A job that is repeated, or done by two workers, starts as another attempt each time.
    """

    def started(self, job: int, attempt: str, place: str) -> None:
        """A job starts at a place; attempt : a name of its own."""

    def ended(self, attempt: str, problem: str) -> None:
        """An attempt is over; problem : why it has no result, "" where it has one."""

    def lost(self, place: str) -> None:
        """A worker is gone, with all that ran on it."""


def problem_of(result: Any) -> str:
    """Why a job that came back has not reached what it was for: the text `failed` of its result."""
    problem = getattr(result, "failed", "")
    return problem if isinstance(problem, str) else ""


def told(problem: BaseException) -> str:
    """An exception in one line."""
    return " ".join(f"{type(problem).__name__}: {problem}".split())[:MAX_TOLD]


class TaskRunner(Protocol):
    """Runs one function over a list of jobs; results always come in the order of the jobs.

    The function must be importable (module level), must not depend on earlier jobs, and must be repeatable: a job
    runs again if its worker dies.
    """

    @property
    def workers(self) -> int:
        """Processes that work at a time."""

    @property
    def dashboard(self) -> str | None:
        """Address of its page, None without one."""

    def threads_for(self, n_jobs: int) -> int:
        """Threads for each of so many jobs, so that cores which the user gave to idic are not idle."""
        ...

    @property
    def sees_files(self) -> bool:
        """Whether the jobs see the disk of this process; otherwise only what `idic.run.workers.exchange` sends."""

    def stream(
        self,
        function: Callable[[Any], Any],
        jobs: Sequence[Any],
        names: Sequence[str],
        retries: int = 0,
        progress: Progress | None = None,
        ahead: int | None = None,
        copies: bool = False,
        watch: Watch | None = None,
    ) -> Iterator[Any]:
        """Yield ``function(job)`` in job order, each as soon as all earlier results are available.

        Parameters
        ----------
        names : sequence of str
            Labels on the dashboard, one per job: ``"simulate-it003-SPECIMEN.E"``.
        retries : int
            How often a job whose function raised is tried again (a lost worker does not count).
        progress : callable, optional
            ``progress(count, total)`` at every completion, in any order.
        ahead : int, optional
            At most so many jobs are submitted beyond the next one to be yielded: bounds the number of waiting results.
            Default: no bound.
        copies : bool
            A job that straggles may run on a second worker at the same time (`idic.run.workers.task_limits`).
        watch : Watch, optional
            Is told of starts, ends and lost workers.

        Raises
        ------
        JobKillsWorkers
            Workers keep dying on a job; raised in the place of its result, and with its number.
        InputError
            The connection to the scheduler is lost.
        Exception
            The exception of the earliest failing job; waiting jobs are cancelled.
        """
        ...

    def map(
        self,
        function: Callable[[Any], Any],
        jobs: Sequence[Any],
        names: Sequence[str],
        retries: int = 0,
        progress: Progress | None = None,
    ) -> list[Any]:
        """All results, in job order. See `stream`."""
        ...

    def background(self, function: Callable[[Any], Any], job: Any, name: str) -> Callable[[], None]:
        """Start a job that prepares others, on one worker; returns a function that waits for its end.

        Its failure is ignored: the prepared job meets the same error and reports it.
        """
        ...


class SerialRunner:
    """Runs the jobs one after the other in this process: for tests, notebooks and ``--workers 0``.

    threads : of a simulation
    """

    workers: int = 1
    dashboard: str | None = None
    sees_files: bool = True

    def __init__(self, threads: int = 1):
        self._threads = threads

    def threads_for(self, n_jobs: int) -> int:
        """See `TaskRunner.threads_for`: one job at a time."""
        return self._threads

    def stream(self, function, jobs, names, retries=0, progress=None, ahead=None, copies=False,
               watch=None) -> Iterator[Any]:
        """See `TaskRunner.stream`."""
        for count, (job, _) in enumerate(zip(jobs, names, strict=True), start=1):
            work = function if watch is None else partial(_watched, watch, count - 1, function)
            result = self._attempt(work, job, retries)
            if progress is not None:
                progress(count, len(jobs))
            yield result

    def map(self, function, jobs, names, retries=0, progress=None) -> list[Any]:
        """See `TaskRunner.map`."""
        return list(self.stream(function, jobs, names, retries, progress))

    def background(self, function, job, name) -> Callable[[], None]:
        """See `TaskRunner.background`: there is no other process to prepare."""
        return lambda: None

    @staticmethod
    def _attempt(function, job, retries: int):
        for _ in range(retries):
            try:
                return function(job)
            except Exception:  # noqa: BLE001 - as Dask does: the last attempt below reports
                continue
        return function(job)


def _watched(watch: Watch, number: int, function: Callable[[Any], Any], job: Any) -> Any:
    attempt = uuid.uuid4().hex
    watch.started(number, attempt, "this process")
    try:
        result = function(job)
    except BaseException as problem:
        watch.ended(attempt, told(problem))
        raise
    watch.ended(attempt, problem_of(result))
    return result
