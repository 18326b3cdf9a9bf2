"""A study as a Prefect flow: its cases are Dask tasks, each writes its own record, and what is finished is kept.

Whoever kills a study loses the cases that were under way and nothing else; ``resume`` does those that are missing, or
whose definition has changed, and draws everything anew.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from idic.errors import InputError
from idic.validation.studies.case import CaseJob, render, run_case
from idic.validation.studies.registry import make_study
from idic.validation.studies.store import StudyStore, write_page
from idic.validation.studies.study import Case, Study
from idic.workers.dask_executor import check_scheduler, checked_memory_limit, open_cluster
from idic.workers.prefect_server import start_server
from idic.workers.runner import TaskRunner
from idic_flows.settings import connected  # before Prefect: it reads its settings from the environment


@dataclass(frozen=True)
class StudyConsole:
    """Where progress goes; every call may be ignored.

    stage(text); tasks(what, done, total); said(line) a line worth keeping
    """

    stage: Callable[[str], None] = lambda text: None
    tasks: Callable[[str, int, int], None] = lambda what, done, total: None
    said: Callable[[str], None] = lambda line: None
    dashboards: Callable[[str | None, str | None], None] = lambda prefect, dask: None


def run_study(name: str, out: str | Path, size: str = "full", only: Sequence[str] | None = None,
              workers: int | None = None, scheduler: str | None = None, resume: bool = False,
              console: StudyConsole | None = None, memory_limit: str | None = None) -> Path:
    """Do the cases of a study that are not done yet and write ``OUT/study.html``; returns its path.

    Parameters
    ----------
    name, size : as `idic.validation.studies.registry.make_study`
    out : folder; with `resume` an earlier one of the same study may be there
    only : groups or cases to do, as `Study.select`; the page shows everything that is finished
    workers, scheduler : a LocalCluster of so many processes (default one per core), or an existing Dask scheduler
    memory_limit : memory of one worker process, "2GB"

    Raises
    ------
    InputError
        Unknown study or cases, a folder in use; nothing has been written then.
    """
    console, study = console or StudyConsole(), make_study(name, size)
    chosen, store = study.select(only), StudyStore(out)
    if store.path.exists() and not resume:
        raise InputError("this study exists already", file=store.run, expected="a new folder, or --resume",
                         found="an earlier study", remedy="add --resume to go on with it, or choose another --out")
    limit = checked_memory_limit(memory_limit, workers, scheduler)
    check_scheduler(scheduler)
    with start_server() as server, store.claim(f"study {name} {size}", title=study.title):
        with open_cluster(workers, scheduler, limit, ("idic.validation.studies.case",)) as runner:
            console.stage("starting Prefect")
            with connected(server):
                console.dashboards(server.dashboard, runner.dashboard)
                return _flow()(_Run(study, store, chosen, runner, console))


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
        """Cases of a group that are to be done."""
        return [case for case in self.chosen if case.group == group
                and not self.store.has_case(case.key, case.ident(self.study.rendering(case.images)))]


def _flow():
    """The flow and its tasks; made here because importing Prefect takes seconds."""
    from prefect import flow, task
    from prefect.cache_policies import NO_CACHE

    def stage(name: str, function: Callable, *arguments):
        return task(name=name.split(" ", maxsplit=1)[0], task_run_name=name, cache_policy=NO_CACHE, persist_result=False)(
            lambda: function(*arguments))()

    @flow(name="idic-study", flow_run_name=f"study-{time.strftime('%H%M%S')}", validate_parameters=False,
          persist_result=False)
    def run(holder):
        work = holder()
        names = [r.name for r in work.study.renderings if any(case.images == r.name for case in work.chosen)]
        work.console.stage("rendering images")
        stage("render", _fan_out, work, "rendering", render, names)
        for group in work.study.groups:
            keys = [case.key for case in work.missing(group)]
            if keys:
                work.console.stage(f"cases {group}")
                stage(f"cases {group}", _fan_out, work, group, run_case, keys)
        work.console.stage("drawing")
        return stage("draw", write_page, work.store, work.study)

    return lambda work: run(lambda: work)  # a function: Prefect does not look through it


def _fan_out(work: _Run, what: str, function: Callable, keys: Sequence[str]) -> None:
    """Do `keys` on the workers; say after the first few how long the others will take."""
    began = time.perf_counter()

    def progress(done: int, total: int) -> None:
        work.console.tasks(what, done, total)
        spent = time.perf_counter() - began
        if done == min(total, 2 * work.runner.workers) and done < total:
            left = spent / done * (total - done)
            work.console.said(f"{what}: {done} of {total} in {spent:.0f} s, about {left:.0f} s left")
        if done == total:
            work.console.said(f"{what}: {total} in {spent:.0f} s")

    work.console.tasks(what, 0, len(keys))
    for _ in work.runner.stream(function, work.jobs(keys), [f"{what}-{key.replace('/', '-')}" for key in keys],
                                progress=progress):
        pass


__all__ = ["StudyConsole", "run_study"]
