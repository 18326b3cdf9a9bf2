"""The identification as one call: in memory, or into a RUN folder; and a finished RUN again."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from idic.correlation import correlated_frames, texture_pairs
from idic.errors import InputError
from idic.experiment_file import by_evidence, with_overrides
from idic.identification import (
    FrameFit, Identification, PointFit, experiment_result, identify as identify_record, log_progress,
)
from idic.notebook.experiment import Experiment
from idic.notebook.fields import FieldsInMemory, FieldsOfRun
from idic.notebook.result import Result
from idic.run import (
    FROM_PYTHON, Console, Folders, Prepared, Workplace, chosen_tables, finite, has_force, identify_run,
    prepare_in_memory, read_result,
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
        return _in_memory(single.changed(overrides) if overrides else single, say)
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


def _in_memory(experiment: Experiment, say: Callable[[str], None]) -> Result:
    began, cpu = time.perf_counter(), time.process_time()
    with threadpool_limits(1, user_api="blas"):
        if by_evidence(experiment.record.model):
            experiment = experiment.changed(chosen_tables(experiment.record, with_overrides(experiment.tables, None),
                                                          say))
        prepared = prepare_in_memory(experiment.record, say)
        identification = identify_record(prepared.start, prepared.local, progress=log_progress(say),
                                         motion=prepared.motion, searched=prepared.begin is not None)
        fields = FieldsInMemory(identification)
        content = experiment_result(prepared.experiment, identification.state, identification.point,
                                    identification.weights, _fit(prepared, identification, fields),
                                    experiment.record.recording.excluded,
                                    {"forward_runs": identification.state.evaluations},
                                    identification.discrepancy)
    content["has_force"] = has_force(prepared.experiment.model)
    content["cost"] |= {"wall_s": time.perf_counter() - began, "cpu_s": time.process_time() - cpu}
    say(content["status"])
    return Result(finite(content), fields)


def _fit(prepared: Prepared, identification: Identification, fields: FieldsInMemory) -> PointFit:
    """How well the accepted point explains the recording."""
    experiment, point = prepared.experiment, identification.point
    stacks = [prepared.free_dics.get(view.recording.camera_name) for view in experiment.views]
    free = [None if stack is None else {"chi2_dof": stack.chi2_dof, "rms_gv": stack.rms_gv} for stack in stacks]
    if point is None or point.system is None:
        return PointFit([{} for _ in experiment.views], np.zeros((0, len(experiment.model.channels))), free)
    frames = [_frame_fits(identification, fields, number) for number in range(len(experiment.views))]
    channels = (fields.measured - fields.simulated)[correlated_frames(experiment, range(experiment.model.n_frames))]
    return PointFit(frames, channels, free, texture_pairs(fields.context) if experiment.cameras else ())


def _frame_fits(identification: Identification, fields: FieldsInMemory, number: int) -> dict[int, FrameFit]:
    """How well every frame of a camera is explained."""
    experiment, fits = identification.experiment, {}
    sigma = fields.context.cameras[number].experiment.recording.noise.std_gv
    records = identification.point.system.frames
    lost = {record.frame for record in records if record.cameras[number, 0] == 0}
    fitted = {record.frame: record.n_fitted for record in records}
    for frame in range(experiment.model.reference + 1, experiment.model.n_frames):
        fit = FrameFit.of(frame, fields.pixels(frame, number), sigma, fitted.get(frame, 0.0))
        fits[frame] = replace(fit, n_pixels=0) if frame in lost else fit
    return fits
