"""One refit as a task: edits of experiment.toml and numbers in, one `Fit` out; and the protocols that supply and run
such tasks."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from idic.diagnose.refits.refit import EarlyStop, Fit, Start, refit
from idic.diagnose.residual.subspace import Grid
from idic.diagnose.residual.thinning import CHOICE, JUDGEMENT, thinned
from idic.identification import ORDINARY, Path
from idic.model import Experiment, MotionError


class ExperimentSource(Protocol):
    """Where a diagnosis gets its experiments from; plain data, so that it travels to a worker.

    edits : overrides of experiment.toml that belong to the present null model; motion_error : that its simulation lacks
    """

    @property
    def edits(self) -> Mapping[str, Any]: ...

    def document(self) -> dict:
        """Tables of experiment.toml with the present edits."""
        ...

    def load(self, edits: Mapping[str, Any] | None = None) -> Experiment:
        """The experiment with the present edits and further ones."""
        ...

    @property
    def motion_error(self) -> MotionError | None: ...

    def with_edits(self, edits: Mapping[str, Any]) -> ExperimentSource:
        """The same source with more edits in its null model."""
        ...

    def with_motion_error(self, error: MotionError | None) -> ExperimentSource:
        """The same source whose experiments know what their simulation lacks."""
        ...


@dataclass(frozen=True)
class RefitJob:
    """One refit: edits of every start, the parameter values it begins at, the copy that judges it.

    grid : of the free motions that measure the residual, the same for all models that are compared
    target : chi-square on the first copy that ends the search for a better start
    early_stop : ends a search that falls behind the best rival, None without a limit
    copies : True: identified on one thinned copy, judged on the other; False: identified on the recording itself
    swapped : identified on the copy for judging, judged on the copy for choosing
    borrowed : label of the start whose values were fitted to the copy that judges (`Start.borrowed`)
    estimator : of the first evaluation; unlimited : without the limit of evaluations
    whole_std : standard deviations count what the model leaves unexplained, for the model that is selected at last
    most_evaluations : of the body per frame, beyond which a simulation has failed (`refit`); None: any number
    begun : a simulation of the first start or of a point near it
    """

    name: str
    source: ExperimentSource
    labels: tuple[str, ...]
    edits: tuple[Mapping[str, Any], ...]
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
    whole_std: bool = False
    most_evaluations: int | None = None
    begun: Path | None = None


Refits = Callable[[Sequence[RefitJob]], list[Fit]]  # runs jobs, side by side or not; answers in their order


class AnnouncedRefits:
    """Runs refits and tells before each wave of them which it is, of how many, and about how long they will take."""

    def __init__(self, refits: Refits, stage: Callable[[str], None], planned: int):
        self.refits, self.stage, self.planned = refits, stage, planned
        self.done, self.seconds = 0, 0.0

    def __call__(self, jobs: Sequence[RefitJob]) -> list[Fit]:
        if not jobs:
            return []
        final_number = self.done + len(jobs)
        total = max(self.planned, final_number)
        numbers = f"{final_number}" if len(jobs) == 1 else f"{self.done + 1} to {final_number}"
        names = ", ".join(job.name.replace("_", " ") for job in jobs)
        self.stage(f"refit {numbers} of {total}{self._about(total - self.done)}: {names}")
        began = time.perf_counter()
        answers = self.refits(jobs)
        self.done, self.seconds = final_number, self.seconds + time.perf_counter() - began
        return answers

    def _about(self, n_jobs: int) -> str:
        """How long the refits that are left take, by those that are done; they are the most, as many are dropped."""
        if not self.done:
            return ""
        minutes = n_jobs * self.seconds / self.done / 60.0
        return f", at most about {minutes:.0f} min" if minutes >= 1.0 else ", less than a minute"


def run_refit(job: RefitJob) -> Fit:
    """Identify and measure one model (a task)."""
    starts, other_copies = [], {}
    for label, edits, values in zip(job.labels, job.edits, job.values, strict=True):
        experiment = job.source.load(edits)
        if job.copies:
            other_copies[label] = thinned(experiment, CHOICE if job.swapped else JUDGEMENT, job.seed)
            experiment = thinned(experiment, JUDGEMENT if job.swapped else CHOICE, job.seed)
        starts.append(Start(label, experiment, values, label == job.borrowed))
    return refit(job.name, starts, other_copies, job.local, job.grid, job.target, job.early_stop, job.estimator,
                 job.unlimited,
                 job.whole_std, job.most_evaluations, job.begun)


def refit_of_one(source: ExperimentSource, name: str, null: Fit, grid: Grid, seed: int,
                 moved: Mapping[str, float] | None = None, **fields) -> RefitJob:
    """The job that fits the present null model of a source again, from the end of its last fit.

    moved : changes of parameters since that fit, to first order: the job begins with them, and at that end only where
    the first start fails
    fields : fields of `RefitJob`
    """
    begins: tuple[Mapping[str, float], ...] = (null.values,)
    if moved is not None:
        begins = ({name: value + moved.get(name, 0.0) for name, value in null.values.items()}, null.values)
    return RefitJob(name, source, (name,) * len(begins), ({},) * len(begins), begins, null.local, grid, np.inf, seed,
                    **fields)
