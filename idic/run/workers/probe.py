"""What every worker of an existing cluster must share with the driver: packages, experiments, the RUN folder, rounding.

A job is asked of each worker before a run writes anything. A worker that reads another experiment from the same path,
or writes to another disk, would give a wrong result without an error.
"""

from __future__ import annotations

import hashlib
import os
import platform
import secrets
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

from idic.errors import InputError
from idic.fe import find_program, require_permission
from idic.inside import remove_inside, write_inside

PACKAGES = ("idic", "numpy", "scipy", "numba", "zarr", "dask", "distributed")
ANSWER_SECONDS = 300  # a worker may be busy with a task of somebody else
_VALUES = 257  # of the reference kernel: no multiple of a vector register, so that its last values count too


@dataclass(frozen=True)
class ExperimentToSee:
    """An experiment as the driver read it. identity : of `Experiment.identity`; program : that simulates it, if any"""

    path: str
    overrides: Mapping[str, Any]
    identity: str
    program: str = ""


@dataclass(frozen=True)
class ProbeJob:
    """What a worker is asked. token_file : a file of the driver beside the RUN folder, "" where the disk is not common;
    token :
    what is in it"""

    experiments: tuple[ExperimentToSee, ...]
    token_file: str
    token: str


@dataclass(frozen=True)
class ProbeAnswer:
    """What a worker found. problem : empty, or the first thing that differs, as "expected", "found" and "remedy"."""

    host: str
    versions: tuple[tuple[str, str], ...]
    rounding: str
    problem: tuple[str, str, str] | tuple[()]


def versions_here() -> tuple[tuple[str, str], ...]:
    """Python and the packages that decide a result: (name, version)."""
    return (("python", platform.python_version()), *((name, _version(name)) for name in PACKAGES))


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "not installed"


def rounding_here() -> str:
    """Digest of a reference kernel: elementary functions, a product and a factorisation, to the last bit."""
    from scipy.linalg import lapack

    x = np.linspace(0.1, 3.0, _VALUES)
    matrix = np.exp(-np.subtract.outer(x, x) ** 2) + np.diag(x)
    factors, pivots, _ = lapack.dgetrf(matrix)
    parts = (np.exp(x), np.log(x), np.sin(x), x**0.83, np.tanh(x), matrix @ matrix, factors, pivots)
    return hashlib.sha256(b"".join(np.ascontiguousarray(part).tobytes() for part in parts)).hexdigest()


def probe(job: ProbeJob) -> ProbeAnswer:
    """Answer on a worker (a task)."""
    return ProbeAnswer(platform.node(), versions_here(), rounding_here(), _problem(job))


def _problem(job: ProbeJob) -> tuple[str, str, str] | tuple[()]:
    from idic.experiment_file import load_experiment

    for experiment in job.experiments:
        if experiment.program:
            try:
                require_permission([experiment.program], experiment.path)
                find_program(experiment.program, experiment.path)
            except InputError as problem:
                return problem.expected, problem.found, problem.remedy
    if not job.token_file:
        return ()
    try:
        token = Path(job.token_file).read_text(encoding="ascii")
    except OSError as problem:
        token = problem.strerror or "unreadable"
    folder = os.path.dirname(job.token_file)
    if token != job.token:
        return (f"the folder {folder} of the driver", f"another folder or none ({token[:60]})",
                "put RUN on a file system that all workers mount at the same path, or send the files: --store URL "
                "(docs/scale.md)")
    if not os.access(folder, os.W_OK):
        return f"write access to {folder}", "none", "start the worker as a user who may write there"
    for experiment in job.experiments:
        try:
            worker_experiment = load_experiment(experiment.path, dict(experiment.overrides))
        except InputError as problem:
            return (f"the experiment {experiment.path}", str(problem),
                    "put the experiment on a file system that all workers mount at the same path; for your own "
                    "laws set the variable IDIC_LAWS on the workers")
        if experiment.identity != worker_experiment.recording.identity:
            return (f"the experiment {experiment.path} as the driver read it", "another experiment at this path",
                    "put the experiment on a file system that all workers mount at the same path")
    return ()


def check_workers(client, experiments: Sequence[ExperimentToSee], run: Path | str | None,
                  say: Callable[[str], None] = lambda text: None) -> None:
    """Ask every worker of an existing cluster; nothing stays on any disk.

    Parameters
    ----------
    client : distributed.Client
    experiments : what the workers will read
    run : the RUN folder, which need not exist yet; None: the disk is not common
    say : called with a note where workers round differently: results agree within rounding, not to the last bit

    Raises
    ------
    InputError
        A worker has other packages, sees another experiment or another disk, or does not answer; its address is named.
    """
    token = secrets.token_hex(16)
    with nullcontext("") if run is None else _token_file(Path(run).absolute(), token) as file:
        job = ProbeJob(tuple(experiments), file, token)
        answers = {worker: _answer(client, worker, job) for worker in client.nthreads()}
    driver_versions, rounding = dict(versions_here()), rounding_here()
    for worker, answer in answers.items():
        for package, number in answer.versions:
            if number != driver_versions[package]:
                raise _refused(worker, answer.host, f"{package} {driver_versions[package]}, as here",
                               f"{package} {number}",
                               "install the same packages on driver and workers (pip freeze)")
        if answer.problem:
            raise _refused(worker, answer.host, *answer.problem)
    hosts = sorted({answer.host for answer in answers.values() if answer.rounding != rounding})
    if hosts:
        say(f"{', '.join(hosts)}: another processor or library rounds differently. Values agree within rounding; a "
            f"run "
            "repeated on other machines may differ in its last digits")


@contextmanager
def _token_file(run: Path, token: str) -> Iterator[str]:
    """A file with the token in the RUN folder or the nearest folder above it, for the length of a ``with`` block."""
    folder = next(parent for parent in (run, *run.parents) if parent.is_dir())
    file = folder / f".idic-probe-{secrets.token_hex(8)}"
    write_inside(folder, file.name, token)
    try:
        yield str(file)
    finally:
        remove_inside(folder, file.name)


def _answer(client, worker: str, job: ProbeJob) -> ProbeAnswer:
    future = client.submit(probe, job, workers=[worker], key=f"probe-{job.token[:8]}-{worker}", pure=False)
    try:
        return future.result(timeout=ANSWER_SECONDS)
    except TimeoutError:
        raise _refused(worker, "", f"an answer within {ANSWER_SECONDS} s", "none",
                       "end the worker, or wait until it is free") from None
    except (ImportError, AttributeError) as problem:
        raise _refused(worker, "", "the idic of the driver", f"{type(problem).__name__}: {problem}",
                       "install the same idic on driver and workers") from None


def _refused(worker: str, host: str, expected: str, found: str, remedy: str) -> InputError:
    return InputError(f"the worker {worker}{f' on {host}' if host else ''} cannot work on this run", key="--scheduler",
                      expected=expected, found=found, remedy=remedy)
