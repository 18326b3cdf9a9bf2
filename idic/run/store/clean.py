"""Makes a RUN folder smaller: what `idic report` makes again, or everything but the results."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path

from idic.errors import InputError
from idic.inside import is_inside, read_inside, remove_inside
from idic.run.store.layout import EXPERIMENTS, SCRATCH
from idic.run.store.result_file import RESULT_FILE
from idic.run.store.run_lock import run_lock
from idic.run.store.state_file import load_state

DIAGNOSIS = "diagnosis.json"
PICTURES = "figures"  # the pages hold copies of them
MADE_AGAIN = ("paraview", SCRATCH)
WORKING_FILES = ("run.zarr", "state.json", "state.copy.json", "run.json", "run.copy.json")


def clean_run(run: Path | str, results_only: bool = False) -> int:
    """Remove pictures and ParaView files of a finished RUN; `idic report` writes them again.

    Pages, tables, results, images, motions and pictures that a diagnosis cites stay, so that resume, report and
    diagnosis work.

    Parameters
    ----------
    run : the RUN folder, of one experiment or of several
    results_only : also remove images, motions and state; pages, tables, figures of a diagnosis and result.json stay

    Returns
    -------
    Bytes freed.

    Raises
    ------
    InputError
        The folder holds no finished identification, or a process works on it; nothing is removed. An interrupted
        one is not made its results alone: it could no longer be resumed.
    """
    run = Path(run)
    if not is_inside(run, RESULT_FILE):
        raise _unfinished(run, "none")
    with ExitStack() as locks:
        locks.enter_context(run_lock(run))
        if results_only and _is_interrupted(run):
            raise _unfinished(run, "an interrupted one, which --resume needs whole")
        parts = sorted((run / EXPERIMENTS).iterdir()) if _is_folder(run / EXPERIMENTS) else []
        parts = [part for part in parts if _is_folder(part)]
        for part in parts:  # one of them may be diagnosed just now
            locks.enter_context(run_lock(part))
        return sum(_clean(part, results_only) for part in (run, *parts))


def _unfinished(run: Path, found: str) -> InputError:
    return InputError("no finished identification", file=run, expected=f"a RUN folder with {RESULT_FILE}, finished",
                      found=found,
                      remedy="name a folder that idic identify has written; an interrupted one continues with --resume")


def _is_interrupted(run: Path) -> bool:
    """Whether steps remain to be done; a damaged state tells nothing."""
    try:
        state = load_state(run)
    except InputError:
        return False
    return state is not None and state.running


def _clean(folder: Path, results_only: bool) -> int:
    cited = read_inside(folder, DIAGNOSIS).decode(errors="replace") if is_inside(folder, DIAGNOSIS) else ""
    doomed = [folder / name for name in (*MADE_AGAIN, *(WORKING_FILES if results_only else ()))]
    if _is_folder(folder / PICTURES):
        doomed += [file for file in (folder / PICTURES).iterdir() if file.is_file() and file.name not in cited]
    freed = 0
    for path in doomed:
        freed += _size(path)
        remove_inside(folder, path.relative_to(folder))
    return freed


def _size(path: Path) -> int:
    files = path.rglob("*") if _is_folder(path) else [path]
    return sum(file.lstat().st_size for file in files if file.is_symlink() or file.is_file())


def _is_folder(path: Path) -> bool:
    """A folder of the RUN itself; what a link leads to is not the RUN's."""
    return path.is_dir() and not path.is_symlink()
