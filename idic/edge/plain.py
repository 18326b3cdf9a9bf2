"""The main job as one function call, without a Prefect server: for notebooks, scripts and tests.

    >>> import idic
    >>> result = idic.identify_experiment("my-test", "my-run")                      # doctest: +SKIP
    >>> result["parameters"]["SPECIMEN.E"]["value"]                      # doctest: +SKIP
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from pathlib import Path

from idic.edge.config import load_experiment
from idic.edge.dask_executor import open_cluster
from idic.edge.finish import finish
from idic.edge.identification import Timing, identify_plainly, take_up
from idic.edge.prepare import check_before_writing, ingest, prepare
from idic.edge.recovery import finished_result, recover
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
    began, overrides = time.perf_counter(), dict(overrides or {})
    experiment, store = load_experiment(path, overrides), RunStore(out)
    if not resume and (store.run / DESCRIPTION).exists():
        raise InputError("this RUN exists already", file=store.run, expected="a new folder, or resume=True",
                         found="an earlier run", remedy="choose another folder, or go on with it: resume=True")
    check_before_writing(experiment)
    with store.claim(experiment.identity, title=experiment.title), open_cluster(workers) as runner:
        if resume:
            recover(store, path)
            done = finished_result(store)
            if done is not None:
                return done
        ingest(store, experiment)
        if not (store.run / DESCRIPTION).exists():
            prepare(str(store.run), str(path), overrides, runner)
        timing, session = Timing(), take_up(store.run, runner, sensitivity)
        return finish(session, identify_plainly(session, timing), timing, began)
