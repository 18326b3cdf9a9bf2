"""Functions that only compiled code calls: without an entrance from Python, laws compile in 3/4 of the time."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from numba import njit
from numba.core.registry import CPUDispatcher


class _Inner(CPUDispatcher):
    """A compiled function that Python must not call: there is no code that takes Python's objects apart."""

    def __call__(self, *arguments):
        raise TypeError(f"{self.py_func.__name__} is called by compiled functions only; in Python take its .py_func")


def inner(function: Callable, **options) -> Callable:
    """`numba.njit` for a helper of laws that makes no arrays; options : of `numba.njit`.

    It is inlined, so that tuples stay in registers, and counts no references to arrays: either halves a law's time.
    """
    settings = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True, "error_model": "numpy", "forceinline": True,
                "_nrt": False}
    dispatcher = njit(**(settings | options))(function)
    dispatcher.__class__ = _Inner
    return dispatcher


def array_maker(function: Callable) -> Callable:
    """Mark a law's function that makes arrays, which take reference counts: it is compiled with them."""
    function.makes_arrays = True  # type: ignore[attr-defined]
    return function


inner_with_arrays = partial(inner, _nrt=True, forceinline=False)
