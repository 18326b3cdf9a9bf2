"""A second process that draws figures of a report beside this one: two thirds of the time of a report on two cores.

The page has the same bytes: every figure is a pure function of the record. Matplotlib draws in one thread of each
process. The second process reads from a pipe and ends with this one.
"""

from __future__ import annotations

import os
import pickle
import queue
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import Any

from idic.run.workers.working_folder import empty_folder

LONGEST_WAIT_S = 120.0  # for the last figure of the second process; then it is drawn here
HANDS_OUT = "figures for the second process"  # name of a thread


class SecondProcess:
    """Draws parts of reports; get one from `drawing_beside`."""

    def __init__(self) -> None:
        self._process: subprocess.Popen | None = None

    def start(self) -> None:
        """Let it import what it needs; where nothing can be started, all figures are drawn here."""
        if self._process is None:
            with suppress(OSError):
                self._process = subprocess.Popen([sys.executable, "-P", "-m", __name__], stdin=subprocess.PIPE,
                                                 stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, cwd=empty_folder())

    def close(self) -> None:
        """End it."""
        process, self._process = self._process, None
        if process is not None:
            process.kill()
            process.communicate()

    def draw_all(self, record: Any, parts: Sequence[Callable[[], Any]]) -> list:
        """The results of the parts of a record's report, some of them drawn by the second process.

        An exception of a part is raised here; a part that the second process does not bring back is drawn here.
        """
        shared, process = _Shared(len(parts)), self._process
        helper = threading.Thread(target=self._hand_out, args=(process, record, shared), name=HANDS_OUT, daemon=True)
        if process is not None:
            helper.start()
        while (number := shared.first()) is not None:
            shared.drawn[number] = parts[number]()
        if process is not None:
            helper.join(LONGEST_WAIT_S)
        return [shared.drawn[number] if number in shared.drawn else draw() for number, draw in enumerate(parts)]

    def _hand_out(self, process: subprocess.Popen, record: Any, shared: _Shared) -> None:
        """Give the second process one part after the other, the last ones first."""
        try:
            _send(process.stdin, record)
            while (number := shared.last()) is not None:
                _send(process.stdin, number)
                shared.drawn[number] = pickle.load(process.stdout)
        except (OSError, EOFError, pickle.PickleError, AttributeError, TypeError):  # it ended, or cannot be told
            self.close()


class _Shared:
    """Parts that are still to be drawn: taken from both ends."""

    def __init__(self, n_parts: int) -> None:
        self._left = deque(range(n_parts))
        self.drawn: dict[int, Any] = {}

    def first(self) -> int | None:
        """The next part for this process, None where none is left."""
        with suppress(IndexError):
            return self._left.popleft()
        return None

    def last(self) -> int | None:
        """The next part for the second process."""
        with suppress(IndexError):
            return self._left.pop()
        return None


@contextmanager
def drawing_beside() -> Iterator[SecondProcess]:
    """A second process for the length of a ``with`` block; it starts when it is told to."""
    second = SecondProcess()
    try:
        yield second
    finally:
        second.close()


# the second process -------------------------------------------------------------------------------
def _send(pipe: Any, content: Any) -> None:
    pickle.dump(content, pipe, protocol=pickle.HIGHEST_PROTOCOL)
    pipe.flush()


def _draw_as_told() -> None:
    """Records and numbers come in, drawn parts go out; an exception ends this process, and the other one meets it."""
    requests: queue.SimpleQueue = queue.SimpleQueue()
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what a library prints is no answer

    def listen() -> None:
        with suppress(Exception):
            while True:
                requests.put(pickle.load(sys.stdin.buffer))
        os._exit(0)  # the other process is gone, or wants no more

    from idic.report import parts, plan_sections

    threading.Thread(target=listen, daemon=True).start()
    drawers: list[Callable[[], Any]] = []
    while True:
        request = requests.get()
        if isinstance(request, int):
            _send(answers, drawers[request]())
        else:
            drawers = parts(plan_sections(request))


if __name__ == "__main__":
    _draw_as_told()
