"""A prepared RUN at work: where its tasks run, how sensitivities are computed, and its cost so far."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from idic.identification import checked_sensitivity, choose_sensitivity
from idic.model import Experiment, is_camera_time
from idic.run.prepared.context import RunContext, open_run
from idic.run.prepared.tasks import SimulationJob
from idic.run.workers.dask_settings import cpu_seconds
from idic.run.workers.runner import TaskRunner


@dataclass
class Timing:
    """Seconds and simulations since this process opened the run; cpu_before_s : processor time until then."""

    forward_s: float = 0.0
    image_s: float = 0.0
    forward_runs: int = 0
    cpu_before_s: float = field(default_factory=cpu_seconds)


@dataclass(frozen=True)
class Session:
    """A prepared RUN at work.

    sensitivity : "direct" or "perturbed"; progress : called as progress(label, count, total) while tasks come back;
    say : called with a line for the log.
    """

    run: str
    runner: TaskRunner
    sensitivity: str
    progress: Callable[[str, int, int], None] = field(default=lambda label, count, total: None)
    say: Callable[[str], None] = field(default=lambda text: None)

    @property
    def context(self) -> RunContext:
        return open_run(self.run)

    @property
    def experiment(self) -> Experiment:
        return self.context.experiment

    def stream(self, label: str, function: Callable, jobs: Sequence) -> Iterator:
        """The results of jobs in their order, made by the workers; `label` names them in progress bar and dashboard."""
        names = [f"{label}-it{job.evaluation:03d}-{job.label}" if isinstance(job, SimulationJob)
                 else f"{label}-it{job.evaluation:03d}-frames{job.first}-{job.stop - 1}" for job in jobs]
        return self.runner.stream(function, jobs, names, retries=1, copies=True,
                                  progress=lambda count, total: self.progress(label, count, total))


def open_session(run: Path | str, runner: TaskRunner, sensitivity: str, progress=None, say=None) -> Session:
    """A session on a prepared RUN, new or resumed."""
    context = open_run(str(run))
    n_shape = sum(name in context.forward.morphs for name in context.moving)
    sensitivity = checked_sensitivity(sensitivity, context.experiment.model)
    chosen = choose_sensitivity(sensitivity, len(context.moving), runner.workers, n_shape,
                                any(map(is_camera_time, context.moving)))
    callbacks = {name: call for name, call in (("progress", progress), ("say", say)) if call is not None}
    return Session(str(run), runner, chosen, **callbacks)
