"""One of the experiments of a RUN in its folder, from its check to its preparation."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import cached_property

from idic.experiment_file import load_experiment
from idic.identification import checked_sensitivity, needs_free_dic
from idic.model import Experiment
from idic.path_names import refuse_names_that_are_one
from idic.report import expected_cost
from idic.run.prepared.prepare import check_before_writing, ingest, prepare
from idic.run.recovery.recover import finished_result, recover
from idic.run.recovery.scan import BYTES_FOR_WORKERS, stored_bytes
from idic.run.store.camera_groups import refuse_changed_images
from idic.run.store.layout import DESCRIPTION
from idic.run.store.run_store import RunStore
from idic.run.workers.probe import ExperimentToSee
from idic.run.workers.runner import TaskRunner


@dataclass(frozen=True)
class RunPart:
    """An experiment and its folder: RUN itself where it is the only one.

    path : of the experiment; overrides : dotted keys as of ``--set``
    """

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
        checked_sensitivity(sensitivity, self.experiment.model)
        refuse_names_that_are_one(self.experiment.model.parameters, self.store.run)
        refuse_names_that_are_one((channel.column for channel in self.experiment.model.channels), self.store.run)

    def claim(self) -> AbstractContextManager[RunStore]:
        """Lock the folder; see `RunStore.claim`."""
        return self.store.claim(self.experiment.recording.identity, title=self.experiment.title)

    def recover(self, runner: TaskRunner) -> list[str]:
        """Remove damaged data; a line per finding."""
        refuse_changed_images(self.store, self.experiment)
        return recover(self.store, self.path, runner)

    @property
    def worth_scanning_by_workers(self) -> bool:
        return stored_bytes(self.store) > BYTES_FOR_WORKERS

    @property
    def finished(self) -> bool:
        """Whether it has ended and its files are whole."""
        return finished_result(self.store) is not None

    def ingest(self, runner: TaskRunner, progress: Callable[[int, int], None] | None = None) -> None:
        """Copy the images into the folder."""
        ingest(self.store, self.experiment, runner, progress)

    @property
    def prepared(self) -> bool:
        return (self.store.run / DESCRIPTION).exists()

    @property
    def measures(self) -> bool:
        """Whether its preparation makes a free FE-DIC."""
        return needs_free_dic(self.experiment)

    @cached_property
    def cost(self):
        """See `expected_cost`."""
        return expected_cost(self.experiment)

    @property
    def worth_workers(self) -> bool:
        return self.experiment.model.solver is not None or self.cost.worth_workers

    @property
    def to_see(self) -> ExperimentToSee:
        """What every worker must find."""
        solver = self.experiment.model.solver
        program = "" if solver is None else solver.arguments[0]
        return ExperimentToSee(self.path, self.overrides, self.experiment.recording.identity, program)

    def prepare(self, runner: TaskRunner) -> None:
        """Measure noise, weights and starting values; nothing where that is done."""
        if not self.prepared:
            prepare(str(self.store.run), self.path, self.overrides, runner)
