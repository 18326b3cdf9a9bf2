"""A free FE-DIC of the frames that the report shows: measured once after the last iteration, kept in
``run.zarr/free``."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from idic.measure import Seen
from idic.parameters import ParameterSet
from idic.report import FreeMotions
from idic.run.judgement.floor import PointJob, simulated_motion
from idic.run.judgement.shown_frames import shown_frames
from idic.run.prepared.context import RunContext, correlation_context, open_run
from idic.run.store.arrays import read_array, rounded, write_array
from idic.run.store.layout import FREE
from idic.run.store.run_store import RunStore
from idic.run.workers.runner import TaskRunner

DIGITS = 17  # binary ones of a measured motion: 1e-4 px of ten; its noise is 1e-3 px and more


def measured_free(job: PointJob, runner: TaskRunner) -> FreeMotions | None:
    """The free FE-DIC at an accepted point, from the store or measured now; None where there is none of this kind."""
    store = RunStore(job.run)
    if store.finished(FREE, {"evaluation": job.evaluation}) is None:
        runner.map(measure_free, [job], ["free-dic-of-shown-frames"], retries=1)
    return read_free(store, job.evaluation)


def measure_free(job: PointJob) -> None:
    """Measure and store it (a task)."""
    context = open_run(job.run)
    motions = _free(context, job.evaluation, context.experiment.model.parameters.with_values(job.values))
    with context.store.building(FREE, {"evaluation": job.evaluation}) as folder:
        write_array(folder, "frames", np.array(() if motions is None else motions.frames, dtype=np.int64))
        if motions is not None:
            for name in ("difference_px", "u_full_px"):
                write_array(folder, name, rounded(getattr(motions, name), DIGITS))
            for name in ("brightness", "chi2_dof"):
                write_array(folder, name, getattr(motions, name))
            write_array(folder, "length_px", np.array([motions.length_px]))


def read_free(store: RunStore, evaluation: int) -> FreeMotions | None:
    """What `measure_free` stored for this point; None where nothing was measured."""
    folder = store.finished(FREE, {"evaluation": evaluation})
    if folder is None:
        return None
    frames = tuple(read_array(folder, "frames").tolist())
    if not frames:
        return None
    difference, chi2, length = (read_array(folder, name) for name in ("difference_px", "chi2_dof", "length_px"))
    return FreeMotions(frames, difference, read_array(folder, "u_full_px"), read_array(folder, "brightness"), chi2,
                       float(length[0]))


def free_summary(motions: FreeMotions | None, model_chi2: Mapping[int, float]) -> dict | None:
    """The entry ``residual.free_dic_shown`` of result.json: mean χ² of both over the same frames.

    model_chi2 : of the frames that show the specimen; the others are left out
    """
    free_chi2 = {} if motions is None else {k: float(chi2)
                                            for k, chi2 in zip(motions.frames, motions.chi2_dof, strict=True)
                                            if k in model_chi2}
    if not free_chi2:
        return None
    return {"frames": list(free_chi2), "chi2_dof": float(np.mean(list(free_chi2.values()))),
            "model_chi2_dof": float(np.mean([model_chi2[k] for k in free_chi2]))}


def _free(context: RunContext, evaluation: int, parameters: ParameterSet) -> FreeMotions | None:
    shared = correlation_context(context, parameters)
    if not shared.experiment.recording.noise.std_gv:
        return None
    dic_setup = Seen.by(shared.experiment, shared.reference.image)
    if dic_setup is None:
        return None
    return FreeMotions.of(dic_setup, shown_frames(shared.experiment), simulated_motion(context, evaluation, parameters))
