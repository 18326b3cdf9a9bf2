"""Runs one program and ends it with the caller; started by its path, as a separate process.

    python -I guard.py '{"command": [...], "log": "log.txt", "log_limit": 1000000, "timeout_s": 600}'

The program gets its own session and process group, and no standard input. The whole group is ended when the time
is up, when it leaves children behind, and when the standard input of this process closes: the caller holds the other
end, and the operating system closes it even when the caller is killed. What the program prints goes to the log, of
which the beginning and the end are kept. How it ended is printed as JSON. Standard library only.
"""

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections import deque

GRACE_SECONDS = 3.0
POLL_SECONDS = (0.005, 0.1)
BLOCK_BYTES = 1 << 14


def main() -> None:
    order, stop = json.loads(sys.argv[1]), threading.Event()
    for name in ("SIGTERM", "SIGINT", "SIGHUP"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), lambda number, frame: stop.set())
    threading.Thread(target=_watch_caller, args=(stop,), daemon=True).start()
    try:
        program = subprocess.Popen(order["command"], stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                                   stderr=subprocess.STDOUT, start_new_session=True)
    except OSError as problem:
        print(json.dumps({"outcome": "not started", "code": None, "reason": str(problem)}))
        return
    log = threading.Thread(target=_keep, args=(program.stdout, order["log"], order["log_limit"]), daemon=True)
    log.start()
    outcome = _wait(program, time.monotonic() + order["timeout_s"], stop)
    _end_group(program)  # its children, if it ended by itself
    code = program.wait()
    log.join(GRACE_SECONDS)
    print(json.dumps({"outcome": outcome, "code": code, "reason": ""}), flush=True)


def _watch_caller(stop: threading.Event) -> None:
    try:
        while os.read(0, 4096):
            pass
    except OSError:
        pass
    stop.set()


def _wait(program, deadline: float, stop: threading.Event) -> str:
    """"ended", "timeout" or "stopped"; the program is not reaped, so that its number still stands for its group."""
    pause = POLL_SECONDS[0]
    while not _over(program):
        if stop.wait(pause):
            return "stopped"
        if time.monotonic() > deadline:
            return "timeout"
        pause = min(2.0 * pause, POLL_SECONDS[1])
    return "ended"


def _over(program) -> bool:
    if not hasattr(os, "waitid"):
        return program.poll() is not None
    return os.waitid(os.P_PID, program.pid, os.WEXITED | os.WNOWAIT | os.WNOHANG) is not None


def _end_group(program) -> None:
    """SIGTERM to the whole group, SIGKILL after a while."""
    if not _over(program):
        _signal(program, signal.SIGTERM)
        end = time.monotonic() + GRACE_SECONDS
        while not _over(program) and time.monotonic() < end:
            time.sleep(POLL_SECONDS[1])
    _signal(program, getattr(signal, "SIGKILL", signal.SIGTERM))


def _signal(program, number: int) -> None:
    try:
        if hasattr(os, "killpg"):
            os.killpg(program.pid, number)
        else:
            program.kill()
    except (ProcessLookupError, PermissionError):
        pass


def _keep(stream, path: str, limit: int) -> None:
    """Copy a stream to a file: of more than `limit` bytes the first and the last half."""
    tail: deque = deque(maxlen=max(limit // 2 // BLOCK_BYTES, 1))
    written = dropped = 0
    with _opened(path) as file:
        while block := stream.read1(BLOCK_BYTES):
            if written < limit // 2:
                file.write(block)
                file.flush()
                written += len(block)
            else:
                dropped += len(tail) == tail.maxlen
                tail.append(block)
        if dropped:
            file.write(b"\n[... the middle of the output is left out ...]\n")
        file.write(b"".join(tail))


def _opened(path: str):
    """The log; nowhere, where it cannot be written: a full pipe would stop the program."""
    try:
        return open(path, "wb")
    except OSError:
        return open(os.devnull, "wb")


if __name__ == "__main__":
    main()
