"""The environment of a program that a test starts: one thread for each library, as in idic's own processes."""

from idic.run import use_one_thread

ONE_THREAD: dict[str, str] = {}
use_one_thread(ONE_THREAD)
