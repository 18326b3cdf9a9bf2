"""Settings of the Dask workers of idic (one thread, memory, no terminal output), and their CPU time."""

from __future__ import annotations

import logging
import os
import signal

NUMBA_THREADS = "NUMBA_NUM_THREADS"
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", NUMBA_THREADS,
                            "VECLIB_MAXIMUM_THREADS", "OPENCV_FOR_THREADS_NUM"), "1")
KEEP_MEMORY = {  # bytes; Dask's own setting returns every large array at once and has it zeroed again for the next one
    "MALLOC_MMAP_THRESHOLD_": str(32 << 20), "MALLOC_TRIM_THRESHOLD_": str(128 << 20)
}  # fmt: skip
# of distributed.worker.memory: Dask pauses a worker above 80 % of its limit until it frees memory; workers of idic
# would wait forever, as only the next job uses their memory
NEVER_PAUSE = {"target": False, "spill": False, "pause": False}
# until Dask gives up on a worker that starts again: its 15 s are less than a start takes on a busy machine, and it does
# not replace what it gave up (`submission.LostWorkers` does)
LOST_AFTER = "5 minutes"
_COMMAND_OF_A_WORKER = "multiprocessing"  # the Prefect server is another program
_QUIET = {"DASK_LOGGING__DISTRIBUTED": "critical"}


def use_one_thread(environment=os.environ) -> None:
    """Limit the libraries of this process to one thread each; call it before the import of NumPy.

    A cluster works with processes; threads slow down the small linear algebra here and change its rounding.
    """
    for name, value in ONE_THREAD.items():
        environment.setdefault(name, value)


def cluster_settings(allowed_failures: int) -> dict:
    """The Dask configuration for a cluster of idic.

    allowed_failures : deaths of workers before their job fails
    """
    return {
        "distributed.scheduler.allowed-failures": allowed_failures,
        "distributed.deploy.lost-worker-timeout": LOST_AFTER,
        # set in this process while a worker starts: numba refuses another number of threads once it has started some
        "distributed.nanny.pre-spawn-environ": {name: value for name, value in {**ONE_THREAD, **_QUIET,
                                                                                 **KEEP_MEMORY}.items()
                                                if name != NUMBA_THREADS},
        "distributed.nanny.environ": {NUMBA_THREADS: ONE_THREAD[NUMBA_THREADS]},
        **{f"distributed.worker.memory.{name}": value for name, value in NEVER_PAUSE.items()},
        "distributed.worker.preload": ["idic.run.workers.dask_settings"],
        "distributed.worker.profile.enabled": False,  # it samples every 10 ms and keeps an hour of it in memory
        "distributed.comm.require-encryption": None,
        "distributed.admin.large-graph-warning-threshold": "100MB",
    }


def dask_setup(worker) -> None:
    """Ignore Ctrl-C in a worker (called by Dask at its start): the driver handles it and ends its workers."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def be_quiet() -> None:
    """Silence log lines of Dask such as "Worker process 123 was killed"; idic raises errors that matter."""
    os.environ.setdefault("DASK_LOGGING__DISTRIBUTED", _QUIET["DASK_LOGGING__DISTRIBUTED"])
    for name in ("asyncio", "tornado.application", "distributed.client", "distributed.utils"):
        logger = logging.getLogger(name)
        if not any(isinstance(item, _NoFarewells) for item in logger.filters):
            logger.addFilter(_NoFarewells())


def cpu_seconds() -> float:
    """User and system time of this process, its workers and their finished programs so far, s.

    Workers of an existing scheduler and workers that died are not counted.
    """
    import psutil

    process = psutil.Process()
    total = sum(process.cpu_times()[:2])
    for child in process.children(recursive=True):
        try:
            if any(_COMMAND_OF_A_WORKER in word for word in child.cmdline()):
                total += sum(child.cpu_times()[:4])
        except psutil.Error:  # it has ended
            continue
    return total


class _NoFarewells(logging.Filter):
    """Drops log lines of Dask's background tasks on closed connections: at the end of a cluster, or of a lost
    scheduler, which idic says in its own words."""

    def filter(self, record: logging.LogRecord) -> bool:
        trace = record.exc_info[2] if record.exc_info else None
        while trace is not None:
            if f"{os.sep}distributed{os.sep}" in trace.tb_frame.f_code.co_filename:
                return False
            trace = trace.tb_next
        return True
