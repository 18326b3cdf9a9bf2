"""What a Dask worker does: one simulation, or one chunk of frames. Paths in, small records out.

A job is plain data, the function finds everything else in the RUN folder, and running a job twice is harmless.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import chain
from pathlib import Path

import numpy as np

from idic.correlation.comparison import Reference
from idic.correlation.context import CorrelationContext, FrameResponse
from idic.correlation.equations import Weights
from idic.correlation.experiment_reference import build_reference, camera_at
from idic.correlation.frame_equations import correlated_frames, frame_system, with_all_cameras
from idic.correlation.system import CorrelationSystem, reduce_systems
from idic.dic.boundary import BoundaryStart, with_boundary_start
from idic.errors import InputError, NotConverged
from idic.experiment_file.load import load_experiment
from idic.fe.march import increments_to_try
from idic.identify.step.schedule import seen_in
from idic.identify.two_step import is_two_step, measured_reference
from idic.images.camera import Camera
from idic.model.experiment import Experiment, Stage
from idic.model.forward import ForwardModel, build_forward
from idic.parameters import ParameterSet
from idic.run.warm_start import first_order_prediction, repeated
from idic.store.arrays import FrameArrays, read_array, write_array
from idic.store.camera_groups import group_of, with_stored_images, with_stored_noise
from idic.store.checkpoint import from_hex, load_checkpoint, to_hex
from idic.store.layout import (BASE, DESCRIPTION, DESCRIPTION_SCHEMA, EXPERIMENTS, SCRATCH, group_name, local_label,
                               stored_frames)
from idic.store.run_store import RunStore


@dataclass(frozen=True)
class RunContext:
    """A RUN as a worker sees it: the experiment with its ingested images, ready to simulate."""

    store: RunStore
    experiment: Experiment
    forward: ForwardModel
    settings: Mapping

    def at_stage(self, stage: Stage | None) -> RunContext:
        """The same with the images as a stage of the schedule sees them."""
        return self if stage is None else replace(self, experiment=seen_in(self.experiment, stage))

    @property
    def names(self) -> tuple[str, ...]:
        """Every free degree of freedom."""
        return self.experiment.parameters.free

    @property
    def moving(self) -> tuple[str, ...]:
        """Those that change the simulation."""
        return tuple(name for name in self.names if self.forward.moves(name))

    @property
    def external(self) -> bool:
        """Whether a program that is not ours simulates."""
        return self.experiment.solver is not None

    @property
    def weights(self) -> Weights:
        w = self.settings["weights"]
        return Weights(w["image"], w["image_noise"], np.array(w["channels"], float),
                       np.array(w["channel_noise"], float), tuple(w["cameras"]), tuple(w["camera_noise"]))


def open_run(run: str) -> RunContext:
    """The context of a RUN; kept in the worker until its description changes."""
    try:
        content = (Path(run) / DESCRIPTION).read_bytes()
    except (FileNotFoundError, NotADirectoryError):
        raise InputError("there is no run", file=run, expected=f"a RUN folder with {DESCRIPTION}", found="none",
                         remedy="name a folder that idic identify wrote") from None
    return _open_run(str(run), content)


@lru_cache(maxsize=8)  # several experiments may be at work in turn
def _open_run(run: str, content: bytes) -> RunContext:
    settings = load_checkpoint(Path(run) / DESCRIPTION, DESCRIPTION_SCHEMA)
    store = RunStore(run)
    experiment = load_experiment(settings["experiment"], settings["overrides"])
    if experiment.identity != settings["identity"]:
        raise InputError("the experiment has changed since this run began", file=settings["experiment"],
                         expected=f"identity {settings['identity'][:16]}", found=f"identity {experiment.identity[:16]}",
                         remedy="restore its files, or identify it again into a new RUN")
    experiment = with_stored_noise(with_stored_images(store, experiment), settings)
    experiment = replace(experiment, excluded=tuple(settings["excluded"]))
    experiment = with_boundary_start(experiment, _stored_start(store, settings))
    return RunContext(store, experiment, build_forward(experiment), settings)


def _stored_start(store: RunStore, settings: Mapping) -> BoundaryStart:
    """Starting values and modes of virtual boundaries as `prepare` found them."""
    stored = settings.get("boundary")
    if not stored:
        return BoundaryStart()
    read = lambda name: read_array(store.group("prepared"), name)  # noqa: E731
    return BoundaryStart({name: from_hex(value) for name, value in stored["values"].items()},
                         {name: (read(f"{name}.shapes"), read(f"{name}.courses")) for name in stored["modes"]},
                         tuple(stored["notes"]))


# jobs ---------------------------------------------------------------------------------------------
@dataclass(frozen=True)
class SimulationJob:
    """One simulation. `names` are differentiated directly; `values` in internal units."""

    run: str
    evaluation: int
    label: str  # "base" or the perturbed parameter
    values: Mapping[str, float]
    names: tuple[str, ...] = ()
    influence: bool = True
    steps: tuple[float, ...] | None = None
    shifted: int | None = None  # the frame-local unknown that is shifted (external solver)
    near: tuple[int, Mapping[str, float]] | None = None  # an evaluated point to begin with, and its values


@dataclass(frozen=True)
class SimulationReport:
    """How a simulation went; `failed` carries the reason, empty where it arrived."""

    label: str
    failed: str
    steps: tuple[float, ...]
    seconds: float


@dataclass(frozen=True)
class CorrelationJob:
    """The frames [first, last) of an evaluated point."""

    run: str
    evaluation: int
    first: int
    last: int
    values: Mapping[str, float]
    perturbations: Mapping[str, float]  # parameter -> change of its value; empty with direct differentiation
    weights: Weights | None = None  # None: those of the run
    stage: Stage | None = None  # of the schedule, where it sees blurred images or fewer of them


def simulation_ident(job: SimulationJob) -> dict:
    """What the result of a simulation depends on."""
    return {"label": job.label, "values": {name: to_hex(value) for name, value in sorted(job.values.items())},
            "names": list(job.names), "influence": job.influence,
            "steps": None if job.steps is None else [to_hex(t) for t in job.steps],
            "near": None if job.near is None else job.near[0]}


def simulate(job: SimulationJob) -> SimulationReport:
    """Run one simulation into ``evaluations/NNN/LABEL``; a finished one of exactly this job is kept, and one of the
    same values at the accepted point (another stage or estimator looks at it again) is repeated from its files."""
    context = open_run(job.run)
    name, ident = group_name(job.evaluation, job.label), simulation_ident(job)
    done = context.store.finished(name, ident) or _repeated(context.store, job, ident)
    if done is not None:
        return SimulationReport(job.label, "", tuple(read_array(done, "steps")), 0.0)
    local = read_array(context.store.group(group_name(job.evaluation, "start")), "local")
    parameters = context.experiment.parameters.with_values(job.values)
    began = time.perf_counter()
    reason = ""
    for attempt in _attempts(context, job):
        try:
            with context.store.building(name, ident) as folder:
                steps = _write_frames(context, attempt, parameters, local, folder)
                write_array(folder, "steps", steps)
            return SimulationReport(job.label, "", tuple(steps), time.perf_counter() - began)
        except NotConverged as problem:
            reason = str(problem)
    return SimulationReport(job.label, reason, (), time.perf_counter() - began)


def _repeated(store: RunStore, job: SimulationJob, ident: Mapping) -> Path | None:
    """The accepted point's simulation under the name of this job, where it was made of the same values."""
    if job.near is None:
        return None
    source, name = (group_name(number, job.label) for number in (job.near[0], job.evaluation))
    starts = [group_name(number, "start") for number in (job.near[0], job.evaluation)]
    return repeated(store, source, name, ident, starts, job.steps)


def _attempts(context: RunContext, job: SimulationJob) -> list[SimulationJob]:
    """The job with each list of increments to try; perturbed runs follow the list of theirs as long as they can."""
    if context.external:
        return [job]  # its increments are its own business
    if job.label != BASE:
        return [job] if job.steps is None else [job, replace(job, steps=None)]
    experiment, forward = context.experiment, context.forward
    times = experiment.times[experiment.reference:]
    lists = increments_to_try(forward.model, times, experiment.options.substeps, job.steps)
    return [replace(job, steps=steps) for steps in lists]


def _write_frames(context: RunContext, job: SimulationJob, parameters: ParameterSet, local: np.ndarray,
                  folder: Path) -> np.ndarray:
    """March and store frame by frame; memory does not grow with the number of frames."""
    steps = None if job.steps is None else np.array(job.steps)
    writers, state = None, None
    influence = job.influence and context.forward.drives.n_local > 0 and not context.external
    forward = context.forward
    if context.external:
        forward = replace(forward, scratch=context.store.run / SCRATCH, label=f"it{job.evaluation:03d}-{job.label}")
        local = local if job.shifted is None else forward.shifted(local, job.shifted)
    warm = {} if context.external else {"warm_start": _warm_start(context, job)}
    for state in forward.march(parameters, job.names, local, steps, influence, **warm):
        fields = {"u": state.u, "channels": state.channels}
        if job.names:
            fields |= {"du": state.du, "dchannels": state.dchannels}
        if influence:
            fields |= {"local_du": state.local_du, "local_dchannels": state.local_dchannels}
        if writers is None:
            n, largest = len(context.forward.frames), max(8 * np.size(value) for value in fields.values())
            size = stored_frames(context.experiment.n_frames, largest)
            writers = {key: _Writer(folder, key, n, np.shape(value), size) for key, value in fields.items()}
        for key, value in fields.items():
            writers[key].append(value)
    for writer in writers.values():
        writer.flush()
    return np.array(state.steps.times, float)


def _warm_start(context: RunContext, job: SimulationJob) -> Iterator[np.ndarray] | None:
    """The last accepted point's simulation of the same label, carried on to the values of this job."""
    if job.near is None:
        return None
    number, values = job.near
    folder = context.store.finished(group_name(number, job.label))
    changes = np.array([job.values[name] - values[name] for name in job.names])
    return None if folder is None else first_order_prediction(folder, changes)


class _Writer:
    """One streamed per-frame array."""

    def __init__(self, folder, name, n_frames, shape, frames_per_chunk):
        self._array = FrameArrays.create(folder, name, n_frames, shape, frames_per_chunk)
        self._manager = self._array.writer()
        self._writer = self._manager.__enter__()

    def append(self, record):
        self._writer.append(record)

    def flush(self):
        self._manager.__exit__(None, None, None)


def correlate(job: CorrelationJob) -> CorrelationSystem | None:
    """The summed system of a chunk of frames; None where none of them is correlated."""
    context = open_run(job.run).at_stage(job.stage)
    parameters = context.experiment.parameters.with_values(job.values)
    shared = correlation_context(context, parameters, job.weights)
    local = read_array(context.store.group(group_name(job.evaluation, "start")), "local")
    wanted = set(correlated_frames(context.experiment, range(job.first, job.last)))
    systems = (frame_system(shared, response, local[response.frame])
               for response in read_responses(context, job) if response.frame in wanted)
    first = next(systems, None)
    return None if first is None else reduce_systems(chain((first,), systems))


def correlation_context(context: RunContext, parameters: ParameterSet,
                        weights: Weights | None = None) -> CorrelationContext:
    """What all frames share at these parameters; a reference image is attached anew where camera or mesh moved."""
    experiment = context.experiment.at_geometry(parameters)
    shape = tuple(parameters[name].value for name in context.forward.morphs)

    def attach(view: Experiment, camera: Camera) -> Reference:
        key = (str(context.store.run), experiment.identity, shape, camera.matrix.tobytes(), camera.origin_px.tobytes(),
               camera.shift_px.tobytes(), camera.tilt.tobytes(), camera.k1, camera.centre_px.tobytes(),
               view.options.lowpass_px)
        place = (key[0], view.camera_name)
        kept, reference = _references.get(place, (None, None))
        if kept != key:
            for other in [other for other in list(_references) if _family(other[0]) != _family(place[0])]:
                _references.pop(other, None)  # threads of one worker share them
            reference = _with_motion(context, view, build_reference(view, camera))
            _references[place] = (key, reference)
        return reference

    camera = camera_at(experiment, parameters)
    return with_all_cameras(CorrelationContext(
        experiment=experiment, parameters=parameters, names=context.names, moving=context.moving, camera=camera,
        reference=attach(experiment, camera), weights=weights or context.weights,
        local_precision=context.forward.drives.local_precision,
        local_scatter=context.forward.drives.local_scatter), attach)


def _with_motion(context: RunContext, view: Experiment, image: Reference) -> Reference:
    """What simulations are compared with: the images, or of two steps the motion that the first has left."""
    if not is_two_step(context.experiment):
        return image
    number = [own.camera_name for own in context.experiment.views].index(view.camera_name)
    folder = context.store.group(group_of(context.experiment, number, "dic"))
    return measured_reference(view, image, read_array(folder, "u_px"))


def _family(run: str) -> Path:
    """What is at work at the same time: the experiments of a joint run, or a run alone."""
    folder = Path(run).parent
    return folder if folder.name == EXPERIMENTS else Path(run)


_references: dict = {}  # the attached reference image of the last mesh, per run and camera at work in this process


def read_responses(context: RunContext, job: CorrelationJob) -> Iterator[FrameResponse]:
    """The stored motion of the frames of a job, sensitivities by whichever way they were computed; chunk by chunk."""
    start = context.experiment.reference
    base = context.store.group(group_name(job.evaluation, BASE))
    first, last = max(job.first, start) - start, max(job.last, start) - start
    n_nodes, dim = FrameArrays.open(base, "u").shape
    record = 8 * n_nodes * dim * max(1, len(context.moving), context.forward.drives.n_local)
    step = stored_frames(context.experiment.n_frames, record)
    while first < last:
        following = min(last, step * (first // step + 1))
        yield from _read_block(context, job, base, (first, following))
        first = following


def _read_block(context: RunContext, job: CorrelationJob, base: Path, span: tuple[int, int]) -> Iterator[FrameResponse]:
    """The frames of a span, counted from the reference."""
    u, channels = _read(base, "u", span), _read(base, "channels", span)
    n, n_nodes, dim = u.shape
    if job.perturbations or not context.moving:
        du = np.zeros((n, n_nodes, dim, len(context.moving)))
        dchannels = np.zeros((n, channels.shape[1], len(context.moving)))
        for i, name in enumerate(context.moving):
            group = context.store.group(group_name(job.evaluation, name))
            du[..., i] = (_read(group, "u", span) - u) / job.perturbations[name]
            dchannels[..., i] = (_read(group, "channels", span) - channels) / job.perturbations[name]
    else:
        du, dchannels = _read(base, "du", span), _read(base, "dchannels", span)
    m = context.forward.drives.n_local
    if context.external and m:
        local_du, local_dchannels = _shifted_quotients(context, job.evaluation, span, u, channels)
    else:
        local_du = _read(base, "local_du", span) if m else np.zeros((n, n_nodes, dim, 0))
        local_dchannels = _read(base, "local_dchannels", span) if m else np.zeros((n, channels.shape[1], 0))
    for i in range(n):
        frame = context.experiment.reference + span[0] + i
        yield FrameResponse(frame, u[i], channels[i], du[i], dchannels[i], local_du[i], local_dchannels[i])


def _shifted_quotients(context: RunContext, evaluation: int, span, u, channels) -> tuple[np.ndarray, np.ndarray]:
    """Influence of the frame-local unknowns, by the runs with each shifted  # (n, n_nodes, dim, m), (n, c, m)"""
    du, dchannels = [], []
    for i, change in enumerate(context.forward.local_changes()):
        group = context.store.group(group_name(evaluation, local_label(i)))
        du.append((_read(group, "u", span) - u) / change)
        dchannels.append((_read(group, "channels", span) - channels) / change)
    return np.stack(du, axis=-1), np.stack(dchannels, axis=-1)


def _read(group: Path, name: str, span: tuple[int, int]) -> np.ndarray:
    return FrameArrays.open(group, name).read(*span)
