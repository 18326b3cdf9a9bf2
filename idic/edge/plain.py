"""The main job as one function call, without a Prefect server: for notebooks, scripts and tests.

    >>> import idic
    >>> result = idic.identify_experiment("my-test", "my-run")                      # doctest: +SKIP
    >>> result["parameters"]["SPECIMEN.E"]["value"]                      # doctest: +SKIP
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from contextlib import nullcontext
from pathlib import Path

from idic.edge.config import load_experiment
from idic.edge.dask_executor import open_cluster
from idic.edge.finish import finish
from idic.edge.identification import Timing, checked_sensitivity, identify_plainly, take_up
from idic.edge.prepare import check_before_writing, ingest, prepare
from idic.edge.recovery import finished_result, recover
from idic.edge.runner import TaskRunner
from idic.edge.tasks import DESCRIPTION
from idic.edge.zarr_store import RunStore
from idic.errors import InputError


def identify_experiment(path: str | Path, out: str | Path, *, resume: bool = False, workers: int = 0,
                        sensitivity: str = "auto", overrides: Mapping[str, object] | None = None) -> dict:
    """Identify the parameters of an experiment; the same RUN folder and the same bits as ``idic identify``.

    Parameters
    ----------
    path : experiment folder or experiment.toml
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
                sensitivity: str = "auto", overrides: Mapping[str, object] | None = None,
                say: Callable[[str], None] = lambda text: None,
                tasks: Callable[[str, int, int], None] = lambda what, done, total: None) -> dict:
    """`identify_experiment` on workers that somebody else started; `say` gets what a log should hold, line by line,
    `tasks` the progress (what, done, total) of every fan-out."""
    return _identify(lambda: nullcontext(runner), path, out, resume, sensitivity, dict(overrides or {}), say, tasks)


def _identify(open_runner, path, out, resume, sensitivity, overrides, say=lambda text: None, tasks=None) -> dict:
    began = time.perf_counter()
    experiment, store = load_experiment(path, overrides), RunStore(out)
    if not resume and (store.run / DESCRIPTION).exists():
        raise InputError("this RUN exists already", file=store.run, expected="a new folder, or resume=True",
                         found="an earlier run", remedy="choose another folder, or go on with it: resume=True")
    check_before_writing(experiment)
    checked_sensitivity(sensitivity, experiment)
    with store.claim(experiment.identity, title=experiment.title), open_runner() as runner:
        if resume:
            for text in recover(store, path):
                say(text)
            done = finished_result(store)
            if done is not None:
                return done
        ingest(store, experiment)
        if not (store.run / DESCRIPTION).exists():
            say("preparing")
            prepare(str(store.run), str(path), overrides, runner)
        timing, session = Timing(), take_up(store.run, runner, sensitivity, tasks)
        result = finish(session, identify_plainly(session, timing, say), timing, began)
        say(result["status"])
        return result
