"""The flows as Prefect deployments: parameters that a form can hold, paths on the worker's disk, resumable by default.

The worker imports this module from the installed package; no code travels with a deployment, and none comes from an
experiment folder.
"""

from __future__ import annotations

from pathlib import Path

from prefect import flow
from prefect.states import Completed, Failed, State

from idic.errors import InputError
from idic.inside import refuse_outside_of_data

# a suspended flow run fails after this time; `--resume` continues its RUN folder even then
PAUSE_SECONDS = 30 * 24 * 3600


@flow(name="idic-identify-deployed", persist_result=False)
def identify(experiment: str, out: str, workers: int | None = None, scheduler: str | None = None,
             sensitivity: str = "auto", overrides: dict[str, str] | None = None,
             pause_after: int | None = None) -> State:
    """``idic identify EXPERIMENT --out RUN --resume`` on the worker.

    Paths are the worker's; where the variable IDIC_DATA_ROOT is set there, they must lie below that folder. The run
    fails where the identification did not converge; its results are in `out` nevertheless. Started again after a lost
    worker, it resumes. With `pause_after` it is suspended at the end of that stage of the schedule, so that the worker
    is free, until somebody resumes it in Prefect.
    """
    from prefect.flow_runs import suspend_flow_run

    from idic.run import write_report
    from idic_flows.public import identify as conducted

    source, run = data_path(experiment, "experiment"), data_path(out, "out")
    result = conducted([source], run, resume=True, workers=workers, scheduler=scheduler, sensitivity=sensitivity,
                       overrides=overrides, pause_after=pause_after)
    page = write_report(run)
    if "paused_after_stage" in result:
        suspend_flow_run(timeout=PAUSE_SECONDS)  # ends this process; it begins anew and continues the RUN when resumed
    message = f"{result['status']} after {result['iterations']} iterations: {page}"
    return Completed(message=message) if result["status"] == "converged" else Failed(message=message)


@flow(name="idic-batch-deployed", persist_result=False)
def batch(experiments: list[str], out: str, starts: int | None = None, spread: float = 0.3, seed: int = 0,
          workers: int | None = None, scheduler: str | None = None, sensitivity: str = "auto",
          overrides: dict[str, str] | None = None) -> State:
    """``idic batch FILE_OR_EXPERIMENT... --out DIR --resume`` on the worker; paths and states as of `identify`."""
    from idic.report import batch_headline
    from idic.run import batch_runs
    from idic_flows.public import batch as conducted

    paths, folder = [data_path(path, "experiments") for path in experiments], data_path(out, "out")
    for entry in batch_runs(paths, overrides):  # a list may name any place
        data_path(entry.experiment, "experiments")
    content = conducted(paths, folder, starts=starts, spread=spread, seed=seed, resume=True, workers=workers,
                        scheduler=scheduler, sensitivity=sensitivity, overrides=overrides)
    message = f"{batch_headline(content)} {folder / 'batch.html'}"
    return (Completed if content["converged"] == len(content["runs"]) else Failed)(message=message)


@flow(name="idic-diagnose-deployed", persist_result=False)
def diagnose(run: str, workers: int | None = None, scheduler: str | None = None, quick: bool = False) -> State:
    """``idic diagnose RUN --resume`` on the worker; paths as of `identify`."""
    from idic_flows.public import diagnose as conducted

    folder = data_path(run, "run")
    content = conducted(folder, workers=workers, scheduler=scheduler, resume=True, quick=quick)
    return Completed(message=f"{content['verdict']}: {content['headline']}: {folder / 'diagnosis.html'}")


@flow(name="idic-systematic-deployed", persist_result=False)
def systematic(run: str, bias: bool = True, spread: bool = True, workers: int | None = None,
               scheduler: str | None = None) -> State:
    """``idic systematic RUN`` on the worker; paths as of `identify`."""
    from idic.run import write_report
    from idic_flows.public import systematic as conducted

    folder = data_path(run, "run")
    conducted(folder, bias, spread, workers=workers, scheduler=scheduler)
    return Completed(message=f"{write_report(folder)}")


FLOWS = (identify, batch, diagnose, systematic)


def data_path(text: str, key: str) -> Path:
    """The path a deployment was given, links followed; below IDIC_DATA_ROOT where the worker sets it.

    Raises
    ------
    InputError
        A relative path, which means nothing on the worker, or one outside of the root.
    """
    path = Path(text)
    if not path.is_absolute():
        raise InputError("a relative path", key=key, expected="an absolute path on the worker", found=text,
                         remedy="write the path from the root of the worker's file system")
    return refuse_outside_of_data(path, key)
