"""One identification of a batch, start to report, on one worker or spread over all; a failure becomes its status."""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from idic.errors import InputError, NotConverged
from idic.inside import open_inside
from idic.run.identify import identify_run
from idic.run.orchestrator import Console
from idic.run.reporting.write import write_report
from idic.run.store.run_lock import RunBusy
from idic.run.workers.runner import SerialRunner, TaskRunner
from idic.run.workers.workplace import Workplace

LOG_FILE = "log.txt"
BAD_INPUT, BUSY, ERROR = "bad_input", "busy", "error"
BUSY_SECONDS, POLL_SECONDS = 600.0, 2.0


@dataclass(frozen=True)
class BatchJob:
    """A run of a batch and where it goes: all that a worker has to know; both paths absolute."""

    name: str
    experiment: str
    out: str
    overrides: Mapping[str, Any]
    sensitivity: str = "auto"


@dataclass(frozen=True)
class BatchOutcome:
    """What became of a run: the status of its result or one of `bad_input`, `busy`, `error`; why; its result."""

    name: str
    status: str
    reason: str = ""
    result: Mapping | None = None

    @property
    def failed(self) -> str:
        """Why there is no result (`idic.run.workers.runner.problem_of`); what did not converge has one."""
        return "" if self.result is not None else self.reason or self.status


def identify_whole(job: BatchJob) -> BatchOutcome:
    """A whole identification in this process (a task). Done twice, the second finds the result of the first."""
    return identify_job(job, SerialRunner())


def identify_job(job: BatchJob, runner: TaskRunner,
                 tasks: Callable[[str, int, int], None] = lambda label, count, total: None) -> BatchOutcome:
    """Identify and write the report; an interruption is the only thing that is raised."""
    log = _Log(Path(job.out))
    try:
        result = _patiently(lambda: identify_run(job.experiment, job.out, resume=True, overrides=job.overrides,
                                                 sensitivity=job.sensitivity, workplace=Workplace(runner=runner),
                                                 console=Console.of_lines(log.say, tasks)))
        log.say(result["status"])
        write_report(job.out)
        return BatchOutcome(job.name, result["status"], result=result)
    except RunBusy as problem:
        return BatchOutcome(job.name, BUSY, str(problem))
    except InputError as problem:
        return BatchOutcome(job.name, BAD_INPUT, str(problem))
    except NotConverged as problem:
        return BatchOutcome(job.name, "forward_failed", str(problem))
    except Exception as problem:  # noqa: BLE001 - a bug in one run must not take the others along; it is told
        log.say(traceback.format_exc())
        return BatchOutcome(job.name, ERROR, f"internal error: {type(problem).__name__}: {problem}")


def _patiently(identify: Callable[[], dict]) -> dict:
    """Wait for a duplicate of this task: a job of a worker that was believed lost is given to another one as well."""
    end = time.monotonic() + BUSY_SECONDS
    while True:
        try:
            return identify()
        except RunBusy:
            if time.monotonic() > end:
                raise
            time.sleep(POLL_SECONDS)


class _Log:
    """Lines with the time since the start into ``RUN/log.txt``, once the run has made its folder."""

    def __init__(self, run: Path):
        self._run, self._began = run, time.monotonic()

    def say(self, text: str) -> None:
        if self._run.is_dir():
            with open_inside(self._run, LOG_FILE, "a") as log:
                log.write(f"{time.strftime('%Y-%m-%d %H:%M:%S')} {time.monotonic() - self._began:6.1f} s  {text}\n")
