"""How the kernels of the finite elements are compiled."""

from __future__ import annotations

import numba


def kernel(function):
    """Compile on first use: serial, ``nogil``, with numba's disk cache where there is a place for it."""
    options = {"nogil": True, "error_model": "numpy"}
    try:
        return numba.njit(cache=True, **options)(function)
    except RuntimeError:  # nowhere to write
        return numba.njit(**options)(function)
