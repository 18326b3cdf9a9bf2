"""A study as a Prefect flow: one Dask task per case, one stored record per finished case.

A killed study loses only the cases in progress. ``resume`` runs the cases without a record of their present definition
and draws the page again.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from idic.errors import InputError
from idic_studies.cases.case import CaseJob, render, run_case
from idic_studies.cases.registry import make_study
from idic_studies.cases.store import StudyStore, write_page
from idic_studies.cases.study import Case, Study
from idic.run import TaskRunner, check_scheduler, checked_memory_limit, open_cluster
# before Prefect: it reads its settings from the environment
from idic_flows.settings import connected, flow_server, show_dashboards
from idic_flows.shown_runner import ShownRunner
from idic_flows.stages import run_stage


@dataclass(frozen=True)
class StudyConsole:
    """Receivers of progress.

    stage(text); tasks(what, done, total); said(line), a line to keep on the screen; dashboards(prefect, dask, password)
    """

    stage: Callable[[str], None] = lambda text: None
    tasks: Callable[[str, int, int], None] = lambda what, done, total: None
    said: Callable[[str], None] = lambda line: None
    dashboards: Callable[[str | None, str | None, str | None], None] = lambda prefect, dask, password: None


def run_study(name: str, out: str | Path, size: str = "full", only: Sequence[str] | None = None,
              workers: int | None = None, scheduler: str | None = None, resume: bool = False,
              console: StudyConsole | None = None, memory_limit: str | None = None) -> Path:
    """Run the unfinished cases of a study and write ``OUT/study.html``; returns its path.

    Parameters
    ----------
    name, size : as `idic_studies.cases.registry.make_study`
    out : folder; with `resume` that of an earlier run of the same study
    only : groups or cases to run, as `Study.select`; the page shows all finished cases
    workers, scheduler : a LocalCluster of so many processes (default one per core), or an existing Dask scheduler
    memory_limit : memory of one worker process, "2GB"

    Raises
    ------
    InputError
        Unknown study or cases, a folder in use; nothing is written.
    """
    console, study = console or StudyConsole(), make_study(name, size)
    chosen, store = study.select(only), StudyStore(out)
    if store.path.exists() and not resume:
        raise InputError("this study exists already", file=store.run, expected="a new folder, or --resume",
                         found="an earlier study", remedy="add --resume to continue it, or choose another --out")
    limit = checked_memory_limit(memory_limit, workers, scheduler)
    check_scheduler(scheduler, out, say=console.stage)
    with flow_server() as server, store.claim(f"study {name} {size}", title=study.title):
        with open_cluster(workers, scheduler, limit, ("idic_studies.cases.case",)) as runner:
            console.stage("starting Prefect")
            with connected(server):
                show_dashboards(console.dashboards, server, runner.dashboard)
                return _study_in_prefect(_Run(study, store, chosen, ShownRunner(runner), console))


@dataclass(frozen=True)
class _Run:
    study: Study
    store: StudyStore
    chosen: tuple[Case, ...]
    runner: TaskRunner
    console: StudyConsole

    def jobs(self, keys: Sequence[str]) -> list[CaseJob]:
        return [CaseJob(str(self.store.run), self.study.name, self.study.size, key) for key in keys]

    def missing(self, group: str) -> list[Case]:
        """Chosen cases of a group without a valid record."""
        return [case for case in self.chosen if case.group == group
                and not self.store.has_case(case.key, case.ident(self.study.rendering(case.images)))]


def _study_in_prefect(work: _Run) -> Path:
    """The flow; made here because importing Prefect takes seconds. Its parameters are what Prefect's pages show."""
    from prefect import flow

    @flow(name="idic-study", flow_run_name=f"study-{time.strftime('%H%M%S')}", validate_parameters=False,
          persist_result=False)
    def run(study: str, size: str, cases: list[str], out: str, workers: int) -> Path:
        names = [r.name for r in work.study.renderings if any(case.images == r.name for case in work.chosen)]
        groups = [group for group in work.study.groups if work.missing(group)]
        total = len(groups) + 2
        work.console.stage(f"stage 1 of {total}: rendering images")
        run_stage("render", _fan_out, work, "rendering", render, names)
        for number, group in enumerate(groups, start=2):
            work.console.stage(f"stage {number} of {total}: cases {group}")
            run_stage(f"cases {group}", _fan_out, work, group, run_case, [case.key for case in work.missing(group)])
        work.console.stage(f"stage {total} of {total}: tables and figures")
        return run_stage("draw", write_page, work.store, work.study)

    return run(work.study.name, work.study.size, [case.key for case in work.chosen], str(work.store.run),
               work.runner.workers)


def _fan_out(work: _Run, kind: str, function: Callable, keys: Sequence[str]) -> None:
    """Run `keys` on the workers; the first few give an estimate of the remaining time."""
    began = time.perf_counter()

    def progress(count: int, total: int) -> None:
        work.console.tasks(kind, count, total)
        spent = time.perf_counter() - began
        if count == min(total, 2 * work.runner.workers) and count < total:
            remaining_s = spent / count * (total - count)
            work.console.said(f"{kind}: {count} of {total} in {spent:.0f} s, about {remaining_s:.0f} s left")
        if count == total:
            work.console.said(f"{kind}: {total} in {spent:.0f} s")

    work.console.tasks(kind, 0, len(keys))
    for _ in work.runner.stream(function, work.jobs(keys), [f"{kind}-{key.replace('/', '-')}" for key in keys],
                                progress=progress):
        pass


__all__ = ["StudyConsole", "run_study"]
