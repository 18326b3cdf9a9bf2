"""What a task may take before it is tried again: settings of the environment, for the whole command."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass

from idic.errors import InputError

RETRIES, SECONDS, NO_WORKERS = "IDIC_TASK_RETRIES", "IDIC_TASK_SECONDS", "IDIC_NO_WORKERS"
WAIT, END, HERE = "wait", "end", "here"
MAX_RETRIES = 20
MAX_WITHOUT_S = 300.0  # without any worker, before the run ends or goes on here
LEAST_SECONDS = 60.0  # no second copy earlier, where no limit is set
TIMES_THE_SLOWEST = 3.0  # of the finished tasks of the same kind


@dataclass(frozen=True)
class TaskLimits:
    """Retries and time limit of a task.

    retries : how often a task that raised an error is tried again, beyond what its caller asks for
    seconds : a task without a result for so long, while a worker is free, is given to that worker as well. None: three
        times the slowest finished task of the same call, a minute at least
    no_workers : what becomes of the run where no worker has been there for `MAX_WITHOUT_S`: it waits, ends, or goes on
        in this process
    """

    retries: int = 0
    seconds: float | None = None
    no_workers: str = END

    def straggles_after(self, slowest_s: float) -> float:
        """Seconds after which a task is also given to a free worker; slowest_s : of a finished task, 0 before any."""
        if self.seconds is not None:
            return self.seconds
        return max(LEAST_SECONDS, TIMES_THE_SLOWEST * slowest_s) if slowest_s > 0 else math.inf


def task_limits(scheduler: str | None = None) -> TaskLimits:
    """The limits that the environment sets.

    scheduler : of an existing cluster, whose workers may wait in a queue: without a word of the user the run waits too

    Raises
    ------
    InputError
        A value that is no number, or out of its range.
    """
    retries, seconds = os.environ.get(RETRIES, "").strip(), os.environ.get(SECONDS, "").strip()
    if retries and not (retries.isdecimal() and int(retries) <= MAX_RETRIES):
        raise _refused(RETRIES, f"a whole number of retries from 0 to {MAX_RETRIES}", retries)
    try:
        limit = float(seconds) if seconds else None
    except ValueError:
        limit = math.nan
    if limit is not None and not 1.0 <= limit < math.inf:
        raise _refused(SECONDS, "1 second or more", seconds)
    choices = (END, HERE, WAIT) if scheduler is None else (WAIT, END)
    choice = os.environ.get(NO_WORKERS, "").strip() or choices[0]
    if choice not in choices:
        raise _refused(NO_WORKERS, ", ".join(choices), choice)
    return TaskLimits(int(retries or 0), limit, choice)


def _refused(name: str, expected: str, found: str) -> InputError:
    return InputError("not a limit of a task", key=f"environment variable {name}", expected=expected, found=found,
                      remedy="correct or unset it")
