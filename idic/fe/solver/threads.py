"""How many threads a factorisation may use; the bits do not depend on it."""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from contextvars import ContextVar

import numpy as np
from numba.extending import get_cython_function_address

_pool: ContextVar[ThreadPoolExecutor | None] = ContextVar("idic_solver_threads", default=None)


@contextmanager
def solver_threads(n: int) -> Iterator[None]:
    """Let factorisations in this ``with`` block use `n` threads."""
    if n <= 1:
        yield
        return
    with ThreadPoolExecutor(n, thread_name_prefix="idic-solver") as pool:
        before = _pool.set(pool)
        try:
            yield
        finally:
            _pool.reset(before)


def pool_of_threads() -> ThreadPoolExecutor | None:
    """The threads of the innermost `solver_threads`; None: there is this one alone."""
    return _pool.get()


def solve_triangle(triangle: np.ndarray, block: np.ndarray, *, right: bool, lower: bool) -> None:
    """Overwrite a block (m, n) by the solution with a triangle; other threads go on meanwhile.

    SciPy's wrapper of ``dtrsm`` keeps the interpreter's lock.

    Parameters
    ----------
    triangle : (k, k) column by column; lower : its lower part with a unit diagonal, else its upper part
    right : X T = block, else T X = block
    """
    m, n = block.shape
    sizes = (ctypes.c_int * 4)(m, n, triangle.shape[0], max(1, m))
    one = ctypes.c_double(1.0)
    at = ctypes.addressof(sizes)
    side, part, plain, diagonal = (ctypes.c_char(letter) for letter in (
        b"R" if right else b"L", b"L" if lower else b"U", b"N", b"U" if lower else b"N"))
    refs = [ctypes.addressof(letter) for letter in (side, part, plain, diagonal)]
    _dtrsm(*refs, at, at + 4, ctypes.addressof(one), triangle.ctypes.data, at + 8, block.ctypes.data, at + 12)


_dtrsm = ctypes.CFUNCTYPE(None,
                          *[ctypes.c_void_p] * 11)(get_cython_function_address("scipy.linalg.cython_blas", "dtrsm"))
