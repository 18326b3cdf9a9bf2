"""The diagnosis as a Prefect flow: screening and judgement here, every refit a Dask task."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

from idic.run import TaskRunner, Workplace, diagnose, experiments_of, open_source, run_lock, write_all
from idic_flows.settings import connected, flow_server  # before Prefect: it reads its settings from the environment
from idic_flows.shown_runner import ShownRunner
from idic_flows.stages import run_stage


def run_diagnosis(run: str | Path, workers: int | None = None, scheduler: str | None = None,
                  stage: Callable[[str], None] = lambda text: None, resume: bool = False,
                  memory_limit: str | None = None, quick: bool = False, store: str | None = None) -> dict:
    """Diagnose a RUN; writes diagnosis.json, diagnosis.html and the enriched experiment, returns the content.

    Parameters
    ----------
    workers, scheduler : a LocalCluster of so many processes (0: none), or an existing Dask scheduler
    resume : refits that an interrupted diagnosis has finished are not repeated
    memory_limit : memory of one worker process, "2GB"
    quick : screening and refit of the most promising candidate alone
    store : as of `idic_flows.identify.run_identification`

    Raises
    ------
    InputError
        If the RUN holds no finished identification, or another process works on it; nothing has been written then.
    """
    began = time.perf_counter()
    open_source(run)
    place = Workplace(workers, scheduler, memory_limit, store)
    place.check(run, say=stage)
    with (run_lock(run), flow_server() as server,
          place.opened(run, experiments_of(run), ("idic.run.diagnosis.diagnose",)) as runner):
        with connected(server):
            return _diagnose_in_prefect(str(run), ShownRunner(runner), stage, began, resume, quick)


def _diagnose_in_prefect(run: str, runner: TaskRunner, stage: Callable[[str], None], began: float, resume: bool,
                         quick: bool) -> dict:
    """The flow; made here because importing Prefect takes seconds. Its parameters are what Prefect's pages show."""
    from prefect import flow

    @flow(name="idic-diagnose", flow_run_name=f"diagnose-{time.strftime('%H%M%S')}", validate_parameters=False,
          persist_result=False)
    def whole(run: str, resume: bool, quick: bool, workers: int) -> dict:
        diagnosis = run_stage("diagnose", partial(diagnose, resume=resume, quick=quick), run, runner, stage)
        stage("writing figures and the enriched experiment")
        return run_stage("write", write_all, run, diagnosis, began)

    return whole(run, resume, quick, runner.workers)
