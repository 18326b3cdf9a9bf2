"""What the bits of a result depend on besides idic: processor, interpreter, versions, kernels of linear algebra."""

from __future__ import annotations

import platform
from importlib.metadata import version
from pathlib import Path

import llvmlite.binding
import numpy as np  # noqa: F401 - its linear algebra is one of the libraries below
import scipy.linalg  # noqa: F401 - likewise
from threadpoolctl import threadpool_info

PACKAGES = ("numpy", "scipy", "numba", "llvmlite")
PROCESSORS = Path("/proc/cpuinfo")
KERNELS = threadpool_info()  # before anything else is loaded: a picture library may bring linear algebra of its own


def fingerprint() -> dict:
    """The fingerprint of this machine and environment."""
    kernels = {f"{library['prefix']} {library.get('version')} {library.get('architecture', '')}".strip()
               for library in KERNELS if library["user_api"] == "blas"}
    return {"processor": _processor(), "target": llvmlite.binding.get_host_cpu_name(),
            "python": platform.python_version(), "packages": {name: version(name) for name in PACKAGES},
            "blas": sorted(kernels)}


def _processor() -> str:
    if not PROCESSORS.is_file():
        return f"{platform.machine()} {platform.processor()}"
    lines = PROCESSORS.read_text(encoding="utf-8").splitlines()
    models = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return models[0] if models else platform.machine()
