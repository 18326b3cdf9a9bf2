"""Which runs Prefect shows of the jobs of one call, and in which states: bookkeeping, without Prefect.

A state that is shown costs all processes together 10 to 30 ms of computing. Jobs that take long are always shown. Short
ones are shown one by one while the budget lasts; beyond it, in one run that names the first and the last of them. What
failed, was lost or is repeated is always shown.
"""

from __future__ import annotations

import uuid
from collections.abc import Sequence
from dataclasses import dataclass, field

BURST, PER_SECOND = 40.0, 1.0  # states of short jobs: at once, and later, which is 3 % of a core
SHOW_AFTER_SECONDS = 2.0  # of running or waiting; before that, nothing is shown
SHORT_SECONDS = 1.0  # jobs that take longer need no budget: their states are 3 % of them at most
TOGETHER_SECONDS = 10.0  # longest time that jobs which are over wait to be shown together
MAX_WAITING = 64  # jobs of a call that are shown while they wait

PENDING, RUNNING, COMPLETED = "Pending", "Running", "Completed"
FAILED, CRASHED, CANCELLED = "Failed", "Crashed", "Cancelled"


@dataclass(frozen=True)
class JobRun:
    """A state of a run to be shown. began, ended, when : s of a monotonic clock"""

    run: uuid.UUID
    name: str
    state: str
    when: float
    began: float | None = None
    ended: float | None = None
    message: str = ""


class Budget:
    """States that may still be shown one by one; it refills with time."""

    def __init__(self, burst: float = BURST, per_second: float = PER_SECOND):
        self._burst, self._per_second, self._left, self._when = burst, per_second, burst, 0.0

    def take(self, moment: float) -> bool:
        """Whether there is one, which is then used."""
        self._left = min(self._burst, self._left + self._per_second * max(0.0, moment - self._when))
        self._when = moment
        if self._left < 1.0:
            return False
        self._left -= 1.0
        return True


@dataclass
class _Attempt:
    name: str
    place: str
    began: float
    run: uuid.UUID = field(default_factory=uuid.uuid4)
    is_shown: bool = False

    def state(self, state: str, when: float, message: str = "") -> JobRun:
        over = None if state == RUNNING else when
        return JobRun(self.run, self.name, state, when, self.began, over, message)


class JobRuns:
    """The jobs of one call. Each method returns the states to show now; times in s of a monotonic clock.

    titles : a name for each job
    """

    def __init__(self, titles: Sequence[str], budget: Budget, moment: float):
        self._titles, self._budget, self._opened = titles, budget, moment
        self._waiting: dict[int, uuid.UUID | None] = dict.fromkeys(range(len(titles)))  # run, where it is shown
        self._attempts: dict[str, _Attempt] = {}
        self._tries = [0] * len(titles)
        self._together: list[_Attempt] = []
        self._last_end = moment

    def started(self, job: int, attempt: str, place: str, moment: float) -> list[JobRun]:
        """A job starts; a repetition is a run of its own."""
        self._tries[job] += 1
        repeated = self._tries[job] > 1
        entry = _Attempt(self._titles[job] + (f", attempt {self._tries[job]}" if repeated else ""), place, moment)
        waited = self._waiting.pop(job, None)
        if waited is not None:
            entry.run, entry.is_shown = waited, True
        self._attempts[attempt] = entry
        return self._running(entry, moment) if repeated or entry.is_shown else []

    def ended(self, attempt: str, problem: str, moment: float) -> list[JobRun]:
        """An attempt is over."""
        entry = self._attempts.pop(attempt, None)
        if entry is None:
            return []
        if problem:
            return [entry.state(FAILED, moment, problem)]
        if entry.is_shown or moment - entry.began > SHORT_SECONDS or self._budget.take(moment):
            return [entry.state(COMPLETED, moment, f"in {entry.place}")]
        self._together.append(entry)
        self._last_end = moment
        return []

    def lost(self, place: str, moment: float) -> list[JobRun]:
        """A worker is gone."""
        attempts = [attempt for attempt, entry in self._attempts.items() if entry.place == place]
        return [self._attempts.pop(attempt).state(CRASHED, moment, f"{place} was lost; the job is repeated")
                for attempt in attempts]

    def due(self, moment: float) -> list[JobRun]:
        """What has come to be shown by the passing of time."""
        runs = []
        for entry in self._attempts.values():
            if not entry.is_shown and moment - entry.began >= SHOW_AFTER_SECONDS:
                runs += self._running(entry, moment)
        if moment - self._opened >= SHOW_AFTER_SECONDS and len(self._titles) <= MAX_WAITING:
            for job, run in self._waiting.items():
                if run is None and self._budget.take(moment):
                    self._waiting[job] = uuid.uuid4()
                    runs.append(JobRun(self._waiting[job], self._titles[job], PENDING, moment))
        if self._together and moment - self._together[0].began >= TOGETHER_SECONDS and self._budget.take(moment):
            runs += self._all_together()
        return runs

    def close(self, moment: float) -> list[JobRun]:
        """The call is over; what still runs or waits is the second copy of a job that is done, or no longer wanted."""
        runs = self._all_together()
        runs += [entry.state(CANCELLED, moment, "the job is done elsewhere, or no longer needed")
                 for entry in self._attempts.values() if entry.is_shown]
        runs += [JobRun(run, self._titles[job], CANCELLED, moment, message="no longer needed")
                 for job, run in self._waiting.items() if run is not None]
        self._attempts, self._waiting = {}, {}
        return runs

    def _running(self, entry: _Attempt, moment: float) -> list[JobRun]:
        entry.is_shown = True
        return [entry.state(RUNNING, entry.began, f"in {entry.place}")]

    def _all_together(self) -> list[JobRun]:
        if not self._together:
            return []
        jobs, self._together = self._together, []
        first_name, last_name = jobs[0].name, jobs[-1].name
        name = first_name if len(jobs) == 1 else f"{first_name} … {last_name} ({len(jobs)} short ones)"
        began = min(entry.began for entry in jobs)
        return [JobRun(uuid.uuid4(), name, COMPLETED, self._last_end, began, self._last_end,
                       "short jobs, shown together")]
