"""Laws in files of the user, outside of this package.

Files are named on the command line (``idic --laws my_law.py identify …``) or in the environment variable ``IDIC_LAWS``,
which workers inherit; an experiment can only ask for a law by its name. See ``docs/add-a-law.md``.
"""

from __future__ import annotations

import hashlib
import importlib.util
import os
import sys
from pathlib import Path

from idic.errors import InputError
from idic.laws.core.law import all_laws

VARIABLE = "IDIC_LAWS"
_PACKAGE = "idic_user_law_"

_sources: dict[str, Path] = {}  # law -> the file that registered it


def load_user_laws() -> None:
    """Import the files that ``IDIC_LAWS`` names; each registers its laws.

    Raises
    ------
    InputError
        A file that is not there, cannot be imported or registers nothing.
    """
    for name in os.environ.get(VARIABLE, "").split(os.pathsep):
        if name:
            # of the path alone: compiled laws are kept on the disk under the name of their module
            place = hashlib.sha256(os.path.abspath(name).encode()).hexdigest()[:12]
            _load(Path(name), f"{_PACKAGE}{place}_{Path(name).stem}")


def source_of(law: str) -> Path | None:
    """The user's file that a law comes from; None for the laws of this package."""
    return _sources.get(law)


def _load(path: Path, module_name: str) -> None:
    if module_name in sys.modules:
        return
    if not path.is_file():
        raise InputError("no such file of laws", file=path, key=f"--laws ({VARIABLE})", expected="a Python file",
                         found="nothing there", remedy="correct the path")
    earlier = set(all_laws())
    spec = importlib.util.spec_from_file_location(module_name, path)
    if spec is None or spec.loader is None:
        raise InputError("this is not a file of laws", file=path, key=f"--laws ({VARIABLE})",
                         expected="a Python file (*.py)",
                         found=f"a file named *{path.suffix}" if path.suffix else "a name without an ending",
                         remedy="give the file the ending .py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[module_name] = module  # numba looks functions up by the name of their module
    try:
        spec.loader.exec_module(module)
    except Exception as problem:
        del sys.modules[module_name]
        raise InputError("a file of laws cannot be imported", file=path, key=f"--laws ({VARIABLE})",
                         expected="Python that registers a LawSpec", found=f"{type(problem).__name__}: {problem}",
                         remedy="correct it; docs/add-a-law.md shows such a file") from problem
    registered = set(all_laws()) - earlier
    if not registered:
        del sys.modules[module_name]  # or a second attempt would pass
        raise InputError("a file of laws registers none", file=path, key=f"--laws ({VARIABLE})",
                         expected="register(LawSpec(...))", found="no new law",
                         remedy="add it; docs/add-a-law.md shows how")
    _sources.update(dict.fromkeys(registered, path))
