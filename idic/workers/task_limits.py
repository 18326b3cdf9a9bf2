"""What a task may take before it is tried again: settings of the environment, for the whole command."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass

from idic.errors import InputError

RETRIES, SECONDS = "IDIC_TASK_RETRIES", "IDIC_TASK_SECONDS"
MAX_RETRIES = 20
LEAST_SECONDS = 60.0  # no second copy earlier, where no limit is set
TIMES_THE_SLOWEST = 3.0  # of the finished tasks of the same kind


@dataclass(frozen=True)
class TaskLimits:
    """Retries and time limit of a task.

    retries : how often a task that raised an error is tried again, beyond what its caller asks for
    seconds : a task without a result for so long, while a worker is free, is given to that worker as well. None: three
        times the slowest finished task of the same call, a minute at least
    """

    retries: int = 0
    seconds: float | None = None

    def straggles_after(self, slowest_s: float) -> float:
        """Seconds after which a task is also given to a free worker; slowest_s : of a finished task, 0 before any."""
        if self.seconds is not None:
            return self.seconds
        return max(LEAST_SECONDS, TIMES_THE_SLOWEST * slowest_s) if slowest_s > 0 else math.inf


def task_limits() -> TaskLimits:
    """The limits that the environment sets.

    Raises
    ------
    InputError
        A value that is no number, or out of its range.
    """
    retries, seconds = os.environ.get(RETRIES, "").strip(), os.environ.get(SECONDS, "").strip()
    return TaskLimits(int(_number(RETRIES, retries, 0, MAX_RETRIES, "a whole number of retries")) if retries else 0,
                      _number(SECONDS, seconds, 1.0, math.inf, "seconds") if seconds else None)


def _number(name: str, text: str, least: float, most: float, what: str) -> float:
    try:
        value = float(int(text)) if most == MAX_RETRIES else float(text)
    except ValueError:
        value = math.nan
    if not (least <= value <= most and math.isfinite(value)):
        limits = f"of {least:g} or more" if math.isinf(most) else f"from {least:g} to {most:g}"
        raise InputError("not a limit of a task", key=f"environment variable {name}", expected=f"{what} {limits}",
                         found=text, remedy="correct or unset it")
    return value
