"""How our Dask workers are set up (one thread each, memory that they keep, nothing on the terminal), what they cost."""

from __future__ import annotations

import logging
import os
import signal

ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS",
                            "VECLIB_MAXIMUM_THREADS", "OPENCV_FOR_THREADS_NUM"), "1")
KEEP_MEMORY = {  # bytes; Dask's own setting returns every large array at once and has it zeroed again for the next one
    "MALLOC_MMAP_THRESHOLD_": str(32 << 20), "MALLOC_TRIM_THRESHOLD_": str(128 << 20)
}  # fmt: skip
# of distributed.worker.memory: Dask gives a worker above 80 % of its limit no work until it has less; ours would wait
# for ever, since what they keep is only used by the next job
NEVER_PAUSE = {"target": False, "spill": False, "pause": False}
_COMMAND_OF_A_WORKER = "multiprocessing"  # the Prefect server is another program
_QUIET = {"DASK_LOGGING__DISTRIBUTED": "critical"}


def use_one_thread(environment=os.environ) -> None:
    """Ask the libraries of this process for one thread each; before NumPy is imported, or it is too late.

    A cluster works with processes; the small linear algebra here is slower with threads, and its bits depend on them.
    """
    for name, value in ONE_THREAD.items():
        environment.setdefault(name, value)


def cluster_settings(allowed_failures: int) -> dict:
    """Dask's configuration for a cluster of ours.

    allowed_failures : deaths of a worker before the job it held is given up
    """
    return {
        "distributed.scheduler.allowed-failures": allowed_failures,
        "distributed.nanny.pre-spawn-environ": {**ONE_THREAD, **_QUIET, **KEEP_MEMORY},
        **{f"distributed.worker.memory.{name}": value for name, value in NEVER_PAUSE.items()},
        "distributed.worker.preload": ["idic.workers.dask_settings"],
        "distributed.worker.profile.enabled": False,  # it samples every 10 ms and keeps an hour of it in memory
        "distributed.comm.require-encryption": None,
        "distributed.admin.large-graph-warning-threshold": "100MB",
    }


def dask_setup(worker) -> None:
    """Dask calls this in every worker that it starts: Ctrl-C in the terminal is for the driver, which ends its workers."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def be_quiet() -> None:
    """Lines such as "Worker process 123 was killed" say nothing to the user; what matters is raised."""
    os.environ.setdefault("DASK_LOGGING__DISTRIBUTED", _QUIET["DASK_LOGGING__DISTRIBUTED"])
    for name in ("asyncio", "tornado.application"):
        logger = logging.getLogger(name)
        if not any(isinstance(item, _NoFarewells) for item in logger.filters):
            logger.addFilter(_NoFarewells())


def cpu_seconds() -> float:
    """User and system time of this process and its workers so far, s, with the programs that they ran and waited for.

    Workers of a scheduler that was there before, and workers that died, are not counted.
    """
    import psutil

    here = psutil.Process()
    total = sum(here.cpu_times()[:2])
    for child in here.children(recursive=True):
        try:
            if any(_COMMAND_OF_A_WORKER in word for word in child.cmdline()):
                total += sum(child.cpu_times()[:4])
        except psutil.Error:  # it has ended meanwhile
            continue
    return total


class _NoFarewells(logging.Filter):
    """Drops what Dask's background tasks say about connections that are closed while a cluster ends."""

    def filter(self, record: logging.LogRecord) -> bool:
        trace = record.exc_info[2] if record.exc_info else None
        while trace is not None:
            if f"{os.sep}distributed{os.sep}" in trace.tb_frame.f_code.co_filename:
                return False
            trace = trace.tb_next
        return True
