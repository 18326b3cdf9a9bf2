"""An empty working folder, so that no file in the folder where a command was started configures a dependency.

Prefect reads ``.env``, ``prefect.toml`` and ``pyproject.toml`` of the working folder, numba ``.numba_config.yaml``,
Matplotlib ``matplotlibrc``, and Python imports modules from it. In the folder of a stranger these would be the
stranger's programs and settings. Commands therefore work in an empty folder, and so do the processes that they start
(docs/safety.md).
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator, MutableMapping
from contextlib import contextmanager, suppress
from pathlib import Path

# the user's own settings that name files or folders, and lists of them; a relative one starts where the user is
PATHS = ("DASK_CONFIG", "DASK_ROOT_CONFIG", "MATPLOTLIBRC", "MPLCONFIGDIR", "NUMBA_CACHE_DIR", "PREFECT_HOME",
         "PREFECT_PROFILES_PATH", "PREFECT_LOGGING_SETTINGS_PATH", "TMPDIR", "XDG_CACHE_HOME", "XDG_CONFIG_HOME")
LISTS_OF_PATHS = ("IDIC_LAWS", "PYTHONPATH")


def cache_folder() -> Path:
    """What idic keeps for this user and may be deleted at any time."""
    base = os.environ.get("XDG_CACHE_HOME") or (os.environ.get("LOCALAPPDATA") if os.name == "nt" else None)
    return Path(base or Path.home() / ".cache") / "idic"


def empty_folder() -> Path:
    """A folder of this user with nothing in it; it stays, as long runs outlive what others clear away."""
    lasting = cache_folder() / "empty"
    try:
        lasting.mkdir(mode=0o700, parents=True, exist_ok=True)
        if _is_own(lasting) and not any(lasting.iterdir()):
            return lasting
    except OSError:  # no home, or one that may not be written
        pass
    return Path(tempfile.mkdtemp(prefix="idic-empty-"))


def _is_own(folder: Path) -> bool:
    """Whether the folder is this user's, and no other user may write into it."""
    if os.name == "nt":
        return True
    status = folder.lstat()
    return status.st_uid == os.getuid() and not status.st_mode & 0o022 and not folder.is_symlink()


@contextmanager
def in_empty_folder(environment: MutableMapping[str, str] = os.environ) -> Iterator[Path]:
    """Work in an empty folder for a ``with`` block; relative paths of the environment are made absolute before.

    Yields the folder before, where relative paths of the user begin.
    """
    began = _present_folder()
    for name in PATHS:
        if environment.get(name):
            environment[name] = os.path.abspath(environment[name])
    for name in LISTS_OF_PATHS:
        if environment.get(name):
            parts = environment[name].split(os.pathsep)
            environment[name] = os.pathsep.join(os.path.abspath(part) for part in parts if part)
    os.chdir(empty_folder())
    try:
        yield began
    finally:
        with suppress(OSError):  # it has been removed meanwhile
            os.chdir(began)


def _present_folder() -> Path:
    """The working folder; the root where it has been removed."""
    try:
        return Path.cwd()
    except FileNotFoundError:
        os.chdir(os.sep)
        return Path.cwd()
