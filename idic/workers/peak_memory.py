"""Largest memory that this process and its finished children have used."""

from __future__ import annotations

import sys

import psutil

try:
    import resource
except ImportError:  # Windows
    resource = None  # type: ignore[assignment]


def peak_memory_mb(children: bool = True) -> float:
    """Largest resident memory of this process, or of one of its finished children, MB; on Windows of this process
    alone."""
    if resource is None:
        return psutil.Process().memory_info().peak_wset / 1e6
    unit = 1.0 if sys.platform == "darwin" else 1024.0  # ru_maxrss is in bytes there, in KiB elsewhere
    whose = (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN) if children else (resource.RUSAGE_SELF,)
    return max(resource.getrusage(who).ru_maxrss for who in whose) * unit / 1e6
