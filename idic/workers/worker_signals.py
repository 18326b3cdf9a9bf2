"""Loaded by a worker before anything else: Ctrl-C in the terminal reaches it too, but is for the driver, which then
ends its workers in good order (and whose death ends them anyway)."""

import signal

signal.signal(signal.SIGINT, signal.SIG_IGN)
