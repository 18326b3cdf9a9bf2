"""Largest memory that this process and its finished children have used."""

from __future__ import annotations

import sys
from pathlib import Path

import psutil

try:
    import resource
except ImportError:  # Windows
    resource = None

STATUS = Path("/proc/self/status")


def peak_memory_mb(children: bool = True) -> float:
    """Largest resident memory of this process, or of one of its finished children, MB; on Windows of this process
    alone."""
    if resource is None:
        return psutil.Process().memory_info().peak_wset / 1e6
    peak = _peak_of_this_program()
    unit = 1.0 if sys.platform == "darwin" else 1024.0  # ru_maxrss is in bytes there, in KiB elsewhere
    if peak is None:
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit
    of_children = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * unit if children else 0.0
    return max(peak, of_children) / 1e6


def _peak_of_this_program() -> float | None:
    """Bytes, from Linux; `ru_maxrss` there begins with the memory of the process that started this one."""
    try:
        lines = STATUS.read_text(encoding="utf-8").splitlines()
    except OSError:
        return None
    return next((1024.0 * int(line.split()[1]) for line in lines if line.startswith("VmHWM:")), None)
