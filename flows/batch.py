"""Many identifications as one Prefect flow: whole ones side by side where there are enough of them to fill the workers,
otherwise one after the other with their simulations and frames side by side.

Finished results lie in the RUN folders; a killed batch finds them there (``resume``) and continues with the others.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from idic.run import (
    Batch, BatchJob, BatchOutcome, ERROR, JobKillsWorkers, TaskRunner, check_scheduler, checked_memory_limit,
    identify_job, identify_whole, open_cluster, read_batch, with_starts,
)
# before Prefect: it reads its settings from the environment
from idic_flows.settings import connected, flow_server, show_dashboards
from idic_flows.shown_runner import ShownRunner
from idic_flows.stages import run_stage


@dataclass(frozen=True)
class BatchConsole:
    """Where progress goes; every call may be ignored.

    stage(text); tasks(what, done, total); said(line) a line worth keeping
    """

    stage: Callable[[str], None] = lambda text: None
    tasks: Callable[[str, int, int], None] = lambda what, done, total: None
    said: Callable[[str], None] = lambda line: None
    dashboards: Callable[[str | None, str | None, str | None], None] = lambda prefect, dask, password: None


def run_batch(paths: Sequence[str | Path], out: str | Path, *, starts: int | None = None, spread: float = 0.3,
              seed: int = 0, resume: bool = False, workers: int | None = None, scheduler: str | None = None,
              sensitivity: str = "auto", overrides: Mapping[str, Any] | None = None,
              console: BatchConsole | None = None, memory_limit: str | None = None) -> dict:
    """Identify many experiments, each in ``OUT/NAME``; returns the content of ``OUT/batch.json``.

    Parameters
    ----------
    paths : experiments, and lists of runs (`idic.run.batch.entries`)
    starts, spread, seed : every run from so many random starts (`idic.run.batch.starts`)
    resume : continue an earlier batch in `out`; its finished runs are kept
    workers, scheduler : a LocalCluster of so many processes (default one per core), or an existing Dask scheduler
    sensitivity : "direct", "perturbed" or "auto"
    overrides : ``--set key=value`` for all runs
    memory_limit : memory of one worker process, "2GB"

    Raises
    ------
    InputError
        A list, a folder or a scheduler that is not as expected; nothing has been written then. Whatever is wrong with
        an experiment itself becomes the status of its runs.
    """
    console = console or BatchConsole()
    runs = read_batch(paths, overrides)
    if starts is not None:
        runs = with_starts(runs, starts, spread, seed)
    batch = Batch(out, runs, sensitivity)
    limit = checked_memory_limit(memory_limit, workers, scheduler)
    check_scheduler(scheduler, out, say=console.stage)
    with flow_server() as server, batch.claim(resume), _kept_when_interrupted(batch):
        with open_cluster(workers, scheduler, limit, ("idic.run.batch.runs",)) as runner:
            batch.write("running")
            console.stage("starting Prefect")
            with connected(server):
                show_dashboards(console.dashboards, server, runner.dashboard)
                return _batch_in_prefect(_Work(batch, ShownRunner(runner, name_run=True), console))


@dataclass(frozen=True)
class _Work:
    batch: Batch
    runner: TaskRunner
    console: BatchConsole

    @property
    def side_by_side(self) -> bool:
        """Whole runs as tasks. By the number of all runs, finished ones included: a resumed batch does as before."""
        return len(self.batch.runs) >= self.runner.workers


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


def _batch_in_prefect(work: _Work) -> dict:
    """The flow; made here because importing Prefect takes seconds. Its parameters are what Prefect's pages show."""
    from prefect import flow

    @flow(name="idic-batch", flow_run_name=f"batch-{time.strftime('%H%M%S')}", validate_parameters=False,
          persist_result=False)
    def identify_all(experiments: list[str], out: str, workers: int) -> dict:
        jobs = [work.batch.job(run) for run in work.batch.runs]
        if work.side_by_side:
            n = work.runner.workers
            work.console.stage(f"identifications: {len(jobs)} on {n} worker{'s' if n > 1 else ''}")
            run_stage("identify", _side_by_side, work, jobs)
        else:
            began = time.perf_counter()
            for number, job in enumerate(jobs, start=1):
                work.console.stage(f"identification {number} of {len(jobs)}: {job.name}")
                _take_down(work, run_stage(f"identify {job.name}", identify_job, job, work.runner, work.console.tasks))
                _expect(work, time.perf_counter() - began, number, len(jobs))
        work.console.stage("summary and page")
        return run_stage("summary", work.batch.write, "finished", True)

    return identify_all([run.name for run in work.batch.runs], str(work.batch.folder), work.runner.workers)


def _expect(work: _Work, spent_s: float, done: int, total: int) -> None:
    """Expected time left, where one identification follows the other."""
    if done < total:
        work.console.said(f"identifications: {done} of {total} in {spent_s:.0f} s, "
                          f"about {spent_s / done * (total - done):.0f} s left")


def _side_by_side(work: _Work, jobs: Sequence[BatchJob]) -> None:
    """Whole identifications as tasks; one that repeatedly kills its workers is given up, the others continue."""
    todo = list(jobs)
    while todo:
        asked, done = tuple(todo), len(jobs) - len(todo)
        results = work.runner.stream(
            identify_whole, asked, [f"identify-{job.name}" for job in asked],
            progress=lambda now, _, before=done: work.console.tasks("identify", before + now,
                                                                    len(jobs)))  # type: ignore[misc]
        try:
            for outcome in results:
                del todo[0]
                _take_down(work, outcome)
        except JobKillsWorkers as problem:
            killer = todo[0] if problem.job is None else asked[problem.job]
            todo.remove(killer)
            _take_down(work, BatchOutcome(killer.name, ERROR, str(problem)))


def _take_down(work: _Work, outcome: BatchOutcome) -> None:
    work.batch.record(outcome)
    work.batch.write("running")
    reason = outcome.reason.strip().splitlines()
    work.console.said(f"{outcome.name}: {outcome.status.replace('_', ' ')}{f' ({reason[0]})' if reason else ''}")


__all__ = ["BatchConsole", "run_batch"]
