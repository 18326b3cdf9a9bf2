"""The judgement of an accepted point: free FE-DIC beside the model, local test, camera's floor, causes, remedies.

What takes long is done side by side by the workers, the sums of the discrepancy (`idic.run.judgement.discrepancy`)
among it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

from idic.correlation import ViewKind, view_of
from idic.identification import ElementSums, FrameFit, LocalResidual, Remedy, mean_chi2, used_fits
from idic.measure import CameraFloor
from idic.report import NOISE_CHI2
from idic.run.judgement.causes import cause_of_misfit
from idic.run.judgement.floor import PointJob, floor_content, measure_floor, measured_floor, simulated_motion
from idic.run.judgement.free import free_summary, measure_free, measured_free
from idic.run.judgement.shown_frames import shown_frames
from idic.run.prepared.context import RunContext, correlation_context, open_run
from idic.run.prepared.tasks import CorrelationJob, sum_discrepancy
from idic.run.store.discrepancy_store import LABEL as DISCREPANCY
from idic.run.store.layout import FLOOR, FREE
from idic.run.workers.runner import TaskRunner


@dataclass(frozen=True)
class Judgement:
    """What joins result.json: entries of ``residual``, entries of the top level, and the floor as it is."""

    residual: dict = field(default_factory=dict)
    top: dict = field(default_factory=lambda: {"camera_floor": floor_content(None, None), "remedies": []})
    floor: CameraFloor | None = None


def judged(job: PointJob, fits: Mapping[int, FrameFit], sums: Sequence[ElementSums], runner: TaskRunner,
           discrepancy: CorrelationJob | None = None) -> Judgement:
    """Judge an accepted point.

    Parameters
    ----------
    fits : of the main camera by frame; sums : of its elements, over runs of frames
    discrepancy : the job of `sum_discrepancy`, done at the same time by another worker; None: not wanted
    """
    context = open_run(job.run)
    local = _local(context, job, sums)
    chi2 = mean_chi2(used_fits(context.experiment, fits))
    wanting = (chi2 is not None and chi2 > NOISE_CHI2[1]) or (local is not None and local.is_cluster)
    jobs: dict[str, PointJob | CorrelationJob] = {} if discrepancy is None else {DISCREPANCY: discrepancy}  # longest
    if wanting:
        jobs[REMEDIES] = replace(job, lost=tuple(k for k, fit in fits.items() if not fit.n_pixels))
        jobs[CAUSE] = job
    jobs |= {name: job for name in (FREE, FLOOR)
             if context.store.finished(name, {"evaluation": job.evaluation}) is None}
    results = dict(zip(jobs, runner.map(_do, list(jobs.items()), list(jobs), retries=1), strict=True))  # side by side
    floor, motions, tried = measured_floor(job, runner), measured_free(job, runner), results.get(REMEDIES, ())
    return Judgement(
        {"local": None if local is None else asdict(local), "cause": results.get(CAUSE),
         "free_dic_shown": free_summary(motions, {k: fit.chi2_dof for k, fit in fits.items() if fit.n_pixels})},
        {"camera_floor": floor_content(context, floor), "remedies": [asdict(remedy) for remedy in tried]}, floor)


def _do(named: tuple[str, PointJob | CorrelationJob]) -> Any:
    """One of the tasks of a judgement (a task)."""
    name, job = named
    return _TASKS[name](job)


def tried_remedies(job: PointJob) -> tuple[Remedy, ...]:
    """Remedies for light and aliasing at the accepted motion, on the frames that the report shows (a task).

    None of heights and measured fields.
    """
    context = open_run(job.run)
    parameters = context.experiment.model.parameters.with_values(job.values)
    shared = correlation_context(context, parameters)
    experiment = shared.experiment
    is_grey = view_of(experiment, shared.camera).kind == ViewKind.GREY and experiment.recording.points is None
    if not is_grey or not experiment.recording.noise.std_gv:
        return ()
    return Remedy.tried(experiment, shared.camera, [k for k in shown_frames(experiment) if k not in job.lost],
                        simulated_motion(context, job.evaluation, parameters))


REMEDIES, CAUSE = "remedies", "cause"
_TASKS: dict[str, Callable[[Any], Any]] = {DISCREPANCY: sum_discrepancy, REMEDIES: tried_remedies,
                                           CAUSE: cause_of_misfit, FREE: measure_free,
                                           FLOOR: measure_floor}


def _local(context: RunContext, job: PointJob, sums: Sequence[ElementSums]) -> LocalResidual | None:
    if not sums:
        return None
    shared = correlation_context(context, context.experiment.model.parameters.with_values(job.values))
    return LocalResidual.of(shared.reference.image.pixel_map, sums)
