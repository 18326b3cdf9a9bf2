"""The folder in a RUN that holds the files of an experiment of Python objects, from which it is identified."""

from __future__ import annotations

import filecmp
import os
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path

from idic.errors import InputError
from idic.run import RESULT_FILE

BEGUN = ("run.zarr", RESULT_FILE)  # either makes a RUN of a folder; `idic clean` leaves the second
MAX_NAMED = 3  # files that a message names


def saved_in_run(save: Callable[[Path], Path], folder: Path) -> Path:
    """The experiment saved in `folder` of a RUN; the same one, saved before, stays; another one is replaced.

    save : writes the experiment into a new or empty folder

    Raises
    ------
    InputError
        The RUN began with another experiment.
    """
    if not folder.exists():
        return save(folder)
    with tempfile.TemporaryDirectory(prefix=f"{folder.name}-", dir=folder.parent) as scratch:
        fresh = save(Path(scratch) / folder.name)
        if not (changed := _differences(fresh, folder)):
            return folder
        if any((folder.parent / name).exists() for name in BEGUN):
            changes = ", ".join(changed[:MAX_NAMED]) + (" …" if len(changed) > MAX_NAMED else "")
            raise InputError("the RUN holds another experiment", file=folder.parent, key="out",
                             expected=f"the experiment that was saved in {folder.name}",
                             found=f"other content of {changes}",
                             remedy="give another out, or delete the RUN; its values belong to the saved experiment")
        shutil.rmtree(folder)
        os.replace(fresh, folder)
    return folder


def _differences(fresh: Path, saved: Path) -> list[str]:
    """Names of files that one folder alone has, or with other content; links are followed."""
    names = [{path.relative_to(folder).as_posix() for path in folder.rglob("*") if not path.is_dir()}
             for folder in (fresh, saved)]
    return sorted(names[0] ^ names[1]) + sorted(name for name in names[0] & names[1]
                                                if not _alike(fresh / name, saved / name))


def _alike(file: Path, counterpart: Path) -> bool:
    try:
        return os.path.samefile(file, counterpart) or filecmp.cmp(file, counterpart, shallow=False)
    except OSError:  # a link to a file that is gone
        return False
