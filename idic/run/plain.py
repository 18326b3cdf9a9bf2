"""The main job as one function call, without a Prefect server: for notebooks, scripts and tests.

    >>> import idic
    >>> result = idic.identify_experiment("my-test", "my-run")                      # doctest: +SKIP
    >>> result["parameters"]["SPECIMEN.E"]["value"]                      # doctest: +SKIP
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import Any

from threadpoolctl import threadpool_limits

from idic.errors import InputError
from idic.identify.driver import log_progress, run_loop
from idic.run.joint_run import JointRun
from idic.run.runs import Run, SingleRun
from idic.run.session import Timing
from idic.store.run_store import RunStore
from idic.workers.dask_executor import open_cluster
from idic.workers.runner import TaskRunner


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


def plan_run(paths: Sequence[str | Path], out: str | Path, overrides: Mapping[str, Any]) -> Run:
    """The run of one experiment, or of several with shared materials; everything is read, nothing written.

    Raises
    ------
    InputError
        If anything in the input is not what was expected.
    """
    if not paths:
        raise InputError("no experiment", expected="an experiment folder, or several", found="none",
                         remedy="name the folder that holds experiment.toml")
    if len(paths) == 1:
        return SingleRun(RunStore(out), str(paths[0]), dict(overrides))
    return JointRun.planned(paths, out, dict(overrides))  # type: ignore[return-value]


def _identify(open_runner, path, out, resume, sensitivity, overrides, say=lambda text: None, tasks=None) -> dict:
    began, timing = time.perf_counter(), Timing()
    run = plan_run([path] if isinstance(path, (str, Path)) else list(path), out, overrides)
    run.check(sensitivity)
    with threadpool_limits(1, user_api="blas"), run.claim(resume), open_runner() as runner:
        if resume:
            for text in run.recover():
                say(text)
            done = run.finished_result()
            if done is not None:
                return done
        run.ingest()
        if not run.prepared:
            say("preparing")
            run.prepare(runner)
        points = run.open_points(runner, sensitivity, timing, tasks, say)
        result = points.postprocess(run_loop(points, progress=log_progress(say)), began)
        say(result["status"])
        return result
