"""Ctrl-C and SIGTERM end a command between two moments, not in the middle of a lock.

Python raises KeyboardInterrupt wherever the main thread is. Where that is the instant at which a lock has been taken
and the block that gives it back has not yet begun, the lock is held for ever, and so is the thread that hands in the
results of Zarr or Dask: the command would hang instead of writing what it has. There the interruption waits for some
milliseconds. In a callback of the garbage collector or in a finaliser Python reports the exception and drops it, and
the command would run to its end. The interruption is raised again some milliseconds later.
"""

from __future__ import annotations

import _thread
import concurrent.futures._base
import logging
import queue
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from types import FrameType

RETRY_SECONDS, MAX_RETRIES = 0.005, 400
_LOCKING = {module.__file__ for module in (concurrent.futures._base, logging, queue, threading)}
_WAITING = threading.Condition.wait.__code__  # most of all waits: it takes its lock again whatever happens

_retries = 0


@contextmanager
def interruptible() -> Iterator[None]:
    """Ctrl-C and SIGTERM (a queue system, `kill`) raise KeyboardInterrupt at a safe moment of a ``with`` block."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    previous = {signal.SIGTERM: signal.signal(signal.SIGTERM, _interrupt)}
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:  # background jobs of a shell ignore it
        previous[signal.SIGINT] = signal.signal(signal.SIGINT, _interrupt)
    report = sys.unraisablehook
    sys.unraisablehook = partial(_raise_again, report)
    try:
        yield
    finally:
        sys.unraisablehook = report
        for number, handler in previous.items():
            signal.signal(number, handler)
        if hasattr(signal, "setitimer") and signal.getsignal(signal.SIGALRM) is _interrupt:
            signal.setitimer(signal.ITIMER_REAL, 0.0)
            signal.signal(signal.SIGALRM, signal.SIG_DFL)


def holds_a_lock(frame: FrameType | None) -> bool:
    """Whether an interruption in this frame may leave a lock taken for ever."""
    return frame is not None and frame.f_code.co_filename in _LOCKING and frame.f_code is not _WAITING


def _interrupt(number: int, frame: FrameType | None) -> None:
    global _retries
    if holds_a_lock(frame) and _retries < MAX_RETRIES and _call_again():
        _retries += 1
        return
    _retries = 0
    raise KeyboardInterrupt


def _raise_again(report: Callable[[sys.UnraisableHookArgs], object], dropped: sys.UnraisableHookArgs) -> None:
    """What a callback of the interpreter raised has no caller; an interruption is meant for the command."""
    if not issubclass(dropped.exc_type, KeyboardInterrupt):
        report(dropped)
    elif not _call_again():
        threading.Timer(RETRY_SECONDS, _thread.interrupt_main).start()


def _call_again() -> bool:
    """Set the alarm for the next try; False where there is no alarm, or it is another's."""
    if not hasattr(signal, "setitimer") or signal.getitimer(signal.ITIMER_REAL)[0] > 0.0:
        return False
    if signal.getsignal(signal.SIGALRM) not in (signal.SIG_DFL, _interrupt):
        return False
    signal.signal(signal.SIGALRM, _interrupt)
    signal.setitimer(signal.ITIMER_REAL, RETRY_SECONDS)
    return True
