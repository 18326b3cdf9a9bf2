"""Runs a Python module in a process that ends with its parent, even after SIGKILL.

``python parent_guard.py MODULE ARGUMENTS...`` with a pipe as standard input: the parent holds the other end, and the
operating system closes it at the end of the parent. This works on every system and does not depend on the starting
thread (as PR_SET_PDEATHSIG of Linux does). The file uses the standard library only; it is started by its path.
"""

import os
import runpy
import signal
import sys
import threading
import time

GRACE_SECONDS = 3.0


def _end_with_parent() -> None:
    try:
        while os.read(0, 4096):
            pass
    except OSError:
        pass
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(GRACE_SECONDS)
    os._exit(1)


if __name__ == "__main__":
    threading.Thread(target=_end_with_parent, daemon=True).start()
    if hasattr(os, "setpgrp"):
        os.setpgrp()  # the parent handles Ctrl-C in the terminal and ends this process
    sys.path.pop(0)  # the folder of this file: its modules must not be importable by bare names
    del sys.argv[0]
    runpy.run_module(sys.argv[0], run_name="__main__", alter_sys=True)
