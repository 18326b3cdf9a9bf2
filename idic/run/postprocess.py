"""After the last iteration: χ² of every frame, the judgement, the result file; what only the iterations needed is
removed.

``run.zarr/final`` holds the residual maps of the frames that the report shows; `idic.run.judgement.residual_maps`
computes those of any frame from the stored motion and images.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

import numpy as np

from idic.correlation import TexturePair, ViewKind, texture_pairs
from idic.identification import ElementSums, Evaluation, FrameFit, LoopState, PointFit, chunk_frames, experiment_result
from idic.model import Experiment, Model, Stage
from idic.run.judgement.cracks import crack_results
from idic.run.judgement.accepted_point import channel_table, solver_notes
from idic.run.judgement.discrepancy import discrepancy_job, discrepancy_of
from idic.run.judgement.fields import write_fields
from idic.run.judgement.floor import PointJob
from idic.run.judgement.judgement import Judgement, judged
from idic.run.judgement.residual_maps import PointResiduals
from idic.run.judgement.shown_frames import shown_frames
from idic.run.prepared.context import RunContext, correlation_context, open_run
from idic.run.prepared.prepare import read_free_dic
from idic.run.prepared.session import Session, Timing
from idic.run.recovery.recover import EVALUATIONS, START, SYSTEM, remove_damaged_judgement
from idic.run.store.arrays import FrameArrays, write_array
from idic.run.store.camera_groups import group_of
from idic.run.store.layout import BASE, group_name
from idic.run.store.result_file import write_result
from idic.run.store.system_store import load_evaluation
from idic.run.workers.dask_settings import cpu_seconds
from idic.run.workers.peak_memory import peak_memory_mb

MAPS = "final"
# binary digits; without the influence of frame-local unknowns
KEPT_OF_THE_END = {"u": None, "channels": None, "steps": None, "du": 24, "dchannels": None}
KEPT_OF_THE_START = {"u": 17, "channels": None, "steps": None}  # for a picture of the residual before
KEPT_OF_THE_DIC = {"u_px": 24}  # to 1e-6 px; the noise is 1e-3 px
INTERRUPTED = "the run was interrupted: std counts noise alone"
MAP_STEPS = 4  # of a residual map in a standard deviation of the noise


@dataclass(frozen=True)
class FitJob:
    """How well some frames of an evaluated point are explained; target : array of the maps of
    `map_frames`."""

    run: str
    evaluation: int
    frames: tuple[int, ...]
    values: Mapping[str, float]
    brightness: Mapping[int, tuple[float, ...]]  # frame -> gain and offset per patch
    camera: int
    target: str
    map_frames: tuple[int, ...]
    fitted: Mapping[int, float] = field(default_factory=dict)  # frame -> `FrameRecord.n_fitted`


def fit_frames(job: FitJob) -> tuple[list[FrameFit], ElementSums | None]:
    """How well each frame is explained (a task), and the sums of the elements over the correlated ones (None: no pixels
    in elements)."""
    at = PointResiduals(open_run(job.run), job.evaluation, job.values, job.brightness, job.camera)
    maps = FrameArrays.open(Path(job.target).parent, Path(job.target).name, "r+") if job.map_frames else None
    sigma, kind = at.experiment.recording.noise.std_gv, at.kind
    fits, sums = [], None
    correlated = set(at.experiment.correlated_frames(job.frames))
    for frame in job.frames:
        pixels = at.compare(frame)
        fits.append(FrameFit.of(frame, pixels, sigma, job.fitted.get(frame, 0.0)))
        if maps is not None and frame in job.map_frames:
            maps.write(job.map_frames.index(frame), _in_steps(at.as_image(pixels), sigma)[None])
        if kind in (ViewKind.GREY, ViewKind.SPACE) and frame in correlated and sigma and fits[-1].n_pixels:
            frame_sums = ElementSums.of(at.reference.pixel_map, pixels, sigma)
            sums = frame_sums if sums is None else sums + frame_sums
    return fits, sums


def _in_steps(residual: np.ndarray, sigma: float | None) -> np.ndarray:
    """A residual map in steps of at most a quarter of the noise, a power of two: a third of the room."""
    if not sigma:
        return residual
    step = 2.0 ** np.floor(np.log2(sigma / MAP_STEPS))
    return (np.round(residual / step) * step).astype(residual.dtype)


def postprocess(session: Session, state: LoopState, timing: Timing, began: float, stage: Stage) -> dict:
    """Write the ``result.json`` of an experiment; returns its content.

    stage : as which the images are seen
    """
    context, experiment = session.context, session.experiment
    point, judgement = None, Judgement()
    fit = PointFit([{} for _ in experiment.views], np.zeros((0, len(experiment.model.channels))), _free_dics(context))
    if state.accepted is not None:
        point = load_evaluation(context.store, state.accepted.number, context.names)
        frames, sums = _fits_of_cameras(session, state, point)
        fit = replace(fit, frames=frames, channels=_channel_residual(context, state),
                      textures=_textures(context, state) if experiment.cameras else (),
                      notes=solver_notes(context, state.accepted.values, state.accepted.number))
        _write_channels(context, state)
        job = PointJob(session.run, state.accepted.number, state.accepted.values)
        remove_damaged_judgement(context.store)
        judgement = judged(job, frames[0], sums, session.runner, discrepancy_job(session, state, point, stage))
        write_fields(job, session.runner)
    result = experiment_result(experiment, state, point, context.weights, fit, context.settings["excluded_by_user"],
                               _cost(state, timing, began), discrepancy_of(session, state, point, stage))
    if state.accepted is not None and experiment.model.cracks:
        result["cracks"] = crack_results(context, state.accepted.number, state.accepted.values, result)
    result |= judgement.top | {"has_force": has_force(experiment.model), "sensitivity": session.sensitivity}
    result["residual"] |= judgement.residual
    write_result(session.run, result)
    if state.status != "interrupted" and state.accepted is not None:
        _thin(context, state)
    return result


def _thin(context: RunContext, state: LoopState) -> None:
    """Remove what only further steps would read: the iterations are over.

    The report reads the motion of the first point, and motion and sensitivities of the accepted one.
    """
    number = state.accepted.number
    context.store.thin(group_name(number, BASE), KEPT_OF_THE_END)
    for camera in range(len(context.experiment.views)):
        name = group_of(context.experiment, camera, "dic")
        if (folder := context.store.finished(name)) is not None:
            context.store.thin(name, {array.name: KEPT_OF_THE_DIC.get(array.name) for array in folder.glob("*/")})
    if number == 0 or state.history[0]["phi"] is None:
        return
    for folder in sorted(context.store.path.joinpath(group_name(0, BASE)).parent.glob("*/")):
        if folder.name in (START, SYSTEM) or folder.name.startswith("."):
            continue
        name = f"{EVALUATIONS}/{folder.parent.name}/{folder.name}"
        if folder.name == BASE:
            context.store.thin(name, KEPT_OF_THE_START)
        else:
            context.store.remove(name)


def write_interrupted(session: Session, state: LoopState, timing: Timing, began: float) -> dict:
    """Write the accepted parameters of an interrupted run to the ``result.json`` of an experiment; returns its content.

    Without residual maps, so that the command ends at once.
    """
    context, experiment = session.context, session.experiment
    point = load_evaluation(context.store, state.accepted.number, context.names)
    fit = PointFit([{} for _ in experiment.views], _channel_residual(context, state), _free_dics(context))
    result = experiment_result(experiment, state, point, context.weights, fit, context.settings["excluded_by_user"],
                               _cost(state, timing, began), INTERRUPTED)
    result["sensitivity"] = session.sensitivity
    write_result(session.run, result)
    return result


def has_force(model: Model) -> bool:
    """Whether a force or a pressure is known: motion alone gives no stress."""
    return bool(model.loads) or any(channel.is_load for channel in model.channels)


def _fits_of_cameras(session: Session, state: LoopState,
                     point: Evaluation) -> tuple[list[dict[int, FrameFit]], list[ElementSums]]:
    """How well each frame of every camera is explained; element sums of the main one."""
    cameras = [_fits_of(session, state, point, number) for number in range(len(session.experiment.views))]
    return [fits for fits, _ in cameras], cameras[0][1]


def _fits_of(session: Session, state: LoopState, point: Evaluation,
             number: int) -> tuple[dict[int, FrameFit], list[ElementSums]]:
    """The same of one camera, as tasks over chunks of frames."""
    experiment, size = session.experiment, chunk_frames(session.experiment.model.n_frames)
    frames = tuple(range(experiment.model.reference + 1, experiment.model.n_frames))
    if not frames:
        return {}, []
    brightness = {record.frame: tuple(record.brightness_of(number).tolist()) for record in point.system.frames}
    fitted = {record.frame: record.n_fitted for record in point.system.frames if record.n_fitted}
    map_frames, view = shown_frames(experiment), experiment.views[number]
    with session.context.store.building(group_of(experiment, number, MAPS),
                                        {"evaluation": state.accepted.number}) as folder:
        write_array(folder, "frames", np.array(map_frames, dtype=np.int64))
        # three digits are enough to look at
        dtype = "f2" if _is_8_bit(view) else "f4"
        FrameArrays.create(folder, "residual", len(map_frames), view.recording.image_shape, 1, dtype, compressed=True)
        jobs = [FitJob(session.run, state.accepted.number, chunk, state.accepted.values,
                       {k: brightness[k] for k in chunk if k in brightness}, number, str(folder / "residual"),
                       map_frames, {k: fitted[k] for k in chunk if k in fitted})
                for chunk in (frames[i:i + size] for i in range(0, len(frames), size))]
        labels = [f"residual-{view.recording.camera_name}-frames{job.frames[0]}-{job.frames[-1]}" for job in jobs]
        parts = session.runner.map(fit_frames, jobs, labels, retries=1)
    fits = {fit.frame: fit for part, _ in parts for fit in part}
    lost = {r.frame for r in point.system.frames if r.cameras[number, 0] == 0}  # nothing of the pattern in them
    return ({k: replace(fit, n_pixels=0) if k in lost else fit for k, fit in fits.items()},
            [sums for _, sums in parts if sums is not None])


def _is_8_bit(view: Experiment) -> bool:
    stack, reference = view.recording.stack, view.model.reference
    if view.recording.quantity == "volume":
        first = slice(0, 1)
        return np.asarray(stack.block(reference, first, first, first)).dtype == np.uint8
    return np.asarray(stack.frame(reference)).dtype == np.uint8


def _textures(context: RunContext, state: LoopState) -> tuple[TexturePair, ...]:
    parameters = context.experiment.model.parameters.with_values(state.accepted.values)
    return texture_pairs(correlation_context(context, parameters))


def _channel_residual(context, state: LoopState) -> np.ndarray:
    """Measured minus simulated of the correlated frames at the accepted point  # (n_frames, n_channels)"""
    experiment = context.experiment
    simulated, measured = channel_table(context, state.accepted.values, state.accepted.number)
    frames = experiment.correlated_frames(range(experiment.model.n_frames))
    return (measured - simulated)[frames]


def _write_channels(context, state: LoopState) -> None:
    with context.store.building("channels", {"evaluation": state.accepted.number}) as folder:
        simulated, measured = channel_table(context, state.accepted.values, state.accepted.number)
        write_array(folder, "simulated", simulated)
        write_array(folder, "measured", measured)


def _free_dics(context: RunContext) -> list[dict[str, np.ndarray] | None]:
    """What a free FE-DIC leaves in every frame, per camera; None where none was made."""
    groups = [group_of(context.experiment, number, "dic") for number in range(len(context.experiment.views))]
    return [None if context.store.finished(name) is None else read_free_dic(context.store, name) for name in groups]


def _cost(state: LoopState, timing: Timing, began: float) -> dict:
    spent = asdict(timing)
    cpu = cpu_seconds() - spent.pop("cpu_before_s")
    return spent | {"wall_s": time.perf_counter() - began, "cpu_s": cpu, "peak_rss_mb": peak_memory_mb()}
