"""An identification in memory: what a RUN does with files, for an experiment of Python objects."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, Protocol

import numpy as np
from threadpoolctl import threadpool_limits

from idic.correlation import texture_pairs
from idic.identification import (
    FrameFit, Identification, PointFit, experiment_result, identify, log_progress,
)
from idic.model import Experiment
from idic.plain_values import finite
from idic.run.fields import FieldsInMemory
from idic.run.knots import chosen_tables
from idic.run.postprocess import has_force
from idic.run.prepared.in_memory import Prepared, prepare_in_memory


class Holder(Protocol):
    """What holds the record of an experiment."""

    @property
    def record(self) -> Experiment: ...


def identify_in_memory(experiment: Experiment, tables: Mapping[str, Any],
                       changed: Callable[[Mapping[str, Any]], Holder],
                       say: Callable[[str], None]) -> tuple[dict, FieldsInMemory]:
    """Identify the free parameters of an experiment in this process.

    Parameters
    ----------
    tables : of its experiment.toml
    changed : the experiment with other values of its tables
    say : called with a line per evaluated point

    Returns
    -------
    The content of a result.json, and the fields of the identified point.
    """
    began, cpu = time.perf_counter(), time.process_time()
    with threadpool_limits(1, user_api="blas"):
        if experiment.model.curves_by_evidence:
            experiment = changed(chosen_tables(experiment, tables, say)).record
        prepared = prepare_in_memory(experiment, say)
        identification = identify(prepared.start, prepared.local, progress=log_progress(say),
                                  motion=prepared.motion, searched=prepared.begin is not None)
        fields = FieldsInMemory(identification)
        content = experiment_result(prepared.experiment, identification.state, identification.point,
                                    identification.weights, _fit(prepared, identification, fields),
                                    experiment.recording.excluded,
                                    {"forward_runs": identification.state.evaluations},
                                    identification.discrepancy)
    content["has_force"] = has_force(prepared.experiment.model)
    content["cost"] |= {"wall_s": time.perf_counter() - began, "cpu_s": time.process_time() - cpu}
    say(content["status"])
    return finite(content), fields


def _fit(prepared: Prepared, identification: Identification, fields: FieldsInMemory) -> PointFit:
    """How well the accepted point explains the recording."""
    experiment, point = prepared.experiment, identification.point
    stacks = [prepared.free_dics.get(view.recording.camera_name) for view in experiment.views]
    free_fits = [None if stack is None else {"chi2_dof": stack.chi2_dof, "rms_gv": stack.rms_gv} for stack in stacks]
    if point is None or point.system is None:
        return PointFit([{} for _ in experiment.views], np.zeros((0, len(experiment.model.channels))), free_fits)
    frames = [_frame_fits(identification, fields, number) for number in range(len(experiment.views))]
    channels = (fields.measured - fields.simulated)[experiment.correlated_frames(range(experiment.model.n_frames))]
    return PointFit(frames, channels, free_fits, texture_pairs(fields.context) if experiment.cameras else ())


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
