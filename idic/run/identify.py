"""The identification into a RUN folder: one function for the command, flows, notebooks, batches and studies.

    >>> from idic.run import identify_run
    >>> result = identify_run("my-test", "my-run")
    >>> result["status"], len(result["parameters"]["BODY.E"]["ci95"])
    ('converged', 2)
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from typing import Any

from threadpoolctl import threadpool_limits

from idic.identification import LoopState, StageHook, run_loop
from idic.run.orchestrator import DIRECT, Command, Console, Hooks, Orchestrator
from idic.run.points import RunPoints
from idic.run.prepared.session import Timing
from idic.run.runs import Folders, Run
from idic.run.store.arrays import leave_stuck_io
from idic.run.warm_up import compile_image_kernels, compile_stress_kernel
from idic.run.workers.runner import SerialRunner, TaskRunner
from idic.run.workers.workplace import IN_PROCESS, Workplace


def identify_run(experiments: Folders, out: str | os.PathLike, *, resume: bool = False,
                 overrides: Mapping[str, Any] | None = None, sensitivity: str = "auto", pause_after: int | None = None,
                 workplace: Workplace = IN_PROCESS, console: Console | None = None,
                 orchestrator: Orchestrator = DIRECT) -> dict:
    """Identify the parameters of one experiment, or of several with shared materials.

    Linear algebra runs in one thread meanwhile: the bits depend neither on the workers nor on the orchestrator.

    Parameters
    ----------
    experiments : folder or experiment.toml, or a list of them: materials of the same name are shared
    out : the RUN folder, new unless `resume`
    resume : resume an interrupted run in `out`
    overrides : dotted keys as of ``--set``: ``{"options.max_iterations": 10}``
    sensitivity : "direct", "perturbed" or "auto"
    pause_after : stage of the schedule (1: the first) after which the run pauses, to be resumed
    workplace : where its tasks run; of more than this process only under ``if __name__ == "__main__":``
    console : where progress goes
    orchestrator : who conducts it, e.g. a Prefect flow (`idic.flow`)

    Returns
    -------
    The content of ``RUN/result.json``, and the key "paused_after_stage" where the run pauses.

    Raises
    ------
    InputError
        If anything in the input is not what was expected; nothing has been written then.
    """
    began, console = time.perf_counter(), console or Console()
    run = Run.planned(experiments, out, dict(overrides or {}), console.stage)
    run.check(sensitivity)
    run.check_pause(pause_after)
    if workplace.is_here:
        run.refuse_hopeless()
    workplace = workplace.worthwhile(run.worth_workers)
    workplace.check(out, run.to_see, console.stage)
    with orchestrator.opened(), threadpool_limits(1, user_api="blas"), run.claim(resume):
        large = resume and run.worth_scanning_by_workers
        earlier = _earlier_result(run, console, SerialRunner()) if resume and not large else None
        if earlier is not None:
            return earlier
        with workplace.opened(out, run.to_see, ("idic.run.prepared.tasks",), console.remark) as runner:
            earlier = _earlier_result(run, console, runner) if large else None
            if earlier is not None:
                return earlier
            console.stage("reading images")
            run.ingest(runner, lambda count, total: console.tasks("ingest", count, total))
            compiled = runner.background(compile_image_kernels, run.first_job, "compile")
            runner.background(compile_stress_kernel, None, "compile-stress")
            work = _Work(run, sensitivity, console, began, compiled, pause_after)
            command = Command("identify", "the identification", {
                "experiments": [experiment.path for experiment in run.to_see], "out": str(out),
                "sensitivity": sensitivity, "workers": runner.workers, "pause_after": pause_after})
            return orchestrator.conduct(command, runner, console, work.identify)


def _earlier_result(run: Run, console: Console, runner: TaskRunner) -> dict | None:
    """Look through an earlier run; its result, where nothing remains to be done."""
    for text in run.recover(runner):
        console.stage(text)
    return run.finished_result()


@dataclass(frozen=True)
class _Work:
    """The stages of a claimed run whose images are in its folder.

    began : `time.perf_counter` at its start; compiled : waits for the image kernels; pause_after : as of `identify_run`
    """

    run: Run
    sensitivity: str
    console: Console
    began: float
    compiled: Callable[[], None]
    pause_after: int | None = None
    timing: Timing = field(default_factory=Timing)

    def identify(self, hooks: Hooks) -> dict:
        """Prepare, iterate, write; what an earlier process has finished is not repeated."""
        with self._written_when_interrupted():
            earlier = self.run.finished_result()
            if earlier is not None:
                return earlier
            if not self.run.prepared:
                free_dic = ": noise and motion by a free FE-DIC" if self.run.measures else ""
                self.console.stage(f"preparation{free_dic}")
                hooks.stage("prepare", self.run.prepare, hooks.runner)
            points = self._points(hooks.runner)

            def progress(state: LoopState) -> None:
                self.console.iteration(state)
                hooks.watch(points, state)

            self.console.stage("identification")
            state = run_loop(points, _with_kernels(hooks.stage, self.compiled), progress, self.pause_after)
            return hooks.stage("postprocess", self._written, points, state)

    def _points(self, runner: TaskRunner) -> RunPoints:
        return self.run.open_points(runner, self.sensitivity, self.timing, self.console.tasks, self.console.remark)

    def _written(self, points: RunPoints, state: LoopState) -> dict:
        """The result of the loop's last state; status "interrupted" where the run pauses."""
        self.console.stage("residual maps and result")
        if not state.running:
            return points.postprocess(state, self.began)
        result = points.postprocess(replace(state, status="interrupted"), self.began)
        return result | {"paused_after_stage": self.pause_after}

    @contextmanager
    def _written_when_interrupted(self) -> Iterator[None]:
        """On Ctrl-C, or a request to end, the accepted point becomes a result with the status "interrupted"."""
        try:
            yield
        except Exception:
            raise
        except BaseException:  # KeyboardInterrupt; Prefect raises one of its own
            with suppress(Exception):  # a failure here must not hide the interruption; --resume finds everything
                leave_stuck_io()
                self._points(SerialRunner()).write_interrupted(self.began)
            raise


def _with_kernels(stage: StageHook, compiled: Callable[[], None]) -> StageHook:
    """The stage hook that waits for the compiled image kernels before a correlation."""
    def hook(name: str, function: Callable, *arguments: object) -> Any:
        if name.startswith("correlate"):
            compiled()
        return stage(name, function, *arguments)

    return hook
