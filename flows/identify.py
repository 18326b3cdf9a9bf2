"""The identification as a Prefect flow around the one driver of the loop (`idic.identify.driver`).

One Prefect task per stage of an iteration; inside a stage the simulations and the chunks of frames are Dask tasks with
names such as ``simulate-it003-SPECIMEN.E``. A killed run resumes from the RUN folder alone; Prefect holds no state of it.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from idic_flows.settings import Opaque, connected, server_is_gone  # before Prefect: it reads the environment

from idic.identify.driver import StageHook, log_progress, run_loop
from idic.identify.step.state import LoopState
from idic.run.plain import plan_run
from idic.run.runs import Points, Run
from idic.run.session import Timing
from idic.run.warm_up import compile_image_kernels
from idic.store.arrays import leave_stuck_io
from idic.workers.dask_executor import check_scheduler, checked_memory_limit, open_cluster
from idic.workers.prefect_server import start_server
from idic.workers.runner import SerialRunner, TaskRunner


@dataclass(frozen=True)
class Console:
    """Where progress goes; every call may be ignored.

    stage(text), tasks(what, done, total), iteration(state), said(line of the log)
    """

    stage: Callable[[str], None] = lambda text: None
    tasks: Callable[[str, int, int], None] = lambda what, done, total: None
    iteration: Callable[[LoopState], None] = lambda state: None
    dashboards: Callable[[str | None, str | None, str | None], None] = lambda prefect, dask, password: None
    said: Callable[[str], None] = lambda text: None


def run_identification(paths: Sequence[str | Path], out: str | Path, resume: bool = False, workers: int | None = None,
                       scheduler: str | None = None, sensitivity: str = "auto",
                       overrides: Mapping[str, Any] | None = None, console: Console | None = None,
                       memory_limit: str | None = None) -> dict:
    """Identify the parameters of an experiment; returns the content of ``RUN/result.json``.

    Parameters
    ----------
    paths : one experiment (folder or experiment.toml), or several with shared materials
    out : the RUN folder
    resume : resume an interrupted run in `out`
    workers, scheduler : a LocalCluster of so many processes (default one per core), or an existing Dask scheduler
    sensitivity : "direct", "perturbed" or "auto"
    overrides : ``--set key=value``
    memory_limit : memory of one worker process, "2GB"

    Raises
    ------
    InputError
        If anything in the input is not what was expected; nothing has been written then.
    """
    began, console = time.perf_counter(), console or Console()
    planned = plan_run(paths, out, dict(overrides or {}))
    planned.check(sensitivity)
    limit = checked_memory_limit(memory_limit, workers, scheduler)
    check_scheduler(scheduler)
    with start_server() as server, planned.claim(resume):
        done = _earlier_result(planned, console) if resume else None
        if done is not None:
            return done
        console.stage("ingesting images")
        with open_cluster(workers, scheduler, limit, preload=("idic.run.tasks",)) as runner:
            planned.ingest(lambda done, total: console.tasks("ingest", done, total))
            compiled = runner.background(compile_image_kernels, planned.first_job, "compile")
            console.stage("starting Prefect")
            with connected(server):
                console.dashboards(server.dashboard, runner.dashboard, server.password)
                run = _Run(planned, runner, sensitivity, Timing(), began, console, compiled)
                with _kept_when_interrupted(run):
                    try:
                        return _flow()(run)
                    except Exception as problem:
                        if not server_is_gone(problem):
                            raise
                        console.stage("the Prefect server is gone: the identification continues without it")
                        return _without_prefect(run)


@dataclass(frozen=True)
class _Run:
    """What the flow works on. compiled : waits until the image kernels are compiled."""

    planned: Run
    runner: TaskRunner
    sensitivity: str
    timing: Timing
    began: float
    console: Console
    compiled: Callable[[], None]


    def open_points(self) -> Points:
        return self.planned.open_points(self.runner, self.sensitivity, self.timing, self.console.tasks, self.console.said)


def _without_prefect(run: _Run) -> dict:
    """The rest of an identification whose Prefect server was lost; the RUN folder holds all that it needs."""
    done = run.planned.finished_result()
    if done is not None:
        return done
    if not run.planned.prepared:
        run.planned.prepare(run.runner)
    points = run.open_points()
    return points.postprocess(run_loop(points, progress=log_progress(run.console.stage)), run.began)


def _earlier_result(planned: Run, console: Console) -> dict | None:
    """Look through an earlier run; its result, where nothing remains to be done."""
    for text in planned.recover():
        console.stage(text)
    return planned.finished_result()


@contextmanager
def _kept_when_interrupted(run: _Run) -> Iterator[None]:
    """On Ctrl-C, or a request to end, the accepted point becomes a result with the status "interrupted"."""
    try:
        yield
    except Exception:
        raise
    except BaseException:  # KeyboardInterrupt; Prefect raises one of its own
        with suppress(Exception):  # a failure here must not hide the interruption; --resume finds everything
            leave_stuck_io()
            run.planned.open_points(SerialRunner(), run.sensitivity, run.timing).write_interrupted(run.began)
        raise


def _flow():
    """The flow and its tasks; made here because importing Prefect takes seconds."""
    from prefect import flow, task
    from prefect.cache_policies import NO_CACHE

    def stage(name: str, function: Callable, *arguments):
        """Run one stage as a Prefect task called `name`."""
        return task(name=name.split(" ", maxsplit=1)[0], task_run_name=name, cache_policy=NO_CACHE, persist_result=False)(
            lambda: function(*arguments))()

    @flow(name="idic-identify", flow_run_name=f"identify-{time.strftime('%H%M%S')}", validate_parameters=False,
          persist_result=False)
    def identify(holder):
        run, console = holder.content, holder.content.console
        if not run.planned.prepared:
            console.stage("measuring noise and motion" if run.planned.measures else "preparing")
            stage("prepare", run.planned.prepare, run.runner)
        points = run.open_points()
        state = run_loop(points, _with_kernels(stage, run.compiled), console.iteration)
        console.stage("residual maps and result")
        return stage("postprocess", points.postprocess, state, run.began)

    return lambda run: identify(Opaque(run))


def _with_kernels(stage: StageHook, compiled: Callable[[], None]) -> StageHook:
    """The stage hook that waits for the compiled image kernels before a correlation."""
    def hook(name: str, function: Callable, *arguments):
        if name.startswith("correlate"):
            compiled()
        return stage(name, function, *arguments)

    return hook


__all__ = ["Console", "run_identification"]
