"""A runner whose jobs Prefect shows: each simulation and each chunk of frames is a task run with a name and a state.

The states are events, sent by a thread in the background as Prefect itself sends those of its tasks: no request per
job, and no engine around it.
"""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextvars import copy_context
from datetime import datetime, timedelta
from typing import Any

from idic.run import TaskRunner
from idic_flows.job_runs import Budget, JobRun, JobRuns
from idic_flows.job_titles import titles_of

_LOOK_SECONDS = 0.5  # between looks for what has come to be shown


class ShownRunner:
    """A `TaskRunner` that shows the jobs of another one in the flow run that calls it; outside of one it shows nothing.

    name_run : the names of jobs contain the RUN, as where one flow has several
    """

    def __init__(self, inner: TaskRunner, name_run: bool = False):
        self._inner, self._name_run, self._budget = inner, name_run, Budget()

    @property
    def workers(self) -> int:
        return self._inner.workers

    @property
    def dashboard(self) -> str | None:
        return self._inner.dashboard

    @property
    def sees_files(self) -> bool:
        return self._inner.sees_files

    def threads_for(self, n_jobs: int) -> int:
        """See `TaskRunner.threads_for`."""
        return self._inner.threads_for(n_jobs)

    def stream(self, function, jobs, names, retries=0, progress=None, ahead=None, copies=False,
               watch=None) -> Iterator[Any]:
        """See `TaskRunner.stream`."""
        from prefect.context import FlowRunContext

        if not jobs or watch is not None or FlowRunContext.get() is None:
            yield from self._inner.stream(function, jobs, names, retries, progress, ahead, copies, watch)
            return
        watcher = _Shown(titles_of(jobs, names, self._name_run), names, self._budget)
        try:
            yield from self._inner.stream(function, jobs, names, retries, progress, ahead, copies, watcher)
        finally:
            watcher.close()

    def map(self, function, jobs, names, retries=0, progress=None) -> list[Any]:
        """See `TaskRunner.map`."""
        return list(self.stream(function, jobs, names, retries, progress))

    def background(self, function, job, name) -> Callable[[], None]:
        """See `TaskRunner.background`."""
        return self._inner.background(function, job, name)


class _Shown:
    """The watch of one call, and the thread that sends what it shows."""

    def __init__(self, titles: Sequence[str], names: Sequence[str], budget: Budget):
        self._runs = JobRuns(titles, budget, time.monotonic())
        self._send = _Sender(names[0].split("-")[0])
        self._told: queue.SimpleQueue = queue.SimpleQueue()
        # with the settings of Prefect and the run that calls, which are variables of the context
        self._thread = threading.Thread(target=copy_context().run, args=(self._work,), name="idic-shown", daemon=True)
        self._thread.start()

    def started(self, job: int, attempt: str, place: str) -> None:
        """See `Watch.started`."""
        self._told.put(("started", job, attempt, place, time.monotonic()))

    def ended(self, attempt: str, problem: str) -> None:
        """See `Watch.ended`."""
        self._told.put(("ended", attempt, problem, time.monotonic()))

    def lost(self, place: str) -> None:
        """See `Watch.lost`."""
        self._told.put(("lost", place, time.monotonic()))

    def close(self) -> None:
        """The call is over."""
        self._told.put(("close", time.monotonic()))
        self._thread.join()

    def _work(self) -> None:
        over = False
        while not over:
            try:
                event, *arguments = self._told.get(timeout=_LOOK_SECONDS)
            except queue.Empty:
                event, arguments = "due", [time.monotonic()]
            over = event == "close"
            try:
                for state in getattr(self._runs, event)(*arguments):
                    self._send(state)
                if not over:
                    for state in self._runs.due(time.monotonic()):
                        self._send(state)
            except Exception:  # noqa: BLE001 - the pages of Prefect lack a line; the run itself goes on
                continue


class _Sender:
    """Sends states of task runs of the flow run and, where there is one, of the task of the context.

    kind : what Prefect takes for the task of these runs: "simulate", "correlate"
    """

    def __init__(self, kind: str):
        from prefect.client.schemas.objects import State, StateType, TaskRunResult
        from prefect.context import FlowRunContext, TaskRunContext

        # the time of a new state is Prefect's own; durations come from a monotonic clock
        self._zero = State(type=StateType.RUNNING).timestamp - timedelta(seconds=time.monotonic())
        flow, stage = FlowRunContext.get(), TaskRunContext.get()
        self._kind, self._flow = kind, flow.flow_run.id
        self._inputs = {} if stage is None else {"__parents__": [TaskRunResult(id=stage.task_run.id)]}
        self._before: dict[Any, Any] = {}

    def __call__(self, job_run: JobRun) -> None:
        from prefect.client.schemas.objects import State, StateType, TaskRun
        from prefect.utilities.engine import emit_task_run_state_change_event

        state = State(type=StateType[job_run.state.upper()], name=job_run.state, message=job_run.message or None,
                      timestamp=self._moment(job_run.when))
        run = TaskRun(id=job_run.run, name=job_run.name, flow_run_id=self._flow, task_key=f"idic-{self._kind}",
                      dynamic_key=job_run.run.hex, task_inputs=self._inputs,
                      run_count=0 if job_run.began is None else 1,
                      expected_start_time=self._moment(job_run.when if job_run.began is None else job_run.began),
                      start_time=None if job_run.began is None else self._moment(job_run.began),
                      end_time=None if job_run.ended is None else self._moment(job_run.ended), state=state)
        if job_run.began is not None and job_run.ended is not None:
            run.total_run_time = timedelta(seconds=job_run.ended - job_run.began)
        emit_task_run_state_change_event(run, self._before.get(job_run.run), state)
        self._before[job_run.run] = state

    def _moment(self, seconds: float) -> datetime:
        return self._zero + timedelta(seconds=seconds)
