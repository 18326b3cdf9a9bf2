"""The evaluated points of one experiment of a RUN: simulated and correlated by the workers, kept in Zarr."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from idic.correlation import CorrelationSystem, reduce_systems
from idic.identification import (
    DiscrepancySystem, Evaluation, LoopState, chunk_frames, closed_evaluation, next_local, paper_weights,
    perturbations,
)
from idic.model import Experiment, Stage
from idic.run.prepared.context import correlation_context, release_voxels
from idic.run.prepared.prepare import write_description
from idic.run.prepared.session import Session, Timing
from idic.run.prepared.tasks import CorrelationJob, SimulationJob, SimulationReport, correlate, simulate
from idic.run.spool import Spool, open_spool
from idic.run.store.arrays import read_array, write_array
from idic.run.store.discrepancy_store import load_discrepancy
from idic.run.store.layout import BASE, group_name, local_label
from idic.run.store.system_store import load_evaluation, save_evaluation


@dataclass(frozen=True)
class PartPoints:
    """The points of one experiment of a RUN, in its folder."""

    session: Session
    timing: Timing

    @property
    def experiment(self) -> Experiment:
        return self.session.experiment

    @property
    def image_noise(self) -> float:
        """GV, after the low-pass."""
        return self.session.context.weights.image_noise

    def write_first_start(self) -> None:
        """Store the frame-local unknowns of the first trial, as prepared."""
        store, context = self.session.context.store, self.session.context
        prepared = store.finished("prepared")
        local = np.zeros((context.experiment.model.n_frames, context.forward.drives.n_local))
        if prepared is not None and (prepared / "local").exists():
            local = read_array(prepared, "local")
        self._write_start(0, local)

    def correlate(self, trial: LoopState, stage: Stage) -> Evaluation:
        """The system of a simulated trial: chunks of frames as tasks, added in frame order.

        stage : as which the images are seen
        """
        session, began = self.session, time.perf_counter()
        if session.context.settings["weights"]["kind"] == "paper (not yet scaled)":
            _scale_paper_weights(session, trial)
        context = session.context.at_stage(stage)
        weights = context.weights.as_generalised() if trial.generalised else context.weights
        shared = correlation_context(context, context.experiment.model.parameters.with_values(trial.trial.values),
                                     weights)
        release_voxels(context)  # the workers make the passes
        increments = len(read_array(context.store.group(group_name(trial.evaluations, BASE)), "steps"))
        with open_spool(context.store.run) as spool:
            system = sum_system(session, trial, weights, stage, spool)
            evaluation = closed_evaluation(trial.evaluations, shared, context.forward, system, increments)
        self.timing.image_s += time.perf_counter() - began
        return evaluation

    def accepted(self, state: LoopState) -> Evaluation:
        """The last accepted point of a state that has one."""
        context = self.session.context
        return load_evaluation(context.store, state.accepted.number, context.names)

    def discrepancy(self, state: LoopState) -> DiscrepancySystem | str:
        """The stored normal equations with the discrepancy of the model, or why there are none."""
        if state.accepted is None:
            return "no simulation converged"
        return load_discrepancy(self.session.context.store, state.accepted.number)

    def write_points(self, state: LoopState, points: Sequence[Evaluation], previous: Evaluation | None) -> None:
        """Store evaluated points, and where the next trials start; previous : the point accepted before them."""
        context = self.session.context
        for point in points:
            save_evaluation(context.store, point)
        if not state.running:
            return
        accepted = next((point for point in points if state.has_accepted(point.number)), previous)
        local = read_array(context.store.group(group_name(accepted.number, "start")), "local")
        for trial in state.trial_states:
            self._write_start(trial.evaluations, next_local(trial, accepted, local, context.names))

    def remove_points(self, state: LoopState) -> None:
        """Delete the points that the checkpointed state no longer needs: all but the first, the accepted and the open
        point."""
        for number in range(state.evaluations):
            if number != 0 and not state.has_accepted(number):
                self.session.context.store.remove(f"evaluations/{number:03d}")

    def _write_start(self, evaluation: int, local: np.ndarray) -> None:
        with self.session.context.store.building(group_name(evaluation, "start")) as folder:
            write_array(folder, "local", local)


def simulate_trials(trials: Sequence[tuple[Session, LoopState]], timing: Timing) -> list[str]:
    """All simulations of several trials side by side; returns why each failed, or "".

    trials : of one experiment or of several, each a state that tries one point (`LoopState.trial_states`)
    """
    began, session = time.perf_counter(), trials[0][0]
    jobs = [_simulations(part, state) for part, state in trials]
    threads = session.runner.threads_for(sum(map(len, jobs)))
    jobs = [[replace(job, threads=threads) for job in point] for point in jobs]
    reports = _reports(session, "simulate", jobs)
    repetitions = [_with_other_increments(point, first) for point, first in zip(jobs, reports, strict=True)]
    if any(repetitions):
        repeats = _reports(session, "simulate-again", repetitions)
        reports = [[*first, *second] for first, second in zip(reports, repeats, strict=True)]
    timing.forward_s += time.perf_counter() - began
    timing.forward_runs += sum(map(len, jobs))
    return [next((f"{report.label}: {report.failed}" for report in point if report.failed), "") for point in reports]


def _reports(session: Session, name: str, jobs: Sequence[Sequence[SimulationJob]]) -> list[list[SimulationReport]]:
    """The reports of the simulations of every point, all made side by side."""
    reports = iter(list(session.stream(name, simulate, [job for point in jobs for job in point])))
    return [[next(reports) for _ in point] for point in jobs]


def _simulations(session: Session, state: LoopState) -> list[SimulationJob]:
    """The simulation of a trial, and those that its sensitivities need."""
    context = session.context
    jobs = [SimulationJob(session.run, state.evaluations, BASE, state.trial.values,
                          context.moving if session.sensitivity == "direct" else (),
                          steps=_frozen_steps(session, state), increments=state.increments.per_frame,
                          warm_start=None if state.accepted is None
                          else (state.accepted.number, state.accepted.values))]
    for name, change in _changes(session, state).items():
        values = dict(state.trial.values) | {name: state.trial.values[name] + change}
        jobs.append(replace(jobs[0], label=name, values=values, names=(), influence=False))
    shifted = range(context.forward.drives.n_local if context.external else 0)
    return [*jobs, *(replace(jobs[0], label=local_label(i), influence=False, shifted=i) for i in shifted)]


def _with_other_increments(jobs: Sequence[SimulationJob], reports: Sequence) -> list[SimulationJob]:
    """Perturbed runs whose increments differ from those of the base, which would put time error into the difference."""
    base = reports[0]
    if base.failed:
        return []
    return [replace(job, steps=base.steps) for job, report in zip(jobs[1:], reports[1:], strict=True)
            if not report.failed and report.steps != base.steps]


def _changes(session: Session, state: LoopState) -> dict[str, float]:
    return perturbations(session.experiment, session.sensitivity, state.trial.values, session.context.moving)


def _frozen_steps(session: Session, state: LoopState) -> tuple[float, ...] | None:
    """The increments of the accepted point: every later simulation follows them (further cuts are still allowed)."""
    if state.accepted is None or state.trial.new_increments:
        return None
    group = session.context.store.group(group_name(state.accepted.number, BASE))
    return tuple(float(t) for t in read_array(group, "steps"))


def sum_system(session: Session, state: LoopState, weights=None, stage: Stage | None = None,
               spool: Spool | None = None) -> CorrelationSystem:
    """M, b and the functional of the stored trial; spool : takes the large arrays of generalised least squares."""
    n, size = session.experiment.model.n_frames, chunk_frames(session.experiment.model.n_frames)
    jobs = [CorrelationJob(session.run, state.evaluations, first, min(first + size, n), state.trial.values,
                           _changes(session, state), weights, stage) for first in range(0, n, size)]
    parts = session.stream("correlate", correlate, jobs)
    sums = (part if spool is None else spool.kept(part) for part in parts if part is not None)
    return reduce_systems(sums)  # one at a time: they hold sums over all nodes


def _scale_paper_weights(session: Session, state: LoopState) -> None:
    """Scale the paper's weights at the starting point and write them to the description of the run."""
    context = session.context
    slopes = np.array([context.experiment.model.parameters[name].slope() for name in context.names])
    scaled = paper_weights(context.weights, session.experiment.options.alpha, slopes,
                           lambda weights: sum_system(session, state, weights).M)
    weights = dict(context.settings["weights"]) | {
        "kind": "paper", "cameras": list(scaled.cameras), "channels": scaled.channels.tolist()}
    write_description(session.run, dict(context.settings) | {"weights": weights})
