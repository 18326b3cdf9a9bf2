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

    def take(self, now: float) -> bool:
        """Whether there is one, which is then used."""
        self._left = min(self._burst, self._left + self._per_second * max(0.0, now - self._when))
        self._when = now
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
    shown: bool = False

    def state(self, state: str, when: float, message: str = "") -> JobRun:
        over = None if state == RUNNING else when
        return JobRun(self.run, self.name, state, when, self.began, over, message)


class JobRuns:
    """The jobs of one call. Each method returns the states to show now; times in s of a monotonic clock.

    titles : a name for each job
    """

    def __init__(self, titles: Sequence[str], budget: Budget, now: float):
        self._titles, self._budget, self._opened = titles, budget, now
        self._waiting: dict[int, uuid.UUID | None] = dict.fromkeys(range(len(titles)))  # run, where it is shown
        self._attempts: dict[str, _Attempt] = {}
        self._tries = [0] * len(titles)
        self._together: list[_Attempt] = []
        self._last_end = now

    def started(self, job: int, attempt: str, place: str, now: float) -> list[JobRun]:
        """A job starts; a repetition is a run of its own."""
        self._tries[job] += 1
        repeated = self._tries[job] > 1
        one = _Attempt(self._titles[job] + (f", attempt {self._tries[job]}" if repeated else ""), place, now)
        waited = self._waiting.pop(job, None)
        if waited is not None:
            one.run, one.shown = waited, True
        self._attempts[attempt] = one
        return self._running(one, now) if repeated or one.shown else []

    def ended(self, attempt: str, problem: str, now: float) -> list[JobRun]:
        """An attempt is over."""
        one = self._attempts.pop(attempt, None)
        if one is None:
            return []
        if problem:
            return [one.state(FAILED, now, problem)]
        if one.shown or now - one.began > SHORT_SECONDS or self._budget.take(now):
            return [one.state(COMPLETED, now, f"in {one.place}")]
        self._together.append(one)
        self._last_end = now
        return []

    def lost(self, place: str, now: float) -> list[JobRun]:
        """A worker is gone."""
        gone = [attempt for attempt, one in self._attempts.items() if one.place == place]
        return [self._attempts.pop(attempt).state(CRASHED, now, f"{place} was lost; the job is repeated")
                for attempt in gone]

    def due(self, now: float) -> list[JobRun]:
        """What has come to be shown by the passing of time."""
        shown = []
        for one in self._attempts.values():
            if not one.shown and now - one.began >= SHOW_AFTER_SECONDS:
                shown += self._running(one, now)
        if now - self._opened >= SHOW_AFTER_SECONDS and len(self._titles) <= MAX_WAITING:
            for job, run in self._waiting.items():
                if run is None and self._budget.take(now):
                    self._waiting[job] = uuid.uuid4()
                    shown.append(JobRun(self._waiting[job], self._titles[job], PENDING, now))
        if self._together and now - self._together[0].began >= TOGETHER_SECONDS and self._budget.take(now):
            shown += self._all_together()
        return shown

    def close(self, now: float) -> list[JobRun]:
        """The call is over; what still runs or waits is the second copy of a job that is done, or no longer wanted."""
        shown = self._all_together()
        shown += [one.state(CANCELLED, now, "the job is done elsewhere, or no longer needed")
                  for one in self._attempts.values() if one.shown]
        shown += [JobRun(run, self._titles[job], CANCELLED, now, message="no longer needed")
                  for job, run in self._waiting.items() if run is not None]
        self._attempts, self._waiting = {}, {}
        return shown

    def _running(self, one: _Attempt, now: float) -> list[JobRun]:
        one.shown = True
        return [one.state(RUNNING, one.began, f"in {one.place}")]

    def _all_together(self) -> list[JobRun]:
        if not self._together:
            return []
        jobs, self._together = self._together, []
        first, last = jobs[0].name, jobs[-1].name
        name = first if len(jobs) == 1 else f"{first} … {last} ({len(jobs)} short ones)"
        return [JobRun(uuid.uuid4(), name, COMPLETED, self._last_end, min(one.began for one in jobs), self._last_end,
                       "short jobs, shown together")]
