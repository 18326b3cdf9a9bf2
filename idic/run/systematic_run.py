"""Systematic errors of a finished RUN: discretisation bias and the spread over treatments of boundary and camera.

Every assessment is one task: the finer mesh at the identified point, or a whole identification with another treatment
from the identified point, in the memory of its worker. Their outcome goes into ``RUN/result.json``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from idic.errors import InputError, NotConverged
from idic.experiment_file import load_experiment, locate, read_toml, with_overrides
from idic.identification import (
    Assessment, LoopState, Treatment, determined_values, discretisation_bias, evaluate_at, experiment_of, identify,
    measured_start, starts_from_dic, time_step_bias, treatments, with_bias, with_spread,
)
from idic.measure import BoundaryStart, Regularisation, dic_stack, with_boundary_start
from idic.model import Experiment, Measured, is_mode
from idic.run.orchestrator import DIRECT, Command, Console, Hooks, Orchestrator
from idic.run.prepared.context import RunContext, experiments_of, open_run
from idic.run.store.arrays import read_array
from idic.run.store.camera_groups import with_stored_images, with_stored_noise
from idic.run.store.layout import group_name
from idic.run.store.result_file import RESULT_FILE, read_result, write_result
from idic.run.store.run_folders import is_joint
from idic.run.store.run_lock import run_lock
from idic.run.store.state_file import load_state
from idic.run.store.system_store import load_evaluation
from idic.run.workers.runner import Progress, TaskRunner
from idic.run.workers.workplace import IN_PROCESS, Workplace

ENDED = ("converged", "at_bound", "stalled", "max_iterations")


@dataclass(frozen=True)
class AssessmentJob:
    """One task; treatment None: the finer mesh, or shorter increments."""

    run: str
    treatment: Treatment | None
    increments: bool = False


def systematic(run: str | Path, bias: bool = True, spread: bool = True, *, workplace: Workplace = IN_PROCESS,
               console: Console | None = None, orchestrator: Orchestrator = DIRECT) -> dict:
    """Estimate both for a finished RUN and write them into its result.json.

    Parameters
    ----------
    bias, spread : the discretisation bias; the spread over treatments of boundary and camera
    workplace, console, orchestrator : as of `idic.run.identify_run`; finished assessments are the tasks "comparisons"

    Returns
    -------
    The new content of ``RUN/result.json``.

    Raises
    ------
    InputError
        If the RUN holds no finished identification of one experiment, or of an external solver; another process works
        on it.
    """
    console = console or Console()
    _finished(run)  # before the lock, which makes a file
    workplace.check(run, say=console.stage)
    console.stage("discretisation, boundary and camera")

    def work(hooks: Hooks) -> dict:
        return hooks.stage("assess", _assessed, run, hooks.runner, bias, spread, partial(console.tasks, "comparisons"))

    with (orchestrator.opened(), run_lock(run),
          workplace.opened(run, experiments_of(run), ("idic.run.systematic_run",), console.remark) as runner):
        command = Command("systematic", "the assessment", {"run": str(run), "bias": bias, "spread": spread,
                                                           "workers": runner.workers})
        return orchestrator.conduct(command, runner, console, work)


def _assessed(run: str | Path, runner: TaskRunner, bias: bool, spread: bool, progress: Progress | None) -> dict:
    result = _finished(run)  # read again: until the lock was taken another command could write it
    context = open_run(str(run))
    jobs = [AssessmentJob(str(run), None)] if bias else []
    if bias and context.experiment.model.path_dependent_laws:
        jobs.append(AssessmentJob(str(run), None, increments=True))
    n_biases = len(jobs)
    if spread:
        jobs += [AssessmentJob(str(run), treatment) for treatment in treatments(context.experiment, _tables(context))]
    labels = [f"systematic-{number}" for number in range(len(jobs))]
    assessments = runner.map(assess, jobs, labels, progress=progress)
    if bias:
        result = with_bias(result, *assessments[:n_biases])
    if spread:
        result = with_spread(result, assessments[n_biases:])
    write_result(run, result)
    return result


def assess(job: AssessmentJob) -> Assessment:
    """Do one task."""
    context, state = open_run(job.run), load_state(job.run)
    if job.treatment is None:
        return _finer(context, state, job.increments)
    boundary, camera = job.treatment.boundary, job.treatment.camera
    try:
        experiment, local = _treated(context, state, job.treatment)
        identification = identify(experiment, local)
    except (InputError, NotConverged) as problem:
        return Assessment(boundary, camera, "failed", {}, str(problem).splitlines()[0])
    result = identification.result
    return Assessment(boundary, camera, identification.state.status, determined_values(result, context.names),
                      added=_added(result, context.names))


def _added(result: Mapping, names: Sequence[str]) -> dict[str, dict[str, float | str | None]]:
    """The identified values of the treatment's additional degrees of freedom, modes of a boundary excepted."""
    return {name: {key: entry[key] for key in ("value", "std", "unit")}
            for name, entry in result["parameters"].items()
            if entry["free"] and name not in names and not is_mode(name)}


def _finer(context: RunContext, state: LoopState, increments: bool) -> Assessment:
    """The biases by the mesh, or by the increments of time."""
    try:
        ended = load_evaluation(context.store, state.accepted.number, context.names)
        at = (evaluate_at, experiment_of(context.experiment, state), state.accepted.values, _local(context, state),
              state.generalised, ended, state.increments.per_frame)
        biases, status = (time_step_bias(*at), "shorter increments") if increments else discretisation_bias(*at)
    except (InputError, NotConverged) as problem:
        return Assessment("", "", "failed", {}, str(problem).splitlines()[0])
    parameters = context.experiment.model.parameters
    return Assessment("", "", status, {name: value / parameters[name].factor for name, value in biases.items()})


def _local(context: RunContext, state: LoopState) -> np.ndarray:
    """Frame-local unknowns at the accepted point, its own last step included  # (n_frames, m) mm"""
    local = read_array(context.store.group(group_name(state.accepted.number, "start")), "local").copy()
    for record in load_evaluation(context.store, state.accepted.number, context.names).system.frames:
        local[record.frame] += record.local_step
    return local


def _treated(context: RunContext, state: LoopState, treatment: Treatment) -> tuple[Experiment, np.ndarray | None]:
    """The experiment as treated, from the identified values, and the start of its frame-local unknowns."""
    settings, original = context.settings, context.experiment
    options = {"options.estimator": "generalised" if state.generalised else "ordinary"}
    experiment = load_experiment(settings["experiment"], dict(settings["overrides"]) | options | treatment.overrides)
    experiment = with_stored_noise(with_stored_images(context.store, experiment), settings)
    experiment = replace(experiment, recording=replace(experiment.recording, excluded=tuple(settings["excluded"])),
                         stages=())
    values = {name: value for name, value in state.accepted.values.items()
              if name in experiment.model.parameters and not name.startswith("boundary.")}
    experiment = experiment.with_parameters(experiment.model.parameters.with_values(values))
    measured = any(isinstance(entry.drive, Measured) for entry in experiment.model.prescribed)
    if not measured and not starts_from_dic(experiment):
        as_given = "boundary" not in treatment.overrides
        return experiment, _local(context, state) if as_given and original.model.prescribed else None
    u_px = dic_stack(experiment, Regularisation.smooth()).u_px
    local = measured_start(experiment, u_px, experiment.recording.excluded)
    return with_boundary_start(experiment, BoundaryStart.of(experiment, u_px, experiment.recording.excluded)), local


def _finished(run: str | Path) -> dict:
    path = Path(run) / RESULT_FILE
    if is_joint(run) or is_joint(Path(run).resolve().parent.parent):
        raise InputError("several experiments were identified together here", file=run,
                         expected="a run of one experiment", found="a run of several, or a part of it",
                         remedy="identify one of them alone and assess that run")
    result = read_result(run)
    if result["status"] not in ENDED or load_state(run) is None:
        raise InputError("this identification has no point to assess", file=path,
                         expected=", ".join(ENDED) + ", of one experiment", found=result["status"],
                         remedy="assess a run of one experiment that has ended")
    return result


def _tables(context: RunContext) -> dict:
    return with_overrides(read_toml(locate(context.settings["experiment"])), context.settings["overrides"])
