"""The identification as a Prefect flow: it drives the iterations and carries parameters, schedule and convergence.

One Prefect task per stage of an iteration; inside a stage the simulations and the chunks of frames are Dask tasks with
names such as ``simulate-it003-SPECIMEN.E``. What is needed to go on after a kill is in the RUN folder, not in Prefect.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from idic_flows.settings import connected  # before Prefect: it reads its settings from the environment
from idic.edge.config import load_experiment
from idic.edge.dask_executor import check_scheduler, open_cluster
from idic.edge.finish import finish, write_interrupted
from idic.edge.identification import (Session, Timing, checked_sensitivity, correlate_point, first_state, load_state,
                                      simulate_point, take_up, update)
from idic.edge.prefect_server import start_server
from idic.edge.prepare import check_before_writing, ingest, needs_free_dic, prepare
from idic.edge.recovery import finished_result, recover
from idic.edge.runner import SerialRunner, TaskRunner
from idic.edge.tasks import DESCRIPTION
from idic.edge.warm_up import compile_image_kernels
from idic.edge.zarr_store import RunStore
from idic.errors import InputError
from idic.experiment import Experiment
from idic.identify.loop import Evaluation, LoopState


@dataclass(frozen=True)
class Console:
    """Where progress goes; every call may be ignored.

    stage(text), tasks(what, done, total), iteration(state)
    """

    stage: Callable[[str], None] = lambda text: None
    tasks: Callable[[str, int, int], None] = lambda what, done, total: None
    iteration: Callable[[LoopState], None] = lambda state: None
    dashboards: Callable[[str | None, str | None], None] = lambda prefect, dask: None


def run_identification(paths: Sequence[str | Path], out: str | Path, resume: bool = False, workers: int | None = None,
                       scheduler: str | None = None, sensitivity: str = "auto",
                       overrides: Mapping[str, object] | None = None, console: Console | None = None) -> dict:
    """Identify the parameters of an experiment; returns the content of ``RUN/result.json``.

    Parameters
    ----------
    paths : one experiment (folder or experiment.toml)
    out : the RUN folder
    resume : go on with an interrupted run in `out`
    workers, scheduler : a LocalCluster of so many processes (default one per core), or an existing Dask scheduler
    sensitivity : "direct", "perturbed" or "auto"
    overrides : ``--set key=value``

    Raises
    ------
    InputError
        If anything in the input is not what was expected; nothing has been written then.
    """
    began, console = time.perf_counter(), console or Console()
    overrides = dict(overrides or {})
    path = _only(paths)
    experiment = load_experiment(path, overrides)
    store = RunStore(out)
    check_before_writing(experiment)
    checked_sensitivity(sensitivity, experiment)
    check_scheduler(scheduler)
    with start_server() as server, open_checked(store, experiment, resume):
        done = _take_up_again(store, path, console) if resume else None
        if done is not None:
            return done
        console.stage("ingesting images")
        with open_cluster(workers, scheduler, preload=("idic.edge.tasks",)) as runner:
            ingest(store, experiment, lambda done, total: console.tasks("ingest", done, total))
            compiled = runner.background(compile_image_kernels, (str(store.run), str(path), overrides), "compile")
            console.stage("starting Prefect")
            with connected(server):
                console.dashboards(server.dashboard, runner.dashboard)
                run = _Run(store, experiment, str(path), overrides, runner, sensitivity, Timing(), began, console,
                           compiled)
                with _kept_when_interrupted(run):
                    return _flow()(run)


@dataclass(frozen=True)
class _Run:
    """What the flow works on. compiled : called before the first correlation, waits for the kernels."""

    store: RunStore
    experiment: Experiment
    path: str
    overrides: Mapping[str, object]
    runner: TaskRunner
    sensitivity: str
    timing: Timing
    began: float
    console: Console
    compiled: Callable[[], None]


def _take_up_again(store: RunStore, path: str | Path, console: Console) -> dict | None:
    """Look through an earlier run; its result, where nothing is left to do."""
    for text in recover(store, path):
        console.stage(text)
    return finished_result(store)


@contextmanager
def _kept_when_interrupted(run: _Run) -> Iterator[None]:
    """On Ctrl-C, or a request to end, the accepted point becomes a result with the status "interrupted"."""
    try:
        yield
    except Exception:
        raise
    except BaseException:  # KeyboardInterrupt; Prefect has its own word for it
        with suppress(Exception):  # whatever fails now must not hide the interruption; --resume finds everything
            write_interrupted(take_up(run.store.run, SerialRunner(), run.sensitivity), run.timing, run.began)
        raise


def open_checked(store: RunStore, experiment: Experiment, resume: bool):
    """Claim the RUN; an existing one is only taken up with --resume."""
    if not resume and (store.run / DESCRIPTION).exists():
        raise InputError("this RUN exists already", file=store.run, expected="a new folder, or --resume",
                         found="an earlier run", remedy="add --resume to go on with it, or choose another --out")
    return store.claim(experiment.identity, title=experiment.title)


def _only(paths: Sequence[str | Path]) -> str | Path:
    if len(paths) != 1:
        raise InputError("several experiments at once are not supported yet", expected="one experiment",
                         found=f"{len(paths)}", remedy="identify them one by one")
    return paths[0]


def _flow():
    """The flow and its tasks; made here because importing Prefect takes seconds."""
    from prefect import flow, task
    from prefect.cache_policies import NO_CACHE

    def stage(name: str, function: Callable, *arguments):
        """Run one stage as a Prefect task called `name`."""
        return task(name=name.split(" ")[0], task_run_name=name, cache_policy=NO_CACHE, persist_result=False)(
            lambda: function(*arguments))()

    @flow(name="idic-identify", flow_run_name=f"identify-{time.strftime('%H%M%S')}", validate_parameters=False,
          persist_result=False)
    def identify(holder):
        run, console = holder.content, holder.content.console
        if not (run.store.run / DESCRIPTION).exists():
            console.stage("measuring noise and motion" if needs_free_dic(run.experiment) else "preparing")
            stage("prepare", prepare, str(run.store.run), run.path, run.overrides, run.runner)
        session = take_up(run.store.run, run.runner, run.sensitivity, console.tasks)
        state = load_state(session) or first_state(session)
        while state.running:
            console.iteration(state)
            evaluation = _evaluate(stage, session, state, run)
            state = stage(f"update it{state.evaluations:03d}", update, session, state, evaluation)
        console.iteration(state)
        console.stage("residual maps and result")
        return stage("finish", finish, session, state, run.timing, run.began)

    return lambda run: identify(_Opaque(run))


def _evaluate(stage, session: Session, state: LoopState, run: _Run) -> Evaluation:
    """Simulate and correlate the trial; a simulation that does not arrive is a rejected step, not the end."""
    failed = stage(f"simulate it{state.evaluations:03d}", simulate_point, session, state, run.timing)
    if failed:
        return Evaluation(state.evaluations, None, None, failed)
    run.compiled()
    return stage(f"correlate it{state.evaluations:03d}", correlate_point, session, state, run.timing)


class _Opaque:
    """Carries a record into the flow without Prefect looking through its arrays."""

    __slots__ = ("content",)

    def __init__(self, content):
        self.content = content


__all__ = ["Console", "run_identification"]
