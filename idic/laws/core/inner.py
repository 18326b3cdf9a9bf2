"""Functions that only compiled code calls: without an entrance from Python, laws compile in 3/4 of the time."""

from __future__ import annotations

from collections.abc import Callable

from numba import njit
from numba.core.registry import CPUDispatcher


class _Inner(CPUDispatcher):
    """A compiled function that Python must not call: there is no code that takes Python's objects apart."""

    def __call__(self, *arguments):
        raise TypeError(f"{self.py_func.__name__} is called by compiled functions only; in Python take its .py_func")


def inner(function: Callable, **options) -> Callable:
    """`numba.njit` for a helper of laws; options : of `numba.njit`."""
    dispatcher = njit(no_cpython_wrapper=True, no_cfunc_wrapper=True, **options)(function)
    dispatcher.__class__ = _Inner
    return dispatcher
