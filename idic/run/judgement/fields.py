"""The fields of a RUN at its accepted point: measured motion and its noise, stress and state; kept in
``run.zarr/fields``.

Arrays of the group (docs/fields.md): ``frames``, ``nodes`` (numbers from 0 in the mesh), ``measured`` and ``noise``
(mm; in space by two cameras with a lens), ``smoothed`` (mm), ``stress`` (MPa), ``state.NAME``. The simulated motion is
that of the evaluation.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from idic.correlation import CorrelationContext, in_space
from idic.errors import NotConverged
from idic.images import Camera
from idic.measure import FieldSeries, Seen, SeenInSpace, in_mm, simulated_states, surface_of
from idic.model import Experiment, ForwardModel, Model
from idic.run.judgement.floor import PointJob, simulated_motion
from idic.run.prepared.context import RunContext, correlation_context, open_run
from idic.run.prepared.tasks import read_motion
from idic.run.store.arrays import FrameArrays, read_array, rounded, write_array
from idic.run.store.layout import BASE, FIELDS, group_name
from idic.run.workers.runner import TaskRunner

MAX_FIELD_FRAMES = 60  # of a long test, evenly spread: each costs a free FE-DIC
FRAMES_PER_TASK = 6
_STATE = "state."
DIGITS, MEASURED_DIGITS, NOISE_DIGITS = 20, 17, 12  # of stress and state, motion, noise


@dataclass(frozen=True)
class FieldJob:
    """A part of the fields of an evaluated point, to be written into the folder `target`.

    frames : to be measured, () for the noise; first : number of the first of them in the array
    simulated : stress and state of the laws in these frames instead
    """

    point: PointJob
    target: str
    frames: tuple[int, ...] = ()
    first: int = 0
    simulated: bool = False


def field_frames(experiment: Experiment) -> tuple[int, ...]:
    """The frames whose fields are shown: the reference, and the correlated ones after it, the last among them."""
    model = experiment.model
    frames = [k for k in experiment.correlated_frames(range(model.n_frames)) if k > model.reference]
    picks = np.linspace(0, len(frames) - 1, min(MAX_FIELD_FRAMES - 1, len(frames))) if frames else np.zeros(0)
    return (model.reference, *dict.fromkeys(frames[int(round(p))] for p in picks))


def write_fields(job: PointJob, runner: TaskRunner) -> None:
    """Measure and simulate the fields of an accepted point, unless the store has them; nothing of a cross-section or a
    volume, which show no surface."""
    context = open_run(job.run)
    if context.experiment.model.surface is None and context.experiment.model.n_dim == 3:
        return
    if context.experiment.model.is_section or context.store.finished(FIELDS,
                                                                      {"evaluation": job.evaluation}) is not None:
        return
    frames = field_frames(context.experiment)
    index = surface_of(context.experiment.model.mesh, context.experiment.model.surface).index
    with context.store.building(FIELDS, {"evaluation": job.evaluation}) as folder:
        write_array(folder, "frames", np.array(frames, dtype=np.int64))
        write_array(folder, "nodes", np.asarray(index, dtype=np.int64))
        shared = correlation_context(context, context.experiment.model.parameters.with_values(job.values))
        jobs, names = [FieldJob(job, str(folder), frames, simulated=True)], ["stress-and-state"]
        length, n_components = _measurement(shared)
        if length is not None:
            write_array(folder, "smoothed", np.array([length]))
            FrameArrays.create(folder, "measured", len(frames), (len(index), n_components), 1, "f4", compressed=True)
            parts = [FieldJob(job, str(folder), frames[i:i + FRAMES_PER_TASK], i)
                     for i in range(0, len(frames), FRAMES_PER_TASK)]
            jobs += [*parts, FieldJob(job, str(folder))]
            names += [*(f"fields-frames{part.frames[0]}-{part.frames[-1]}" for part in parts), "fields-noise"]
        runner.map(write_part, jobs, names, retries=1)


def _measurement(shared: CorrelationContext) -> tuple[float | None, int]:
    """Length of the waves that the measurement of a point halves (mm), None: there is none; and its components."""
    if not shared.experiment.recording.noise.std_gv:
        return None, 0
    stereo = _in_space(shared)
    if stereo is not None:
        return stereo.smoother.length_mm, 3
    if not isinstance(shared.camera, Camera):  # a lens does not see a plane
        return None, 0
    dic_setup = Seen.by(shared.experiment, shared.reference.image)
    return (None if dic_setup is None else dic_setup.length_mm(shared.camera)), 2


def _in_space(shared: CorrelationContext) -> SeenInSpace | None:
    """The cameras that measure in space; none of two steps, whose first one has measured each camera by itself."""
    return None if shared.experiment.options.is_two_step else SeenInSpace.of(shared.cameras)


def write_part(job: FieldJob) -> None:
    """A part of the fields (a task)."""
    if job.simulated:
        write_states(job)
    else:
        write_measured(job)


def write_measured(job: FieldJob) -> None:
    """The free FE-DIC of some frames, or without frames of still images that show noise alone."""
    context = open_run(job.point.run)
    parameters = context.experiment.model.parameters.with_values(job.point.values)
    shared = correlation_context(context, parameters)
    stereo = _in_space(shared)
    if stereo is not None:
        _write_in_space(job, context, stereo)
        return
    dic_setup = Seen.by(shared.experiment, shared.reference.image)
    nodes, index = shared.experiment.model.mesh.nodes, read_array(job.target, "nodes")
    if not job.frames:
        noise = dic_setup.noise_samples()
        if noise is not None:
            samples = np.array([in_mm(sample, nodes, shared.camera)[index] for sample in noise])
            write_array(job.target, "noise", rounded(samples.astype(np.float32), NOISE_DIGITS))
        return
    motion = dic_setup.free_motion(job.frames, simulated_motion(context, job.point.evaluation, parameters))
    target = FrameArrays.open(Path(job.target), "measured", "r+")
    for k, (frame, frame_motion) in enumerate(zip(job.frames, motion, strict=True)):
        field_mm = in_mm(frame_motion, nodes, shared.camera, shared.camera.at(frame))[index]
        target.write(job.first + k, rounded(field_mm[None].astype(np.float32), MEASURED_DIGITS))


def _write_in_space(job: FieldJob, context: RunContext, stereo: SeenInSpace) -> None:
    """The free stereo FE-DIC of some frames, or its noise."""
    index, evaluation = read_array(job.target, "nodes"), job.point.evaluation
    if not job.frames:
        noise = stereo.noise_samples()[:, index]
        write_array(job.target, "noise", rounded(noise.astype(np.float32), NOISE_DIGITS))
        return
    u = FrameArrays.open(context.store.group(group_name(evaluation, BASE)), "u")
    first = context.experiment.model.reference
    motion = stereo.motion(job.frames, lambda frame: in_space(u.read(frame - first, frame - first + 1)[0]))[:, index]
    target = FrameArrays.open(Path(job.target), "measured", "r+")
    target.write(job.first, rounded(motion.astype(np.float32), MEASURED_DIGITS))


def write_states(job: FieldJob) -> None:
    """Stress and state of the laws, by one more simulation along the stored one; none of an external solver."""
    context = open_run(job.point.run)
    forward, evaluation = context.forward, job.point.evaluation
    if not isinstance(forward, ForwardModel):
        return
    parameters = context.experiment.model.parameters.with_values(job.point.values)
    local = read_array(context.store.group(group_name(evaluation, "start")), "local")
    base = context.store.group(group_name(evaluation, BASE))
    start = context.experiment.model.reference
    first = FrameArrays.open(base, "u").read(0, 1)
    motions = (u for part in (first, read_motion(context, evaluation)) for u in part)
    states = forward.march(parameters, (), local, read_array(base, "steps"), warm_start=motions, may_cut=True)
    try:
        stress, state = simulated_states(forward.body, states, read_array(job.target, "nodes"),
                                         [frame - start for frame in job.frames])
    except NotConverged as problem:
        write_array(job.target, "failure", np.frombuffer(str(problem).encode(), dtype=np.uint8))
        return
    write_array(job.target, "stress", rounded(stress.astype(np.float32), DIGITS))
    for name, values in state.items():
        write_array(job.target, f"{_STATE}{name}", rounded(values.astype(np.float32), DIGITS))


def read_fields(context: RunContext, evaluation: int, model: Model) -> FieldSeries | None:
    """What `write_fields` stored of a point; None where there is nothing; experiment : at the identified geometry."""
    folder = context.store.finished(FIELDS, {"evaluation": evaluation})
    if folder is None:
        return None
    frames, index = read_array(folder, "frames"), read_array(folder, "nodes")
    u = FrameArrays.open(context.store.group(group_name(evaluation, BASE)), "u")
    simulated = np.array([u.read(k, k + 1)[0][index] for k in frames - model.reference])
    def stored(name: str) -> np.ndarray | None:
        return read_array(folder, name).astype(float) if (folder / name).is_dir() else None

    states = {path.name.removeprefix(_STATE): read_array(folder, path.name).astype(float)
              for path in sorted(folder.iterdir()) if path.name.startswith(_STATE)}
    measured, noise = stored("measured"), stored("noise")
    depth, measured_depth, depth_noise = _depths(model, index, simulated, measured, noise)
    return FieldSeries(surface_of(model.mesh, model.surface), tuple(frames.tolist()), simulated[:, :, :2],
                       None if measured is None else measured[:, :, :2], None if noise is None else noise[:, :, :2],
                       stored("stress"), states, None if (length := stored("smoothed")) is None else float(length[0]),
                       model.kind, model.length_unit, depth=depth, measured_depth=measured_depth,
                       depth_noise=depth_noise)


def _depths(model: Model, index: np.ndarray, simulated: np.ndarray, measured: np.ndarray | None,
            noise: np.ndarray | None) -> tuple[dict, dict, np.ndarray | None]:
    """Motion out of the plane and shape, simulated and measured, and the noise of both; of a sheet, whose seen surface
    is the plane z = 0, where two cameras measure them."""
    is_measured = measured is not None and measured.shape[2] == 3
    if model.mesh.n_dim == 2 and not is_measured:
        return {}, {}, None
    z = in_space(model.mesh.nodes[index])[:, 2]
    rise = simulated[:, :, 2] if simulated.shape[2] == 3 else np.zeros(simulated.shape[:2])
    depth = {"u_z": rise, "z": z + rise}
    if not is_measured:
        return depth, {}, None
    return (depth, {"u_z": measured[:, :, 2], "z": z + measured[:, :, 2]},
            None if noise is None else noise[:, :, 2])
