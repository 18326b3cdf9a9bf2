"""The judgement of an accepted point: free FE-DIC beside the model, local test, camera's floor, remedies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field

from idic.correlation.view import GREY, view_of
from idic.dic.camera_floor import CameraFloor
from idic.identify.frame_fit import FrameFit, mean_chi2, used_fits
from idic.identify.judgement.local_residual import ElementSums, LocalResidual, local_residual
from idic.identify.judgement.remedies import Remedy, try_remedies
from idic.report.fit_words import NOISE_CHI2
from idic.run.context import RunContext, correlation_context, open_run
from idic.run.judgement.floor import PointJob, floor_content, measure_floor, measured_floor, simulated_motion
from idic.run.judgement.free import free_summary, measure_free, measured_free
from idic.run.judgement.shown_frames import shown_frames
from idic.store.layout import FLOOR, FREE
from idic.workers.runner import TaskRunner


@dataclass(frozen=True)
class Judgement:
    """What joins result.json: entries of ``residual``, entries of the top level, and the floor as it is."""

    residual: dict = field(default_factory=dict)
    top: dict = field(default_factory=lambda: {"camera_floor": floor_content(None, None), "remedies": []})
    floor: CameraFloor | None = None


def judged(job: PointJob, fits: Mapping[int, FrameFit], sums: Sequence[ElementSums], runner: TaskRunner) -> Judgement:
    """Judge an accepted point; fits : of the main camera by frame; sums : of its elements, over runs of frames."""
    context = open_run(job.run)
    missing = [name for name in _MEASURED if context.store.finished(name, {"evaluation": job.evaluation}) is None]
    runner.map(_measure, [(name, job) for name in missing], missing, retries=1)  # side by side
    floor, free = measured_floor(job, runner), measured_free(job, runner)
    local = _local(context, job, sums)
    chi2 = mean_chi2(used_fits(context.experiment, fits))
    wanting = (chi2 is not None and chi2 > NOISE_CHI2[1]) or (local is not None and local.is_cluster)
    tried: Sequence[Remedy] = runner.map(tried_remedies, [job], ["remedies"], retries=1)[0] if wanting else ()
    return Judgement(
        {"local": None if local is None else asdict(local),
         "free_dic_shown": free_summary(free, {k: fit.chi2_dof for k, fit in fits.items()})},
        {"camera_floor": floor_content(context, floor), "remedies": [asdict(one) for one in tried]}, floor)


_MEASURED = {FLOOR: measure_floor, FREE: measure_free}  # group of the store -> task


def _measure(job: tuple[str, PointJob]) -> None:
    """Measure one of them (a task)."""
    _MEASURED[job[0]](job[1])


def tried_remedies(job: PointJob) -> tuple[Remedy, ...]:
    """Remedies for light and aliasing at the accepted motion, on the frames that the report shows (a task).

    None of heights and measured fields.
    """
    context = open_run(job.run)
    parameters = context.experiment.parameters.with_values(job.values)
    shared = correlation_context(context, parameters)
    experiment = shared.experiment
    if view_of(experiment, shared.camera).kind != GREY or experiment.points is not None or not experiment.noise.std_gv:
        return ()
    return try_remedies(experiment, shared.camera, shown_frames(experiment),
                        simulated_motion(context, job.evaluation, parameters))


def _local(context: RunContext, job: PointJob, sums: Sequence[ElementSums]) -> LocalResidual | None:
    if not sums:
        return None
    shared = correlation_context(context, context.experiment.parameters.with_values(job.values))
    return local_residual(shared.reference.image.pixel_map, sums)
