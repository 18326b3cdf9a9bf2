"""The stages of an identification in a RUN folder, of one experiment or of several together.

    plan_run → check, claim → [recover] → ingest → prepare → open_points → run_loop → postprocess

`SingleRun` is here, `JointRun` in ``joint_run.py``; `idic.run.identify_run` uses either of them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Protocol

from idic.errors import InputError
from idic.experiment_file import load_experiment
from idic.identification import LoopState, PointStore, checked_sensitivity, needs_free_dic, resolve_stages
from idic.model import Experiment
from idic.path_names import refuse_names_that_are_one
from idic.report import expected_cost
from idic.run.points import RunPoints
from idic.run.prepared.prepare import check_before_writing, ingest, prepare
from idic.run.prepared.session import Timing, open_session
from idic.run.recovery.recover import finished_result, recover
from idic.run.recovery.scan import BYTES_FOR_WORKERS, stored_bytes
from idic.run.store.camera_groups import refuse_changed_images
from idic.run.store.layout import DESCRIPTION
from idic.run.store.run_store import RunStore
from idic.run.workers.probe import ExperimentToSee
from idic.run.workers.runner import TaskRunner

Progress = Callable[[str, int, int], None]


class Points(PointStore, Protocol):
    """The points of a prepared run, and the files written at its end.

    folders : of its experiments, in their order
    postprocess : residual maps and result; write_interrupted : the accepted point as a result, nothing where there is
    none
    """

    @property
    def folders(self) -> Sequence[Path]: ...
    def postprocess(self, state: LoopState, began: float) -> dict: ...
    def write_interrupted(self, began: float) -> dict | None: ...


class Run(Protocol):
    """A RUN folder and what is identified in it.

    prepared : whether `prepare` is behind it; measures : whether it begins with a free FE-DIC;
    worth_workers : whether worker processes save more time than their start takes;
    first_job : (folder, experiment, overrides) for the compilation of the image kernels;
    worth_scanning_by_workers : whether it stores so much that they read it before it is resumed;
    to_see : the experiments that every worker must find; n_stages : stages of the schedule.
    """

    @property
    def store(self) -> RunStore: ...
    @property
    def prepared(self) -> bool: ...
    @property
    def measures(self) -> bool: ...
    @property
    def worth_workers(self) -> bool: ...
    @property
    def first_job(self) -> tuple[str, str, dict]: ...
    @property
    def to_see(self) -> tuple[ExperimentToSee, ...]: ...
    @property
    def n_stages(self) -> int: ...
    def check(self, sensitivity: str) -> None: ...
    def claim(self, resume: bool): ...
    def recover(self, runner: TaskRunner) -> list[str]: ...
    @property
    def worth_scanning_by_workers(self) -> bool: ...
    def finished_result(self) -> dict | None: ...
    def ingest(self, runner: TaskRunner, progress: Callable[[int, int], None] | None = None) -> None: ...
    def prepare(self, runner: TaskRunner) -> None: ...
    def open_points(self, runner: TaskRunner, sensitivity: str, timing: Timing, tasks: Progress | None = None,
                    say: Callable[[str], None] | None = None) -> Points: ...


@dataclass(frozen=True)
class SingleRun:
    """One experiment in one RUN folder. See `Run`."""

    store: RunStore
    path: str
    overrides: dict

    def __post_init__(self):
        _ = self.experiment  # read now: an error in it ends the command

    @cached_property
    def experiment(self) -> Experiment:
        return load_experiment(self.path, self.overrides)

    def check(self, sensitivity: str) -> None:
        """Everything that can be wrong before something is written."""
        check_before_writing(self.experiment)
        checked_sensitivity(sensitivity, self.experiment)
        refuse_names_that_are_one(self.experiment.parameters, self.store.run)
        refuse_names_that_are_one((channel.column for channel in self.experiment.channels), self.store.run)

    @contextmanager
    def claim(self, resume: bool) -> Iterator[None]:
        """Lock the folder; an existing run is resumed with --resume only."""
        if not resume and self.prepared:
            raise earlier_run(self.store.run)
        with self.store.claim(self.experiment.identity, title=self.experiment.title):
            yield

    def recover(self, runner: TaskRunner) -> list[str]:
        refuse_changed_images(self.store, self.experiment)
        return recover(self.store, self.path, runner)

    @property
    def worth_scanning_by_workers(self) -> bool:
        return stored_bytes(self.store) > BYTES_FOR_WORKERS

    def finished_result(self) -> dict | None:
        return finished_result(self.store)

    def ingest(self, runner: TaskRunner, progress: Callable[[int, int], None] | None = None) -> None:
        ingest(self.store, self.experiment, runner, progress)

    @property
    def prepared(self) -> bool:
        return (self.store.run / DESCRIPTION).exists()

    @property
    def measures(self) -> bool:
        return needs_free_dic(self.experiment)

    @property
    def worth_workers(self) -> bool:
        return self.experiment.solver is not None or expected_cost(self.experiment).worth_workers

    @property
    def first_job(self) -> tuple[str, str, dict]:
        return str(self.store.run), self.path, self.overrides

    @property
    def to_see(self) -> tuple[ExperimentToSee, ...]:
        solver = self.experiment.solver
        program = "" if solver is None else solver.arguments[0]
        return (ExperimentToSee(self.path, self.overrides, self.experiment.identity, program),)

    @property
    def n_stages(self) -> int:
        return len(resolve_stages(self.experiment))

    def prepare(self, runner: TaskRunner) -> None:
        prepare(str(self.store.run), self.path, self.overrides, runner)

    def open_points(self, runner: TaskRunner, sensitivity: str, timing: Timing, tasks: Progress | None = None,
                    say: Callable[[str], None] | None = None) -> RunPoints:
        return RunPoints(open_session(self.store.run, runner, sensitivity, tasks, say), timing)


def check_pause(run: Run, pause_after: int | None) -> None:
    """Refuse a pause after a stage that does not exist or is the last one (`InputError`)."""
    if pause_after is None or 1 <= pause_after < run.n_stages:
        return
    n = run.n_stages
    raise InputError("no stage to pause after", key="--pause-after", found=str(pause_after),
                     expected="a schedule of several stages ([[stage]])" if n == 1 else
                     f"a stage from 1 to {n - 1}: the schedule has {n}",
                     remedy="choose another number, or leave it out")


def earlier_run(folder: Path) -> InputError:
    """The refusal to write over a run."""
    return InputError("this RUN exists already", file=folder, expected="a new folder, or --resume",
                      found="an earlier run", remedy="add --resume to continue it, or choose another --out")

