"""The identification as a Prefect flow around the one driver of the loop (`idic.identification.driver`).

One Prefect task per stage of an iteration; inside a stage the simulations and the chunks of frames are Dask tasks with
names such as ``simulate-it003-SPECIMEN.E``, which Prefect shows as task runs (`idic_flows.shown_runner`). A killed run
resumes from the RUN folder alone; Prefect holds none of its state.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

# before Prefect: it reads the environment
from idic_flows.settings import connected, flow_server, server_is_gone, show_dashboards
from idic_flows.shown_runner import ShownRunner
from idic_flows.stages import publish_evaluations, publish_residual, publish_schedule, run_stage

from idic.identification import LoopState, StageHook, run_loop
from idic.run import (
    Console, OpenRun, TaskRunner, Timing, check_pause, compile_image_kernels, compile_stress_kernel, on_workers,
    plan_run, workplace_for,
)


def run_identification(paths: Sequence[str | Path], out: str | Path, resume: bool = False, workers: int | None = None,
                       scheduler: str | None = None, sensitivity: str = "auto",
                       overrides: Mapping[str, Any] | None = None, console: Console | None = None,
                       memory_limit: str | None = None, pause_after: int | None = None,
                       store: str | None = None) -> dict:
    """Identify the parameters of an experiment; returns the content of ``RUN/result.json``.

    A run that pauses has the key "paused_after_stage" in it.

    Parameters
    ----------
    paths : one experiment (folder or experiment.toml), or several with shared materials
    out : the RUN folder
    resume : resume an interrupted run in `out`
    workers, scheduler : a LocalCluster of so many processes (0: everything in this process; default: one per core, or
        this process where the run is small), or an existing Dask scheduler
    sensitivity : "direct", "perturbed" or "auto"
    overrides : ``--set key=value``
    memory_limit : memory of one worker process, "2GB"
    pause_after : stage of the schedule (1: the first) after which the run pauses, to be resumed
    store : through which the workers of a scheduler get and send files where no disk is common: a URL of fsspec, or
    "driver"

    Raises
    ------
    InputError
        If anything in the input is not what was expected; nothing has been written then.
    """
    began, console = time.perf_counter(), console or Console()
    planned = plan_run(paths, out, dict(overrides or {}), console.stage)
    planned.check(sensitivity)
    check_pause(planned, pause_after)
    place = workplace_for(planned, workers, scheduler, memory_limit, store)
    place.check(out, planned.to_see, console.stage)
    with flow_server() as server:

        def work(runner: TaskRunner) -> dict:
            compiled = runner.background(compile_image_kernels, planned.first_job, "compile")
            runner.background(compile_stress_kernel, None, "compile-stress")
            console.stage("starting Prefect")
            with connected(server):
                show_dashboards(console.dashboards, server, runner.dashboard)
                run = OpenRun(planned, ShownRunner(runner), sensitivity, Timing(), began, console, pause_after)
                with run.kept_when_interrupted():
                    try:
                        return _identify_in_prefect(run, compiled, paths, out)
                    except Exception as problem:
                        if not server_is_gone(problem):
                            raise
                        console.stage("the Prefect server no longer answers: the identification continues without it")
                        return run.identify()

        return on_workers(planned, place, out, resume, console, work)


def _identify_in_prefect(run: OpenRun, compiled: Callable[[], None], paths: Sequence[str | Path],
                         out: str | Path) -> dict:
    """The flow; made here because importing Prefect takes seconds. Its parameters are what Prefect's pages show."""
    from prefect import flow

    @flow(name="idic-identify", flow_run_name=f"identify-{time.strftime('%H%M%S')}", validate_parameters=False,
          persist_result=False)
    def identify(experiments: list[str], out: str, sensitivity: str, workers: int, pause_after: int | None) -> dict:
        if not run.planned.prepared:
            run.say_prepare()
            run_stage("prepare", run.planned.prepare, run.runner)
        points = run.open_points()
        publish_schedule(points.experiment)
        shown: list[int] = []

        def progress(state: LoopState) -> None:
            run.console.iteration(state)
            publish_evaluations(points.experiment, state)
            if len(paths) == 1 and state.accepted is not None and state.accepted.number not in shown:
                shown.append(state.accepted.number)
                publish_residual(run.planned.store.run)

        run.console.stage("identification")
        state = run_loop(points, _with_kernels(run_stage, compiled), progress, pause_after)
        return run_stage("postprocess", run.written, points, state)

    return identify([str(path) for path in paths], str(out), run.sensitivity, run.runner.workers, run.pause_after)


def _with_kernels(stage: StageHook, compiled: Callable[[], None]) -> StageHook:
    """The stage hook that waits for the compiled image kernels before a correlation."""
    def hook(name: str, function: Callable, *arguments):
        if name.startswith("correlate"):
            compiled()
        return stage(name, function, *arguments)

    return hook


__all__ = ["run_identification"]
