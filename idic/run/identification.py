"""The steps of an identification on a RUN folder; the Prefect flow and the plain loop below call the same ones.

    prepare → [ simulate → correlate → update ] until the state says so → finish

What decides the next step is in the state and in the RUN folder, never in this process: a run that was killed goes on
where it stood and ends with the same bits.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

import numpy as np

from idic.correlation.shared_noise import closed_system, generalised_weights
from idic.correlation.system import CorrelationSystem, reduce_systems
from idic.errors import InputError
from idic.identify.loop import advance, trial_states, start
from idic.identify.step.state import Evaluation, LoopState
from idic.identify.step.parallel_steps import ParallelTrial
from idic.identify.step.stages import resolve_stages
from idic.model.experiment import Experiment, Stage
from idic.run.prepare import write_description
from idic.run.tasks import CorrelationJob, RunContext, SimulationJob, correlate, correlation_context, open_run, simulate
from idic.store.layout import BASE, chunk_frames, group_name, local_label
from idic.store.arrays import read_array, write_array
from idic.store.checkpoint import from_hex, load_checkpoint, save_checkpoint, to_hex
from idic.store.system_store import load_evaluation, save_evaluation
from idic.workers.processor_time import cpu_seconds
from idic.workers.runner import TaskRunner

STATE_FILE = "state.json"
STATE_SCHEMA = "idic.state/1"
DIRECT_SHARE = 0.12  # extra cost of one directly differentiated parameter in forward runs (tests/bench measures it)


@dataclass(frozen=True)
class Session:
    """A prepared RUN, where its tasks are run, and how sensitivities are computed ("direct" or "perturbed").

    progress : called as progress(what, done, total) while tasks come back; say : with a line for the log.
    """

    run: str
    runner: TaskRunner
    sensitivity: str
    progress: Callable[[str, int, int], None] = field(default=lambda what, done, total: None)
    say: Callable[[str], None] = field(default=lambda text: None)

    @property
    def context(self) -> RunContext:
        return open_run(self.run)

    @property
    def experiment(self) -> Experiment:
        return self.context.experiment


@dataclass
class Timing:
    """Seconds spent, and simulations run, since this process took the run up; the processor time until then."""

    forward_s: float = 0.0
    image_s: float = 0.0
    forward_runs: int = 0
    cpu_before_s: float = field(default_factory=cpu_seconds)


def choose_sensitivity(wanted: str, n_moving: int, workers: int, n_shape: int = 0) -> str:
    """"auto" by cost: direct differentiation takes 1 + 0.12 n forward runs one after the other, perturbed runs take
    n + 1 that fill the workers. `n_shape` of the n move nodes of the mesh: they take a run each either way."""
    if wanted != "auto":
        return wanted
    perturbed = math.ceil((n_moving + 1) / max(workers, 1))
    direct = 1.0 + n_shape + DIRECT_SHARE * (n_moving - n_shape)
    return "direct" if direct <= perturbed else "perturbed"


def checked_sensitivity(wanted: str, experiment: Experiment) -> str:
    """The way that is wanted; with an external solver there are perturbed runs only.

    Raises
    ------
    InputError
        "direct" is wanted of an external solver.
    """
    if experiment.solver is None:
        return wanted
    if wanted == "direct":
        raise InputError("an external solver gives no derivatives", file=experiment.solver.experiment_file,
                         key="--sensitivity", expected="perturbed (or auto)", found="direct",
                         remedy="leave --sensitivity out: one perturbed run per parameter is made")
    return "perturbed"


# state --------------------------------------------------------------------------------------------
def first_state(session: Session, values: Mapping[str, float] | None = None) -> LoopState:
    """The state at the start, with the frame-local unknowns as prepared; stored at once.

    values : where to begin instead of the experiment's start, found from far; internal units
    """
    store, context = session.context.store, session.context
    prepared = store.finished("prepared")
    local = np.zeros((context.experiment.n_frames, context.forward.drives.n_local))
    if prepared is not None and (prepared / "local").exists():
        local = read_array(prepared, "local")
    state = start(context.experiment, searched=values is not None)
    if values is not None:
        state = replace(state, trial=dict(values))
    _write_start(session, 0, local)
    save_state(session.run, state)
    return state


def save_state(run: str | Path, state: LoopState) -> None:
    """The checkpoint: replaced whole, floats to the last bit."""
    record = asdict(state)
    record["trial"] = {name: to_hex(value) for name, value in state.trial.items()}
    for name in ("accepted", "arrived"):
        record[name] = record[name] and {key: to_hex(value) for key, value in record[name].items()}
    record["history"] = [entry | {"values": {k: to_hex(v) for k,
                                             v in entry["values"].items()}} for entry in state.history]
    record["beside"] = [{"values": {name: to_hex(value) for name, value in other.values.items()},
                         "damping": to_hex(other.damping), "rung": other.rung} for other in state.beside]
    for name in ("damping", "phi", "reach"):
        record[name] = None if record[name] is None else to_hex(record[name])
    save_checkpoint(Path(run) / STATE_FILE, STATE_SCHEMA, record)


def load_state(session: Session) -> LoopState | None:
    """The checkpointed state of a session's run, None where it has not begun."""
    return stored_state(session.run)


def stored_state(run: str | Path) -> LoopState | None:
    """The checkpointed state in a RUN folder, None where there is none."""
    record = load_checkpoint(Path(run) / STATE_FILE, STATE_SCHEMA)
    if record is None:
        return None
    back = lambda values: {name: from_hex(value) for name, value in values.items()}  # noqa: E731
    record["trial"] = back(record["trial"])
    for name in ("accepted", "arrived"):  # there was no way back in runs of earlier versions
        record[name] = record.get(name) and back(record[name])
    record["history"] = tuple(entry | {"values": back(entry["values"])} for entry in record["history"])
    record |= {name: tuple(record.get(name, ())) for name in ("felt", "again")}
    record.pop("predicted", None)  # runs of earlier versions
    record["beside"] = tuple(ParallelTrial(back(other["values"]), from_hex(other["damping"]), other["rung"])
                             for other in record.get("beside", ()))
    for name in ("damping", "phi", "reach"):
        if record.get(name) is not None:  # there was no reach in runs of earlier versions
            record[name] = from_hex(record[name])
    return LoopState(**record)


def _write_start(session: Session, evaluation: int, local: np.ndarray) -> None:
    with session.context.store.building(group_name(evaluation, "start")) as folder:
        write_array(folder, "local", local)


# steps --------------------------------------------------------------------------------------------
def simulate_trials(trials: Sequence[tuple[Session, LoopState]], timing: Timing) -> list[str]:
    """All simulations of several trials side by side; returns why each failed, or "".

    trials : of one experiment or of several, each a state that tries one point (`trial_states`)
    """
    began = time.perf_counter()
    jobs = [_simulations(session, state) for session, state in trials]
    reports = iter(_run(trials[0][0], "simulate", simulate, [job for own in jobs for job in own]))
    reports = [[next(reports) for _ in own] for own in jobs]
    again = [_again(own, said) for own, said in zip(jobs, reports, strict=True)]
    if any(again):
        once_more = iter(_run(trials[0][0], "simulate-again", simulate, [job for own in again for job in own]))
        reports = [[*said, *(next(once_more) for _ in own)] for own, said in zip(again, reports, strict=True)]
    timing.forward_s += time.perf_counter() - began
    timing.forward_runs += sum(map(len, jobs))
    return [next((f"{report.label}: {report.failed}" for report in said if report.failed), "") for said in reports]


def _simulations(session: Session, state: LoopState) -> list[SimulationJob]:
    """The simulation of a trial, and those that its sensitivities need."""
    context = session.context
    jobs = [SimulationJob(session.run, state.evaluations, BASE, state.trial,
                          context.moving if session.sensitivity == "direct" else (),
                          steps=_frozen_steps(session, state),
                          near=None if state.accepted is None else (state.accepted_evaluation, state.accepted))]
    if session.sensitivity == "perturbed":
        for name, change in perturbations(session, state).items():
            values = dict(state.trial) | {name: state.trial[name] + change}
            jobs.append(replace(jobs[0], label=name, values=values, names=(), influence=False))
        jobs += [replace(jobs[0], label=local_label(i), influence=False, shifted=i)
                 for i in range(context.forward.drives.n_local if context.external else 0)]
    return jobs


def _again(jobs: Sequence[SimulationJob], reports: Sequence) -> list[SimulationJob]:
    """Perturbed runs whose increments differ, which would put time error into the difference: on those of the base."""
    base = reports[0]
    if base.failed:
        return []
    return [replace(job, steps=base.steps) for job, report in zip(jobs[1:], reports[1:], strict=True)
            if not report.failed and report.steps != base.steps]


def _frozen_steps(session: Session, state: LoopState) -> tuple[float, ...] | None:
    """The increments of the accepted point: every later simulation follows them (further cuts are still allowed)."""
    if state.accepted is None:
        return None
    group = session.context.store.group(group_name(state.accepted_evaluation, BASE))
    return tuple(float(t) for t in read_array(group, "steps"))


def perturbations(session: Session, state: LoopState) -> dict[str, float]:
    """Change of each moving parameter in a perturbed run (internal units); empty with direct differentiation."""
    if session.sensitivity == "direct":
        return {}
    epsilon = session.experiment.options.perturbation
    here = session.experiment.parameters.with_values(state.trial)
    return {name: here[name].perturbation(epsilon) for name in session.context.moving}


def correlate_point(session: Session, state: LoopState, timing: Timing, stage: Stage | None = None) -> Evaluation:
    """The system of the trial: chunks of frames as tasks, added in frame order.

    stage : as which the images are seen; None: the one of the state in the experiment's own schedule
    """
    began = time.perf_counter()
    if session.context.settings["weights"]["kind"] == "paper (not yet scaled)":
        _scale_paper_weights(session, state)
    stage = stage or resolve_stages(session.experiment)[state.stage]
    context = session.context.at_stage(stage)
    weights = generalised_weights(context.weights) if state.generalised else context.weights
    shared = correlation_context(context, context.experiment.parameters.with_values(state.trial), weights)
    system, gram = closed_system(shared, sum_system(session, state, weights, stage))
    timing.image_s += time.perf_counter() - began
    increments = len(read_array(context.store.group(group_name(state.evaluations, BASE)), "steps"))
    return Evaluation(state.evaluations, system, gram, increments=increments)


def sum_system(session: Session, state: LoopState, weights=None, stage: Stage | None = None) -> CorrelationSystem:
    """M, b and the functional of the stored trial."""
    n, size = session.experiment.n_frames, chunk_frames(session.experiment.n_frames)
    jobs = [CorrelationJob(session.run, state.evaluations, first, min(first + size, n), state.trial,
                           perturbations(session, state), weights, stage) for first in range(0, n, size)]
    parts = _stream(session, "correlate", correlate, jobs)
    return reduce_systems(part for part in parts if part is not None)  # one at a time: they hold sums over all nodes


def _scale_paper_weights(session: Session, state: LoopState) -> None:
    """The paper's weighting (Eqs 13-15): (1 - alpha)/|M_image| to alpha/|M_channel| at the starting point, kept.

    Several cameras share 1 - alpha, several channels share alpha, each term divided by its own |M|. Only those ratios
    are the paper's. The images keep the weight of their noise, so that priors, which count in standard
    deviations, keep theirs beside them.
    """
    context, alpha, given = session.context, session.experiment.options.alpha, session.context.weights
    slopes = np.array([context.experiment.parameters[name].slope() for name in context.names])
    n_cameras, n_channels = 1 + len(given.cameras), len(given.channels)

    def size(number: int) -> float:
        """|M| of one term alone: the main camera, the further ones, the channels."""
        alone = np.eye(n_cameras + n_channels)[number]
        weights = replace(given, image=alone[0], cameras=tuple(alone[1:n_cameras]), channels=alone[n_cameras:])
        return float(np.linalg.norm(slopes[:, None] * sum_system(session, state, weights).M * slopes))

    sizes = [size(number) for number in range(n_cameras + n_channels)]
    share = alpha / (1.0 - alpha) * n_cameras / max(n_channels, 1)  # of a channel beside that of a camera
    ratios = [sizes[0] / own if own else 0.0 for own in sizes]
    weights = dict(context.settings["weights"]) | {
        "kind": "paper", "cameras": [given.image * ratio for ratio in ratios[1:n_cameras]],
        "channels": [given.image * ratio * share for ratio in ratios[n_cameras:]]}
    write_description(session.run, dict(context.settings) | {"weights": weights})


def update(session: Session, state: LoopState, evaluations: Sequence[Evaluation]) -> LoopState:
    """Judge the evaluated trials, choose the next ones, store both; what is no longer needed is deleted."""
    context = session.context
    noise = context.weights.image_noise
    previous = None
    if state.accepted is not None:
        previous = load_evaluation(context.store, state.accepted_evaluation, context.names)
    first, *beside = evaluations
    following, _ = advance(state, context.experiment, first, previous, noise, beside)
    keep_points(session, following, evaluations, previous)
    save_state(session.run, following)
    remove_points(session, following)
    return following


def keep_points(session: Session, following: LoopState, evaluations: Sequence[Evaluation],
                previous: Evaluation | None) -> None:
    """Store evaluated points and where the next trials start."""
    for evaluation in evaluations:
        save_evaluation(session.context.store, evaluation)
    if following.running:
        numbers = [evaluation.number for evaluation in evaluations]
        accepted = following.accepted_evaluation
        point = evaluations[numbers.index(accepted)] if accepted in numbers else previous
        for trial in trial_states(following):
            _write_start(session, trial.evaluations, _next_local(session, trial, point))


def remove_points(session: Session, state: LoopState) -> None:
    """Delete what the checkpointed state no longer needs: all but the first, the accepted and the open point."""
    for number in range(state.evaluations):
        if number not in (0, state.accepted_evaluation):
            session.context.store.remove(f"evaluations/{number:03d}")


def _next_local(session: Session, state: LoopState, point: Evaluation) -> np.ndarray:
    """Frame-local unknowns of the next trial: their own step plus what the step of the others asks for."""
    folder = session.context.store.group(group_name(point.number, "start"))
    local = read_array(folder, "local").copy()
    change = np.array([state.trial[name] - state.accepted[name] for name in session.context.names])
    for record in point.system.frames:
        local[record.frame] += record.local_step + record.local_slope @ change
    return local


def _run(session: Session, what: str, function, jobs) -> list:
    return list(_stream(session, what, function, jobs))


def _stream(session: Session, what: str, function, jobs) -> Iterator:
    names = [f"{what}-it{job.evaluation:03d}-{job.label}" if isinstance(job, SimulationJob)
             else f"{what}-it{job.evaluation:03d}-frames{job.first}-{job.last - 1}" for job in jobs]
    return session.runner.stream(function, jobs, names, retries=1,
                                 progress=lambda done, total: session.progress(what, done, total))


# what is said of it ----------------------------------------------------------------------------------
def describe_evaluation(entry: dict) -> str:
    """One line for an entry of the history of an identification."""
    if entry.get("phi") is None:
        reason = entry.get("message") or "not converged"
        then = "" if entry.get("passed_over") else "; step halved"
        return f"evaluation {entry['evaluation']:3d}  no simulation: {reason}{then}"
    rms = "" if entry.get("rms_gv") is None else f"  residual {entry['rms_gv']:.4g} (rms)"
    return (f"evaluation {entry['evaluation']:3d}  objective {entry['phi']:.6g}{rms}"
            f"{'' if entry.get('accepted') else '  passed over' if entry.get('passed_over') else '  rejected'}")


def take_up(run: Path | str, runner: TaskRunner, sensitivity: str, progress=None, say=None) -> Session:
    """A session on a prepared RUN."""
    context = open_run(str(run))
    n_shape = sum(name in context.forward.morphs for name in context.moving)
    sensitivity = checked_sensitivity(sensitivity, context.experiment)
    chosen = choose_sensitivity(sensitivity, len(context.moving), runner.workers, n_shape)
    told = {name: call for name, call in (("progress", progress), ("say", say)) if call is not None}
    return Session(str(run), runner, chosen, **told)
