"""How many threads a simulation may use; the bits do not depend on it."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from contextvars import ContextVar
from typing import TypeVar

T = TypeVar("T")

_pool: ContextVar[ThreadPoolExecutor | None] = ContextVar("idic_solver_threads", default=None)


@contextmanager
def solver_threads(n: int) -> Iterator[None]:
    """Let simulations in this ``with`` block use `n` threads."""
    if n <= 1:
        yield
        return
    with ThreadPoolExecutor(n, thread_name_prefix="idic-solver") as pool:
        token = _pool.set(pool)
        try:
            yield
        finally:
            _pool.reset(token)


def pool_of_threads() -> ThreadPoolExecutor | None:
    """The threads of the innermost `solver_threads`; None: there is this one alone."""
    return _pool.get()


@contextmanager
def looked_ahead(items: Iterator[T], ahead: bool) -> Iterator[Iterator[T]]:
    """The same items, the next one computed in a second thread while one is used, where `ahead` says so.

    At the end of the ``with`` block the second thread has ended.
    """
    if not ahead:
        yield items
        return
    with ThreadPoolExecutor(1, thread_name_prefix="idic-ahead") as pool:
        yield _one_ahead(items, pool)


def _one_ahead(items: Iterator[T], pool: ThreadPoolExecutor) -> Iterator[T]:
    none_left = object()
    coming = pool.submit(next, items, none_left)
    while (item := coming.result()) is not none_left:
        coming = pool.submit(next, items, none_left)
        yield item  # type: ignore[misc]
