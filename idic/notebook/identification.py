"""The identification as one call: in memory, or into a RUN folder; and a finished RUN again."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from idic.errors import InputError
from idic.experiment_file import with_overrides
from idic.notebook.experiment import Experiment
from idic.notebook.result import Result
from idic.run import (
    FROM_PYTHON, Console, FieldsOfRun, Folders, Workplace, identify_in_memory, identify_run, read_result,
)


def identify(experiment: Experiment | Folders, out: str | os.PathLike | None = None, *,
             overrides: Mapping[str, Any] | None = None, say: Callable[[str], None] = lambda text: None,
             resume: bool = False, workers: int = 0, sensitivity: str = "auto") -> Result:
    """Identify the free parameters of an experiment.

    Parameters
    ----------
    experiment : idic.Experiment, or the path of an experiment folder, or with `out` a list of several paths: materials
        of the same name are shared
    out : RUN folder, optional
        As ``idic identify`` writes it, with report and resume. An experiment of Python objects is saved in it first.
        Without a RUN everything stays in memory and in this process; the numbers are the same.
    overrides : ``{"SPECIMEN.E": 60e3, "options.max_iterations": 10}``: as ``--set key=value``
    say : called with a line per evaluated point, e.g. ``print``
    resume : resume an interrupted run in `out`
    workers : of a RUN: 0 runs everything in this process, otherwise so many Dask processes (then call it from a file
        whose code is under ``if __name__ == "__main__":``)
    sensitivity : of a RUN: "direct", "perturbed" or "auto"

    Raises
    ------
    InputError
        If anything in the input is not what was expected.
    """
    if out is None:
        for key, value, default in (("resume", resume, False), ("workers", workers, 0),
                                    ("sensitivity", sensitivity, "auto")):
            if value != default:
                raise InputError(f"{key} without a RUN folder", key=key, expected="out, a folder for the run",
                                 found=f"{key} = {value!r}", remedy=f'give out="runs/first", or leave {key} out')
        single = experiment if isinstance(experiment, Experiment) else Experiment.read(_folder(experiment))
        chosen = single.changed(overrides) if overrides else single
        return Result(*identify_in_memory(chosen.record, with_overrides(chosen.tables, None), chosen.changed, say))
    run, changes = Path(out), overrides
    folders: Folders
    if isinstance(experiment, Experiment):
        edited = experiment.changed(overrides) if overrides else experiment
        folders, changes = edited.as_files(run / FROM_PYTHON)
    elif isinstance(experiment, Sequence) and not isinstance(experiment, str):
        folders = [_folder(entry) for entry in experiment]
    else:
        folders = _folder(experiment)
    content = identify_run(folders, run, resume=resume, overrides=changes, sensitivity=sensitivity,
                           workplace=Workplace(workers), console=Console.of_lines(say))
    say(content["status"])
    return load_result(run)


def _folder(experiment: object) -> str | os.PathLike:
    """The path of an experiment folder (`InputError` where it is none)."""
    if isinstance(experiment, (str, os.PathLike)):
        return experiment
    raise InputError("not an experiment", key="experiment", expected="an idic.Experiment, or the path of a folder",
                     found=type(experiment).__name__,
                     remedy="identify several together from their folders, into a RUN: "
                            "idic.identify([first, second], out=run)")


def load_result(run: str | os.PathLike) -> Result:
    """The result of a finished RUN folder, with its fields.

    Raises
    ------
    InputError
        If the folder holds no result.
    """
    content = read_result(run)
    return Result(content, FieldsOfRun(Path(run), content))
