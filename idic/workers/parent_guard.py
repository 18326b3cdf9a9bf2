"""Run a Python module in a process that ends when its parent does, even by SIGKILL.

``python parent_guard.py MODULE ARGUMENTS...`` with a pipe as standard input: the parent holds the other end, and the
operating system closes it when the parent is gone. Works on every system, and does not depend on the thread that
started the process (as Linux' PR_SET_PDEATHSIG does). Standard library only; started by its path, not imported.
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
        os.setpgrp()  # Ctrl-C in the terminal is for the parent, which then ends this process in good order
    sys.path.pop(0)  # the folder of this file: its modules must not be importable by bare names
    del sys.argv[0]
    runpy.run_module(sys.argv[0], run_name="__main__", alter_sys=True)
