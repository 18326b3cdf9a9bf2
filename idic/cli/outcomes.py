"""How a command ends: the exit code, and the message after a failure.

0 done; 1 internal error; 2 bad input; 3 ran but did not converge; 4 interrupted, resumable.
"""

from __future__ import annotations

import errno
import os
import shlex
import sys
import tempfile
import time
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import typer

from idic.cli.interrupts import interruptible
from idic.errors import InputError, NotConverged
from idic.inside import is_inside, open_inside

LOG_FILE = "log.txt"
DONE, BUG, BAD_INPUT, NOT_CONVERGED, INTERRUPTED = 0, 1, 2, 3, 4
_NAMES = ("ENOSPC", "EDQUOT", "EFBIG", "EACCES", "EPERM", "EROFS", "ENOTDIR", "EISDIR", "EEXIST", "ENAMETOOLONG", "EIO",
          "ELOOP", "ESTALE")
_USERS_DISK = {getattr(errno, name) for name in _NAMES if hasattr(errno, name)}  # not every system has all of them
_FULL = {getattr(errno, name) for name in ("ENOSPC", "EDQUOT", "EFBIG") if hasattr(errno, name)}


@contextmanager
def outcome(run: Path | None = None, resume: bool = False) -> Iterator[None]:
    """Turn an exception into a message on stderr and an exit code.

    Parameters
    ----------
    run : Path, optional
        The RUN folder; the traceback of an internal error goes to its ``log.txt``.
    resume : bool
        The command can go on with ``--resume`` after an interruption.
    """
    with interruptible():
        try:
            with _taken_down_on_request():
                yield
        except (typer.Exit, SystemExit):
            raise
        except InputError as problem:
            _say(str(problem))
            raise typer.Exit(BAD_INPUT) from None
        except NotConverged as problem:
            _say(f"the simulation did not converge: {problem}")
            raise typer.Exit(NOT_CONVERGED) from None
        except BrokenPipeError:  # `idic laws | head`
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            raise typer.Exit(DONE) from None
        except OSError as problem:
            if problem.errno in _USERS_DISK or _no_folder_there(problem):
                _say(f"{problem.filename or 'disk'}: {problem.strerror}\n"
                     "  what to do: free disk space, check the permissions, or choose another path"
                     + (f"; finished steps are stored. To continue:\n  {_resume_command()}" if resume
                        and problem.errno in _FULL else ""))
                raise typer.Exit(BAD_INPUT) from None
            raise typer.Exit(_report_bug(run)) from None
        except Exception:  # noqa: BLE001  (the last place: it becomes a report of the error)
            raise typer.Exit(_report_bug(run)) from None
        except GeneratorExit:
            raise
        except BaseException:  # noqa: BLE001  (KeyboardInterrupt, and the signals of Prefect and Dask)
            _say(_how_to_go_on() if resume else "interrupted")
            raise typer.Exit(INTERRUPTED) from None


def abandon(is_told: bool) -> None:
    """End at once, as after an interruption: what other threads compute is not waited for.

    is_told : the message is on the screen
    """
    if not is_told:
        _say("interrupted")
    os._exit(INTERRUPTED)


def _no_folder_there(problem: OSError) -> bool:
    """A file system without new folders (/proc, an automounter) answers mkdir with "no such file"."""
    return problem.errno == errno.ENOENT and traceback.extract_tb(problem.__traceback__)[-1].name == "mkdir"


@contextmanager
def _taken_down_on_request() -> Iterator[None]:
    """An error during the shutdown after an interruption (a closed file ...) counts as the interruption."""
    try:
        yield
    except Exception as problem:
        if any(_is_request(link) for link in _behind(problem)):
            raise KeyboardInterrupt from problem
        raise


def _behind(problem: BaseException) -> Iterator[BaseException]:
    """The chain of exceptions behind `problem`, latest first."""
    identities, link = set(), problem.__cause__ or problem.__context__
    while link is not None and id(link) not in identities:
        yield link
        identities.add(id(link))
        link = link.__cause__ or link.__context__


def _is_request(stop: BaseException) -> bool:
    return isinstance(stop, KeyboardInterrupt) or any(kind.__name__ == "ExternalSignal" for kind in type(stop).__mro__)


def _how_to_go_on() -> str:
    return f"interrupted; all finished steps are stored. To continue:\n  {_resume_command()}"


def paused(stage: int) -> str:
    """What to do after a pause at the end of a stage of the schedule."""
    return f"paused after stage {stage}; all finished steps are stored. To continue:\n  {_resume_command()}"


def _resume_command() -> str:
    words = ["idic", *sys.argv[1:]]
    words = words if "--resume" in words else [*words, "--resume"]
    if os.name == "nt":  # its shell knows no single quotes
        return " ".join(f'"{word}"' if " " in word else word for word in words)
    return shlex.join(words)


def _report_bug(run: Path | None) -> int:
    """Write the traceback to a file and ask for a report."""
    text = (f"\n{time.strftime('%Y-%m-%d %H:%M:%S')} internal error\ncommand: {shlex.join(sys.argv)}\n"
            f"{_versions()}\n{traceback.format_exc()}")  # fmt: skip
    file = _log_file(run)
    with open_inside(file.parent, file.name, "a") as log:
        log.write(text)
    problem = sys.exc_info()[1]
    _say(f"internal error: {type(problem).__name__}: {problem}\n"
         f"  This is a bug in idic, not in your input. Please report it with the file\n    {file}\n"
         "  (and, if you can, the experiment folder) to the developers.")  # fmt: skip
    return BUG


def _log_file(run: Path | None) -> Path:
    if run is not None and run.is_dir() and (is_inside(run, LOG_FILE) or not os.path.lexists(run / LOG_FILE)):
        return run / LOG_FILE
    descriptor, name = tempfile.mkstemp(prefix="idic-error-", suffix=".txt")
    os.close(descriptor)
    return Path(name)


def _versions() -> str:
    import platform
    from importlib.metadata import PackageNotFoundError, version

    def of(name: str) -> str:
        try:
            return f"{name} {version(name)}"
        except PackageNotFoundError:
            return f"{name} not installed"

    packages = ("idic", "numpy", "scipy", "numba", "zarr", "dask", "distributed", "prefect", "fastapi")
    return f"python {platform.python_version()} on {platform.platform()}; " + ", ".join(of(name) for name in packages)


def _say(text: str) -> None:
    """A message on stderr; escape sequences in file names do not reach the terminal."""
    printable = "".join(mark if mark.isprintable() or mark in "\n\t" else repr(mark)[1:-1] for mark in text)
    sys.stderr.write(f"idic: {printable}\n")
    sys.stderr.flush()
