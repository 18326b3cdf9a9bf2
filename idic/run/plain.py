"""An identification as one function call, without a Prefect server: for notebooks, scripts and tests.

    >>> import idic
    >>> result = idic.identify_experiment("my-test", "my-run")
    >>> result["status"], len(result["parameters"]["BODY.E"]["ci95"])
    ('converged', 2)
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from threadpoolctl import threadpool_limits

from idic.errors import InputError
from idic.experiment_file import by_evidence
from idic.identification import LoopState, log_progress, run_loop
from idic.run.prepared.session import Timing
from idic.run.runs import Points, Run, SingleRun, check_pause
from idic.run.store.arrays import leave_stuck_io
from idic.run.store.run_store import RunStore
from idic.run.workers.dask_executor import default_workers, open_cluster
from idic.run.workers.runner import SerialRunner, TaskRunner
from idic.run.workers.workplace import Workplace


@dataclass(frozen=True)
class Console:
    """Where progress goes; every call may be ignored.

    stage(text), tasks(what, done, total), iteration(state), said(line of the log),
    dashboards(address of Prefect, of Dask, password)
    """

    stage: Callable[[str], None] = lambda text: None
    tasks: Callable[[str, int, int], None] = lambda what, done, total: None
    iteration: Callable[[LoopState], None] = lambda state: None
    dashboards: Callable[[str | None, str | None, str | None], None] = lambda prefect, dask, password: None
    said: Callable[[str], None] = lambda text: None


@dataclass(frozen=True)
class OpenRun:
    """A claimed run, its workers and its progress.

    began : `time.perf_counter` at its start; pause_after : number of the stage of the schedule after which it pauses
    """

    planned: Run
    runner: TaskRunner
    sensitivity: str
    timing: Timing
    began: float
    console: Console
    pause_after: int | None = None

    def open_points(self) -> Points:
        return self.planned.open_points(self.runner, self.sensitivity, self.timing, self.console.tasks,
                                        self.console.said)

    def say_prepare(self) -> None:
        self.console.stage("preparation" + (": noise and motion by a free FE-DIC" if self.planned.measures else ""))

    @contextmanager
    def kept_when_interrupted(self) -> Iterator[None]:
        """On Ctrl-C, or a request to end, the accepted point becomes a result with the status "interrupted"."""
        try:
            yield
        except Exception:
            raise
        except BaseException:  # KeyboardInterrupt; Prefect raises one of its own
            with suppress(Exception):  # a failure here must not hide the interruption; --resume finds everything
                leave_stuck_io()
                points = self.planned.open_points(SerialRunner(), self.sensitivity, self.timing)
                points.write_interrupted(self.began)
            raise

    def identify(self) -> dict:
        """Prepare, iterate, write; what an earlier process has finished is not repeated."""
        done = self.planned.finished_result()
        if done is not None:
            return done
        if not self.planned.prepared:
            self.say_prepare()
            self.planned.prepare(self.runner)
        points = self.open_points()
        self.console.stage("identification")
        return self.written(points, run_loop(points, progress=self.console.iteration, pause_after=self.pause_after))

    def written(self, points: Points, state: LoopState) -> dict:
        """The result of the loop's last state; status "interrupted" where the run pauses."""
        self.console.stage("residual maps and result")
        if not state.running:
            return points.postprocess(state, self.began)
        result = points.postprocess(replace(state, status="interrupted"), self.began)
        return result | {"paused_after_stage": self.pause_after}


def identify_plainly(paths: Sequence[str | Path], out: str | Path, resume: bool = False, workers: int | None = None,
                     scheduler: str | None = None, sensitivity: str = "auto",
                     overrides: Mapping[str, Any] | None = None,
                     console: Console | None = None, memory_limit: str | None = None,
                     pause_after: int | None = None, store: str | None = None) -> dict:
    """``idic identify --no-prefect``: the same stages, files and bits without Prefect.

    Parameters
    ----------
    paths : one experiment (folder or experiment.toml), or several with shared materials
    out : the RUN folder
    resume : resume an interrupted run in `out`
    workers, scheduler : a LocalCluster of so many processes (0: everything in this process; default: one per core, or
        this process where the run is small), or an existing Dask scheduler
    sensitivity : "direct", "perturbed" or "auto"
    overrides : ``--set key=value``
    memory_limit : memory of one worker process, "2GB"
    pause_after : stage of the schedule (1: the first) after which the run pauses, to be resumed
    store : through which the workers of a scheduler get and send files where no disk is common: a URL of fsspec, or
    "driver"

    Returns
    -------
    The content of ``RUN/result.json``, and the key "paused_after_stage" where the run pauses.

    Raises
    ------
    InputError
        If anything in the input is not what was expected; nothing has been written then.
    """
    began, console = time.perf_counter(), console or Console()
    planned = plan_run(paths, out, dict(overrides or {}), console.stage)
    planned.check(sensitivity)
    check_pause(planned, pause_after)
    place = workplace_for(planned, workers, scheduler, memory_limit, store)
    place.check(out, planned.to_see, console.stage)

    def work(runner: TaskRunner) -> dict:
        console.dashboards(None, runner.dashboard, None)
        run = OpenRun(planned, runner, sensitivity, Timing(), began, console, pause_after)
        with run.kept_when_interrupted():
            return run.identify()

    with threadpool_limits(1, user_api="blas"):
        return on_workers(planned, place, out, resume, console, work)


def workplace_for(planned: Run, workers: int | None, scheduler: str | None, memory_limit: str | None,
                  store: str | None) -> Workplace:
    """Where the tasks of a run are done; without a word of the user a small run stays in this process, as the start
    of workers takes longer than they save, with a second thread where there is a second core."""
    if workers is None and scheduler is None and memory_limit is None and not planned.worth_workers:
        return Workplace(0, threads=min(2, default_workers()), store=store)
    return Workplace(workers, scheduler, memory_limit, store)


def on_workers(planned: Run, place: Workplace, out: str | Path, resume: bool, console: Console,
               work: Callable[[TaskRunner], dict]) -> dict:
    """``work(runner)`` in the claimed RUN folder with the images taken in; or the result of an earlier process."""
    with planned.claim(resume):
        large = resume and planned.worth_scanning_by_workers
        done = earlier_result(planned, console) if resume and not large else None
        if done is not None:
            return done
        with place.opened(out, planned.to_see, preload=("idic.run.prepared.tasks",)) as runner:
            done = earlier_result(planned, console, runner) if large else None
            if done is not None:
                return done
            console.stage("reading images")
            planned.ingest(runner, lambda done, total: console.tasks("ingest", done, total))
            return work(runner)


def earlier_result(planned: Run, console: Console, runner: TaskRunner | None = None) -> dict | None:
    """Look through an earlier run; its result, where nothing remains to be done; runner : None: in this process."""
    for text in planned.recover(runner or SerialRunner()):
        console.stage(text)
    return planned.finished_result()


def identify_experiment(path: str | Path | Sequence[str | Path], out: str | Path, *, resume: bool = False,
                        workers: int = 0, sensitivity: str = "auto",
                        overrides: Mapping[str, Any] | None = None) -> dict:
    """Identify the parameters of an experiment; the same RUN folder as ``idic identify``.

    Linear algebra runs in one thread meanwhile, as in ``idic identify``: the bits are the same.

    Parameters
    ----------
    path : experiment folder or experiment.toml; a list of several: materials of the same name are shared
    out : RUN folder, new unless `resume`
    workers : 0 runs everything in this process, otherwise so many Dask processes (then call it from a file whose
        code is under ``if __name__ == "__main__":``)
    sensitivity : "direct", "perturbed" or "auto"
    overrides : dotted keys as on the command line, e.g. ``{"options.max_iterations": 10}``

    Returns
    -------
    The content of ``RUN/result.json``.

    Raises
    ------
    InputError
        If anything in the input is not what was expected.
    """
    return _identify(lambda: open_cluster(workers), path, out, resume, sensitivity, dict(overrides or {}))


def identify_on(runner: TaskRunner, path: str | Path, out: str | Path, *, resume: bool = False,
                sensitivity: str = "auto", overrides: Mapping[str, Any] | None = None,
                say: Callable[[str], None] = lambda text: None,
                tasks: Callable[[str, int, int], None] = lambda what, done, total: None) -> dict:
    """`identify_experiment` on running workers.

    say : called with every line for the log; tasks : with the progress (what, done, total) of every fan-out
    """
    return _identify(lambda: nullcontext(runner), path, out, resume, sensitivity, dict(overrides or {}), say, tasks)


def plan_run(paths: Sequence[str | Path], out: str | Path, overrides: Mapping[str, Any],
             say: Callable[[str], None] = lambda text: None) -> Run:
    """The run of one experiment, or of several with shared materials; everything is read, nothing written.

    say : called with the progress of what comes first: the choice of knots of free curves

    Raises
    ------
    InputError
        If anything in the input is not what was expected.
    """
    paths, out = [os.path.abspath(path) for path in paths], os.path.abspath(out)  # workers have folders of their own
    if not paths:
        raise InputError("no experiment", expected="an experiment folder, or several", found="none",
                         remedy="name the folder that holds experiment.toml")
    if len(paths) == 1:
        run = SingleRun(RunStore(out), paths[0], dict(overrides))
        if not by_evidence(run.experiment):
            return run
        from idic.run.knots import with_chosen_knots  # here: most runs begin sooner without

        return with_chosen_knots(run, say)
    from idic.run.knots import refuse_evidence
    from idic.run.joint_run import JointRun

    joint = JointRun.planned(paths, out, dict(overrides))
    refuse_evidence(part.experiment for part in joint.parts.values())
    return joint  # type: ignore[return-value]


def _identify(open_runner, path, out, resume, sensitivity, overrides, say=lambda text: None, tasks=None) -> dict:
    """Both functions above: the lines of the console go to `say`."""
    began = time.perf_counter()
    console = Console(say, tasks or Console.tasks, log_progress(say), said=say)
    planned = plan_run([path] if isinstance(path, (str, Path)) else list(path), out, overrides, say)
    planned.check(sensitivity)
    with threadpool_limits(1, user_api="blas"), planned.claim(resume), open_runner() as runner:
        done = earlier_result(planned, console, runner) if resume else None
        if done is not None:
            return done
        planned.ingest(runner)
        result = OpenRun(planned, runner, sensitivity, Timing(), began, console).identify()
        say(result["status"])
        return result
