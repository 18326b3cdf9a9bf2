"""Processor time of this process and of the workers that it has started."""

from __future__ import annotations

import psutil

_OF_WORKERS = "multiprocessing"  # in the command line of a Dask worker; the Prefect server's is another program's


def cpu_seconds() -> float:
    """User and system time so far, s; of workers that live, programs that they have run and waited for included.

    Workers of a scheduler that was there before, and workers that died, are not counted.
    """
    here = psutil.Process()
    total = sum(here.cpu_times()[:2])
    for child in here.children(recursive=True):
        try:
            if any(_OF_WORKERS in word for word in child.cmdline()):
                total += sum(child.cpu_times()[:4])
        except psutil.Error:  # it has ended meanwhile
            continue
    return total
