"""Many identifications: whole ones side by side where there are enough of them to fill the workers, otherwise one after
the other with their simulations and frames side by side.

Finished results lie in the RUN folders; a killed batch finds them there (``resume``) and continues with the others.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from idic.run.batch.runs import ERROR, BatchJob, BatchOutcome, identify_job, identify_whole
from idic.run.batch.starts import batch_runs
from idic.run.batch.store import Batch
from idic.run.orchestrator import DIRECT, Command, Console, Hooks, Orchestrator
from idic.run.workers.runner import JobKillsWorkers
from idic.run.workers.workplace import IN_PROCESS, Workplace


def identify_batch(paths: Sequence[str | Path], out: str | Path, *, starts: int | None = None, spread: float = 0.3,
                   seed: int = 0, resume: bool = False, overrides: Mapping[str, Any] | None = None,
                   sensitivity: str = "auto", workplace: Workplace = IN_PROCESS, console: Console | None = None,
                   orchestrator: Orchestrator = DIRECT) -> dict:
    """Identify many experiments, each in ``OUT/NAME``; returns the content of ``OUT/batch.json``.

    Parameters
    ----------
    paths : experiments, and lists of runs (`idic.run.batch.entries`)
    starts, spread, seed : every run from so many random starts (`idic.run.batch.starts`)
    resume : continue an earlier batch in `out`; its finished runs are kept
    overrides : ``--set key=value`` for all runs
    sensitivity, workplace, console, orchestrator : as of `idic.run.identify_run`

    Raises
    ------
    InputError
        A list, a folder or a scheduler that is not as expected; nothing has been written then. Whatever is wrong with
        an experiment itself becomes the status of its runs.
    """
    console = console or Console()
    runs = batch_runs(paths, overrides, starts, spread, seed)
    batch = Batch(out, runs, sensitivity)
    workplace.check(out, say=console.stage)
    with (orchestrator.opened(), batch.claim(resume), _kept_when_interrupted(batch),
          workplace.opened(out, (), ("idic.run.batch.runs",), console.remark) as runner):
        batch.write("running")
        command = Command("batch", "the batch", {"experiments": [run.name for run in runs], "out": str(batch.folder),
                                                 "workers": runner.workers}, several_runs=True)
        return orchestrator.conduct(command, runner, console, lambda hooks: _Work(batch, hooks, console).identify())


@contextmanager
def _kept_when_interrupted(batch: Batch) -> Iterator[None]:
    try:
        yield
    except Exception:
        raise
    except BaseException:  # KeyboardInterrupt; Prefect has its own word for it
        with suppress(Exception):  # whatever fails now must not hide the interruption; --resume finds everything
            batch.write("interrupted", page=True)
        raise


@dataclass(frozen=True)
class _Work:
    batch: Batch
    hooks: Hooks
    console: Console

    def identify(self) -> dict:
        """All runs, then table and page."""
        jobs = [self.batch.job(run) for run in self.batch.runs]
        n = self.hooks.runner.workers
        # by the number of all runs, finished ones included: a resumed batch does as before
        if len(jobs) >= n:
            self.console.stage(f"identifications: {len(jobs)} on {n} worker{'s' if n > 1 else ''}")
            self.hooks.stage("identify", self.side_by_side, jobs)
        else:
            self.one_by_one(jobs)
        self.console.stage("summary and page")
        return self.hooks.stage("summary", self.batch.write, "finished", True)

    def one_by_one(self, jobs: Sequence[BatchJob]) -> None:
        """Each with all workers."""
        began, total = time.perf_counter(), len(jobs)
        for number, job in enumerate(jobs, start=1):
            self.console.stage(f"identification {number} of {total}: {job.name}")
            self._take_down(self.hooks.stage(f"identify {job.name}", identify_job, job, self.hooks.runner,
                                             self.console.tasks))
            spent_s = time.perf_counter() - began
            if number < total:
                self.console.remark(f"identifications: {number} of {total} in {spent_s:.0f} s, "
                                  f"about {spent_s / number * (total - number):.0f} s left")

    def side_by_side(self, jobs: Sequence[BatchJob]) -> None:
        """Whole identifications as tasks; one that repeatedly kills its workers is given up, the others continue."""
        todo = list(jobs)
        while todo:
            attempted, earlier = tuple(todo), len(jobs) - len(todo)
            results = self.hooks.runner.stream(
                identify_whole, attempted, [f"identify-{job.name}" for job in attempted],
                progress=lambda count, _, earlier=earlier: self.console.tasks("identify", earlier + count,
                                                                            len(jobs)))  # type: ignore[misc]
            try:
                for outcome in results:
                    del todo[0]
                    self._take_down(outcome)
            except JobKillsWorkers as problem:
                killer = todo[0] if problem.job is None else attempted[problem.job]
                todo.remove(killer)
                self._take_down(BatchOutcome(killer.name, ERROR, str(problem)))

    def _take_down(self, outcome: BatchOutcome) -> None:
        self.batch.record(outcome)
        self.batch.write("running")
        reason = outcome.reason.strip().splitlines()
        self.console.remark(f"{outcome.name}: {outcome.status.replace('_', ' ')}{f' ({reason[0]})' if reason else ''}")
