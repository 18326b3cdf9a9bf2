"""The tasks of a worker: one simulation, or one chunk of frames. Paths in, small records out.

A job is plain data; the function finds everything else in the RUN folder, and a repeated job does no harm.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from idic.correlation import CorrelationSystem, FrameResponse, Weights
from idic.errors import NotConverged
from idic.fe import solver_threads
from idic.identification import HALF_RATE, chunk_system, point_discrepancy
from idic.model import Stage, tried_increments
from idic.parameters import ParameterSet
from idic.path_names import path_name
from idic.run.prepared.context import RunContext, correlation_context, open_run, release_voxels
from idic.run.prepared.warm_start import first_order_prediction, repeated, write_without_time_error
from idic.run.store.arrays import FrameArrays, read_array, write_array
from idic.run.store.checkpoint import to_hex
from idic.run.store.discrepancy_store import save_discrepancy
from idic.run.store.layout import BASE, SCRATCH, group_name, local_label, stored_frames
from idic.run.store.repeated_arrays import RepeatedReader, RepeatedWriter
from idic.run.store.run_store import RunStore
from idic.run.store.system_store import load_evaluation


LOCAL = "local_du"  # influence of the frame-local unknowns: the largest record of a simulation


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
    warm_start: tuple[int, Mapping[str, float]] | None = None  # accepted point for the warm start, and its values
    increments: int | None = None  # per frame, extrapolated in time; None: those of the options
    threads: int = 1  # of factorisations; the result does not depend on it


@dataclass(frozen=True)
class SimulationReport:
    """The end of a simulation; `failed` carries the reason, empty where it converged."""

    label: str
    failed: str
    steps: tuple[float, ...]
    seconds: float


@dataclass(frozen=True)
class CorrelationJob:
    """The frames [first, stop) of an evaluated point."""

    run: str
    evaluation: int
    first: int
    stop: int
    values: Mapping[str, float]
    perturbations: Mapping[str, float]  # parameter -> change of its value; empty with direct differentiation
    weights: Weights | None = None  # None: those of the run
    stage: Stage | None = None  # of the schedule, where it sees blurred images or fewer of them
    increments: int | None = None  # as of the simulation


def simulation_ident(job: SimulationJob) -> dict:
    """The identity of a simulation: everything that its result depends on."""
    chosen = {} if job.increments is None else {"increments": job.increments}
    return chosen | {"label": job.label, "values": {name: to_hex(value) for name, value in sorted(job.values.items())},
            "names": list(job.names), "influence": job.influence,
            "steps": None if job.steps is None else [to_hex(t) for t in job.steps],
            "near": None if job.warm_start is None else job.warm_start[0]}


def simulate(job: SimulationJob) -> SimulationReport:
    """Run one simulation into ``evaluations/NNN/LABEL``.

    A finished one of exactly this job is kept. One of the same values at the accepted point (re-evaluated by another
    stage or estimator) is repeated from its files.
    """
    context = open_run(job.run)
    name, ident = group_name(job.evaluation, job.label), simulation_ident(job)
    finished = context.store.finished(name, ident) or _repeated(context.store, job, ident)
    if finished is not None:
        return SimulationReport(job.label, "", tuple(read_array(finished, "steps")), 0.0)
    release_voxels(context)
    local = read_array(context.store.group(group_name(job.evaluation, "start")), "local")
    parameters = context.experiment.model.parameters.with_values(job.values)
    began = time.perf_counter()
    reason = ""
    for attempt in _attempts(context, job):
        try:
            with solver_threads(job.threads), context.store.building(name, ident, once=True) as folder:
                if attempt.increments == HALF_RATE:
                    simulation = context.store.finished(group_name(attempt.warm_start[0], attempt.label))
                    steps = write_without_time_error(context.forward, simulation, parameters, local, folder)
                else:
                    steps = _write_frames(context, attempt, parameters, local, folder)
                    write_array(folder, "steps", steps)
            return SimulationReport(job.label, "", tuple(steps), time.perf_counter() - began)
        except NotConverged as problem:
            reason = str(problem)
    return SimulationReport(job.label, reason, (), time.perf_counter() - began)


def _repeated(store: RunStore, job: SimulationJob, ident: Mapping) -> Path | None:
    """The simulation of the accepted point under the name of this job, where the values are the same."""
    if job.warm_start is None:
        return None
    source, name = (group_name(number, job.label) for number in (job.warm_start[0], job.evaluation))
    starts = [group_name(number, "start") for number in (job.warm_start[0], job.evaluation)]
    return repeated(store, source, name, ident, starts, job.steps)


def _attempts(context: RunContext, job: SimulationJob) -> list[SimulationJob]:
    """The job with each list of increments to try; perturbed runs follow the list of theirs as long as they can."""
    if context.external:
        return [job]  # the external program chooses its increments
    if job.label != BASE:
        return [job] if job.steps is None else [job, replace(job, steps=None)]
    experiment, forward = context.experiment, context.forward
    times = experiment.model.times[experiment.model.reference:]
    lists = tried_increments(forward, times, job.increments, job.steps)
    return [replace(job, steps=steps) for steps in lists]


def _write_frames(context: RunContext, job: SimulationJob, parameters: ParameterSet, local: np.ndarray,
                  folder: Path) -> np.ndarray:
    """March and store frame by frame; memory does not grow with the number of frames."""
    steps = None if job.steps is None else np.array(job.steps)
    writers: dict[str, _Writer | RepeatedWriter] | None = None
    state = None
    influence = job.influence and context.forward.drives.n_local > 0 and not context.external
    forward = context.forward
    if context.external:
        forward = replace(forward, scratch=context.store.run / SCRATCH,
                          label=path_name(f"it{job.evaluation:03d}-{job.label}"))  # type: ignore[call-arg]
        local = local if job.shifted is None else forward.shifted(local, job.shifted)  # type: ignore[attr-defined]
    for state in forward.march(parameters, job.names, local, steps, influence, _warm_start(context, job),
                               increments=job.increments):
        fields = {"u": state.seen_u, "channels": state.channels}
        if job.names:
            fields |= {"du": state.seen_du, "dchannels": state.dchannels}
        if influence:
            fields |= {LOCAL: state.seen_local_du, "local_dchannels": state.local_dchannels}
        if writers is None:
            n = len(context.forward.frames)
            sizes = {key: 8 * np.size(value) for key, value in fields.items()}
            size = stored_frames(context.experiment.model.n_frames, max(sizes[key] for key in sizes if key != LOCAL))
            writers = {key: _Writer(folder, key, n, np.shape(value), size) for key, value in fields.items()
                       if key != LOCAL}
            if influence:
                writers[LOCAL] = RepeatedWriter(folder, LOCAL, n, np.shape(fields[LOCAL]),
                                                stored_frames(context.experiment.model.n_frames, sizes[LOCAL]))
        for key, value in fields.items():
            writers[key].append(value)
    for writer in writers.values():
        writer.flush()
    return np.array(state.steps.times, float)


def _warm_start(context: RunContext, job: SimulationJob) -> Iterator[np.ndarray] | None:
    """The simulation of the last accepted point of the same label, predicted to first order at the values of this
    job."""
    if job.warm_start is None:
        return None
    number, values = job.warm_start
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
    parameters = context.experiment.model.parameters.with_values(job.values)
    shared = correlation_context(context, parameters, job.weights)
    local = read_array(context.store.group(group_name(job.evaluation, "start")), "local")
    return chunk_system(shared, read_responses(context, job), local)


def sum_discrepancy(job: CorrelationJob) -> None:
    """Store the normal equations of the point with what its model may leave unexplained, and the error of a coarse
    mesh.

    The job names all frames; its weights are those of generalised least squares or None.
    """
    context = open_run(job.run).at_stage(job.stage)
    parameters = context.experiment.model.parameters.with_values(job.values)
    local = read_array(context.store.group(group_name(job.evaluation, "start")), "local")
    system = point_discrepancy(
        correlation_context(context, parameters, job.weights), context.forward, local,
        read_motion(context, job.evaluation), read_responses(context, job), context.experiment,
        load_evaluation(context.store, job.evaluation, context.names), job.increments)
    save_discrepancy(context.store, job.evaluation, system)


def read_motion(context: RunContext, evaluation: int) -> Iterator[np.ndarray]:
    """The stored displacements of every frame after the reference  # (n_nodes, dim) mm each"""
    stored = FrameArrays.open(context.store.group(group_name(evaluation, BASE)), "u")
    n, step = context.experiment.model.n_frames - context.experiment.model.reference, 16
    for first in range(1, n, step):
        yield from stored.read(first, min(first + step, n))


def read_responses(context: RunContext, job: CorrelationJob) -> Iterator[FrameResponse]:
    """The stored motion of the frames of a job, with sensitivities, direct or perturbed; chunk by chunk."""
    start = context.experiment.model.reference
    base = context.store.group(group_name(job.evaluation, BASE))
    first, stop = max(job.first, start) - start, max(job.stop, start) - start
    n_nodes, dim = FrameArrays.open(base, "u").shape
    step = stored_frames(context.experiment.model.n_frames, 8 * n_nodes * dim * max(1, len(context.moving)))
    inside = context.forward.drives.n_local > 0 and not context.external
    influence = RepeatedReader(base, LOCAL) if inside else None
    while first < stop:
        following = min(stop, step * (first // step + 1))
        yield from _read_block(context, job, base, (first, following), influence)
        first = following


def _read_block(context: RunContext, job: CorrelationJob, base: Path, span: tuple[int, int],
                influence: RepeatedReader | None) -> Iterator[FrameResponse]:
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
    local_du, local_dchannels = np.zeros((n, n_nodes, dim, 0)), np.zeros((n, channels.shape[1], 0))
    if context.external and m:
        local_du, local_dchannels = _shifted_quotients(context, job.evaluation, span, u, channels)
    elif m:
        local_dchannels = _read(base, "local_dchannels", span)
    for i in range(n):
        frame = context.experiment.model.reference + span[0] + i
        frame_influence = local_du[i] if influence is None else influence.frame(span[0] + i)
        yield FrameResponse(frame, u[i], channels[i], du[i], dchannels[i], frame_influence, local_dchannels[i])


def _shifted_quotients(context: RunContext, evaluation: int, span, u, channels) -> tuple[np.ndarray, np.ndarray]:
    """Influence of the frame-local unknowns, from one run with each of them shifted  # (n, n_nodes, dim, m), (n, c,
    m)"""
    du, dchannels = [], []
    for i, change in enumerate(context.forward.local_changes()):  # type: ignore[attr-defined]
        group = context.store.group(group_name(evaluation, local_label(i)))
        du.append((_read(group, "u", span) - u) / change)
        dchannels.append((_read(group, "channels", span) - channels) / change)
    return np.stack(du, axis=-1), np.stack(dchannels, axis=-1)


def _read(group: Path, name: str, span: tuple[int, int]) -> np.ndarray:
    return FrameArrays.open(group, name).read(*span)
