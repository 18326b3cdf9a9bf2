"""The flows as Prefect deployments: parameters that a form can hold, paths on the worker's disk, resumable by default.

The worker imports this module from the installed package; no code travels with a deployment, and none comes from an
experiment folder.
"""

from __future__ import annotations

import os
from pathlib import Path

from prefect import flow
from prefect.states import Completed, Failed, State

from idic.errors import InputError

ROOT_VARIABLE = "IDIC_DATA_ROOT"


@flow(name="idic-identify-deployed", persist_result=False)
def identify(experiment: str, out: str, workers: int | None = None, scheduler: str | None = None,
             sensitivity: str = "auto", overrides: dict[str, str] | None = None) -> State:
    """``idic identify EXPERIMENT --out RUN --resume`` on the worker.

    Paths are the worker's; where the variable IDIC_DATA_ROOT is set there, they must lie below that folder. The run
    fails where the identification did not converge; its results are in `out` all the same. Started again after a lost
    worker, it resumes where it stood.
    """
    from idic.run.reporting.write import write_report
    from idic_flows.identify import run_identification

    source, run = data_path(experiment, "experiment"), data_path(out, "out")
    result = run_identification([source], run, resume=True, workers=workers, scheduler=scheduler,
                                sensitivity=sensitivity, overrides=overrides)
    page = write_report(run)
    message = f"{result['status']} after {result['iterations']} iterations: {page}"
    return Completed(message=message) if result["status"] == "converged" else Failed(message=message)


@flow(name="idic-batch-deployed", persist_result=False)
def batch(experiments: list[str], out: str, starts: int | None = None, spread: float = 0.3, seed: int = 0,
          workers: int | None = None, scheduler: str | None = None, sensitivity: str = "auto",
          overrides: dict[str, str] | None = None) -> State:
    """``idic batch FILE_OR_EXPERIMENT... --out DIR --resume`` on the worker; paths and states as of `identify`."""
    from idic.report.batch_page import headline
    from idic_flows.batch import run_batch

    paths, folder = [data_path(path, "experiments") for path in experiments], data_path(out, "out")
    content = run_batch(paths, folder, starts=starts, spread=spread, seed=seed, resume=True, workers=workers,
                        scheduler=scheduler, sensitivity=sensitivity, overrides=overrides)
    message = f"{headline(content)} {folder / 'batch.html'}"
    return (Completed if content["converged"] == len(content["runs"]) else Failed)(message=message)


def data_path(text: str, key: str) -> Path:
    """The path a deployment was given, links followed; below IDIC_DATA_ROOT where the worker sets it.

    Raises
    ------
    InputError
        A relative path, which means nothing on the worker, or one outside of the root.
    """
    path, root = Path(text), os.environ.get(ROOT_VARIABLE)
    if not path.is_absolute():
        raise InputError("a relative path", key=key, expected="an absolute path on the worker", found=text,
                         remedy="write the path from the root of the worker's file system")
    resolved = path.resolve()
    if root and not resolved.is_relative_to(Path(root).resolve()):
        raise InputError("a path outside of the data of this worker", key=key, expected=f"a path below {root}",
                         found=text, remedy=f"move the data there, or start the worker with another {ROOT_VARIABLE}")
    return resolved
