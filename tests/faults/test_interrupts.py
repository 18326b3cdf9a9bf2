"""An interruption never leaves a lock behind that somebody waits for."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time

import numpy as np
import pytest

from idic.cli.interrupts import holds_a_lock, interruptible
from idic.run.store.arrays import create_array, leave_stuck_io
from idic.run import read_array

posix = pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")


class Spy:
    """A lock that looks at who takes it, and may do something at that instant."""

    def __init__(self, meanwhile=lambda: None):
        self.lock, self.meanwhile, self.frames = threading.Lock(), meanwhile, []

    def __enter__(self):
        self.lock.acquire()
        self.frames.append(sys._getframe(1))  # Condition.__enter__, which has the lock and cannot give it back yet
        self.meanwhile()
        return True

    def __exit__(self, *_):
        self.lock.release()

    def acquire(self, *arguments):
        return self.lock.acquire(*arguments)

    def release(self):
        self.lock.release()


def test_the_instant_at_which_a_lock_is_taken_is_known():
    spy = Spy()
    with threading.Condition(spy):
        pass
    assert holds_a_lock(spy.frames[0])
    assert not holds_a_lock(sys._getframe()) and not holds_a_lock(None)


@posix
def test_a_wait_is_interrupted_at_once():
    timer = threading.Timer(0.2, os.kill, (os.getpid(), signal.SIGTERM))
    began = time.monotonic()
    with interruptible(), pytest.raises(KeyboardInterrupt):
        timer.start()
        threading.Event().wait(30.0)
    assert time.monotonic() - began < 5.0


@posix
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interruption_inside_a_lock_comes_when_the_lock_is_given_back(number, monkeypatch):
    """The signal arrives in `Condition.__enter__`; with Python's own handler the lock stays taken."""
    condition = threading.Condition()

    def enter(self):
        self._lock.acquire()
        os.kill(os.getpid(), number)  # handled before the next line
        return True

    code = compile_in_threading(enter)
    monkeypatch.setattr(threading.Condition, "__enter__", code)
    with interruptible(), pytest.raises(KeyboardInterrupt):
        with condition:
            inside = True
        monkeypatch.undo()
        time.sleep(5.0)
    assert inside and condition.acquire(timeout=1.0)


class Interrupting:
    """Its finaliser is where the signal arrives; Python drops what a finaliser raises."""

    def __init__(self, number):
        self.number = number

    def __del__(self):
        os.kill(os.getpid(), self.number)
        time.sleep(0.01)  # s: the handler is called here


@posix
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("alarm", ["free", "taken"])
def test_an_interruption_inside_a_finaliser_is_not_lost(number, alarm, capfd):
    """With Python's own handler the exception is printed and the command goes on; seen once in a collector's callback
    of Dask. Where the alarm is another's, a thread calls."""
    before = signal.signal(signal.SIGALRM, lambda *_: None) if alarm == "taken" else None
    try:
        with interruptible(), pytest.raises(KeyboardInterrupt):
            interrupting = Interrupting(number)
            del interrupting
            time.sleep(5.0)
    finally:
        if before is not None:
            signal.signal(signal.SIGALRM, before)
    assert "KeyboardInterrupt" not in capfd.readouterr().err


def compile_in_threading(function):
    """The function as if it stood in the file of `threading`."""
    function.__code__ = function.__code__.replace(co_filename=threading.__file__)
    return function


@posix
def test_a_signal_that_is_ignored_stays_ignored():
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with interruptible():
            assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, before)


def test_zarr_goes_on_beside_a_thread_that_is_stuck(tmp_path):
    from zarr.core import sync

    create_array(tmp_path, "numbers", (3,), (3,), "f8")[:] = [1.0, 2.0, 3.0]
    held, read = threading.Lock(), []
    held.acquire()
    sync.loop[0].call_soon_threadsafe(held.acquire)  # as the lock of an interrupted wait
    reader = threading.Thread(target=lambda: read.append(read_array(tmp_path, "numbers")), daemon=True)
    reader.start()
    reader.join(0.5)
    assert reader.is_alive() and not read
    leave_stuck_io()
    assert np.array_equal(read_array(tmp_path, "numbers"), [1.0, 2.0, 3.0])
    held.release()
    reader.join(5.0)
    assert len(read) == 1
