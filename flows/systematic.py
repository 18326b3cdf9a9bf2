"""The systematic errors of a RUN as a Prefect flow: every assessment a Dask task."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

from idic_flows.settings import connected, flow_server  # before Prefect: it reads its settings from the environment
from idic_flows.shown_runner import ShownRunner
from idic_flows.stages import run_stage

from idic.run import Progress, TaskRunner, Workplace, assessed_experiments, systematic


def run_systematic(run: str | Path, bias: bool = True, spread: bool = True, workers: int | None = None,
                   scheduler: str | None = None, memory_limit: str | None = None,
                   stage: Callable[[str], None] = lambda text: None, progress: Progress | None = None,
                   store: str | None = None) -> dict:
    """Estimate the errors that the error bars of a finished RUN do not count; returns the new content of its
    result.json.

    Parameters
    ----------
    bias, spread : the discretisation bias; the spread over treatments of boundary and camera
    workers, scheduler : a LocalCluster of so many processes (0: none), or an existing Dask scheduler
    memory_limit : memory of one worker process, "2GB"
    progress : called with the number of finished assessments and of all, after each
    store : as of `idic_flows.identify.run_identification`

    Raises
    ------
    InputError
        As `idic.run.systematic_run.systematic`.
    """
    place = Workplace(workers, scheduler, memory_limit, store)
    place.check(run, say=stage)
    with flow_server() as server, place.opened(run, assessed_experiments(run), ("idic.run.systematic_run",)) as runner:
        with connected(server):
            return _assess_in_prefect(str(run), ShownRunner(runner), bias, spread, progress)


def _assess_in_prefect(run: str, runner: TaskRunner, bias: bool, spread: bool, progress: Progress | None) -> dict:
    """The flow; made here because importing Prefect takes seconds. Its parameters are what Prefect's pages show."""
    from prefect import flow

    @flow(name="idic-systematic", flow_run_name=f"systematic-{time.strftime('%H%M%S')}", validate_parameters=False,
          persist_result=False)
    def whole(run: str, bias: bool, spread: bool, workers: int) -> dict:
        return run_stage("assess", systematic, run, runner, bias, spread, progress)

    return whole(run, bias, spread, runner.workers)
