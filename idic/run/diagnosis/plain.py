"""The diagnosis as one function call, without a Prefect server."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

from threadpoolctl import threadpool_limits

from idic.run.diagnosis.diagnose import diagnose, write_all
from idic.run.diagnosis.source import open_source
from idic.run.prepared.context import experiments_of
from idic.run.store.run_lock import run_lock
from idic.run.workers.workplace import Workplace


def diagnose_plainly(run: str | Path, workers: int | None = None, scheduler: str | None = None,
                     stage: Callable[[str], None] = lambda text: None, resume: bool = False,
                     memory_limit: str | None = None, quick: bool = False, store: str | None = None) -> dict:
    """``idic diagnose --no-prefect``: the same refits, files and bits as `idic_flows.diagnose.run_diagnosis`.

    Parameters
    ----------
    workers, scheduler : a LocalCluster of so many processes (0: none; default one per core), or an existing Dask
    scheduler
    resume : refits that an interrupted diagnosis has finished are not repeated
    quick : screening and refit of the most promising candidate alone
    memory_limit : memory of one worker process, "2GB"
    store : as of `idic.run.plain.identify_plainly`

    Returns
    -------
    The content of ``RUN/diagnosis.json``.

    Raises
    ------
    InputError
        If the RUN holds no finished identification, or another process works on it; nothing has been written then.
    """
    began = time.perf_counter()
    open_source(run)
    place = Workplace(workers, scheduler, memory_limit, store)
    place.check(run, say=stage)
    with (run_lock(run), threadpool_limits(1, user_api="blas"),
          place.opened(run, experiments_of(run), ("idic.run.diagnosis.diagnose",)) as runner):
        diagnosis = diagnose(str(run), runner, stage, resume=resume, quick=quick)
        stage("writing figures and the enriched experiment")
        return write_all(str(run), diagnosis, began)
