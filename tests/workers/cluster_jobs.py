"""Functions that the worker processes of `test_dask_executor` run (they must be importable there)."""

import os
import signal
import sys
import time
from pathlib import Path

import numpy as np

from idic.errors import InputError, NotConverged


def square(job):
    return job * job


def slow_first(job):
    """Completes in the reverse order of submission, and returns what a sum depends on."""
    time.sleep(0.05 * (3 - job % 4))
    return np.random.default_rng(job).normal(size=50) * 10.0 ** (job % 5)


def thread_limits(_):
    import numba

    return os.environ["OMP_NUM_THREADS"], os.environ["OPENBLAS_NUM_THREADS"], numba.config.NUMBA_NUM_THREADS


def die_once(job):
    """Kills its worker the first time; `job` is (marker file, value)."""
    marker, value = Path(job[0]), job[1]
    if not marker.exists():
        marker.write_text(str(os.getpid()))
        os.kill(os.getpid(), signal.SIGKILL)
    return value


def die_when_asked(marker):
    """Says its process in the file `marker`, and works until it is killed."""
    Path(marker).write_text(str(os.getpid()))
    time.sleep(600.0)


def slow_once(job):
    """Slow at its first start: `seconds`, or until it is started again; `job` is (marker file, value[, seconds])."""
    marker, value, *seconds = job
    if Path(marker).is_dir():
        return value
    with open(marker, "a") as file:
        file.write("x")
    end = time.monotonic() + (seconds[0] if seconds else 60.0)
    while Path(marker).read_text() == "x" and time.monotonic() < end:
        time.sleep(0.1)
    return value


_held = []


def hold_memory(size):
    """Keep so much that this process has `size` bytes, as a worker does that keeps what a job has used."""
    import psutil

    while psutil.Process().memory_info().rss < size:
        _held.append(np.ones(1_000_000))
    return psutil.Process().memory_info().rss


def die_always(_):
    os.kill(os.getpid(), signal.SIGKILL)


def refuse(job):
    if job == 2:
        raise InputError("frame 2 is odd", file="a.tif", remedy="remove it")
    if job == 3:
        raise NotConverged("at t = 3 s")
    return job


def fail_until(job):
    """Raises until its marker file has been touched `n` times; `job` is (marker, n)."""
    marker, n = Path(job[0]), job[1]
    count = len(marker.read_text()) if marker.exists() else 0
    marker.write_text("x" * (count + 1))
    if count < n:
        raise RuntimeError("not yet")
    return count


def wait_long(job):
    Path(job).write_text(str(os.getpid()))
    time.sleep(60)


def loaded(module):
    return module in sys.modules
