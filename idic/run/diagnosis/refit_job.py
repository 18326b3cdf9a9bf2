"""One refit as a task: edits of experiment.toml and numbers in, one `Refit` out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from idic.diagnose.refit import EarlyStop, Refit, Start, refit
from idic.diagnose.residual.subspace import Grid
from idic.diagnose.residual.thinning import CHOICE, JUDGEMENT, thinned
from idic.identify.step.state import ORDINARY
from idic.run.diagnosis.source import Source
from idic.workers.runner import TaskRunner


@dataclass(frozen=True)
class RefitJob:
    """One refit: edits of every start, the values it begins at, where it is judged.

    grid : free motions that measure what is left, the same for all models that are compared
    race : what it has to reach, if others have arrived already
    copies : True: identified on one thinned copy, judged on the other; False: on the recording as it is
    swapped : identified on the copy for judging, judged on the other one
    borrowed : label of the start whose values were fitted to the copy that judges (`Start.borrowed`)
    estimator : to begin with; unlimited : without the limit of evaluations
    """

    name: str
    source: Source
    labels: tuple[str, ...]
    edits: tuple[Mapping[str, object], ...]
    values: tuple[Mapping[str, float], ...]
    local: np.ndarray
    grid: Grid
    target: float
    seed: int
    early_stop: EarlyStop | None = None
    copies: bool = True
    swapped: bool = False
    borrowed: str = ""
    estimator: str = ORDINARY
    unlimited: bool = False


class RefitMemory(Protocol):
    """Where finished refits wait for a diagnosis that is resumed."""

    def get(self, job: RefitJob) -> Refit | None:
        """The refit of this job, None where it was never finished."""
        ...

    def put(self, job: RefitJob, refit: Refit) -> None:
        """Keep a refit."""
        ...


def run_refit(job: RefitJob) -> Refit:
    """Identify and measure one model (a task)."""
    starts, other = [], {}
    for label, edits, values in zip(job.labels, job.edits, job.values, strict=True):
        experiment = job.source.load(edits)
        if job.copies:
            other[label] = thinned(experiment, CHOICE if job.swapped else JUDGEMENT, job.seed)
            experiment = thinned(experiment, JUDGEMENT if job.swapped else CHOICE, job.seed)
        starts.append(Start(label, experiment, values, label == job.borrowed))
    return refit(job.name, starts, other, job.local, job.grid, job.target, job.early_stop, job.estimator,
                 job.unlimited)


def run_refits(runner: TaskRunner, kept: RefitMemory | None, jobs: Sequence[RefitJob]) -> list[Refit]:
    """Refits side by side, in the order of the jobs; finished ones are kept as they come."""
    known = [None if kept is None else kept.get(job) for job in jobs]
    missing = [job for job, refitted in zip(jobs, known, strict=True) if refitted is None]
    names = [f"refit-{job.name}-{number}" for number, job in enumerate(missing)]
    made = []
    for job, refitted in zip(missing, runner.stream(run_refit, missing, names, retries=1), strict=True):
        if kept is not None:
            kept.put(job, refitted)
        made.append(refitted)
    fresh = iter(made)
    return [next(fresh) if refitted is None else refitted for refitted in known]
