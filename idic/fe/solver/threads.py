"""How many threads a factorisation may use; the bits do not depend on it."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from contextvars import ContextVar

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
