"""How the kernels of the finite elements are compiled."""

from __future__ import annotations

import numba


def kernel(function, **options):
    """Compile on first use: serial, ``nogil``, with numba's disk cache where there is a place for it.

    options : of `numba.njit`
    """
    options = {"nogil": True, "error_model": "numpy", **options}
    try:
        return numba.njit(cache=True, **options)(function)
    except RuntimeError:  # nowhere to write
        return numba.njit(**options)(function)


def fast_kernel(function):
    """A `kernel` whose sums may be taken in another order and whose products are added in one rounding."""
    return kernel(function, fastmath={"contract", "reassoc", "nsz"})
