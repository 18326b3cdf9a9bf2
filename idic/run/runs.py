"""What the commands do with a RUN, whether one experiment is identified in it or several together.

    plan_run → check, claim → [recover] → ingest → prepare → take_up → first or last state → simulate, correlate,
    update until the state says so → finish

`SingleRun` is here, `JointRun` in ``joint_run.py``; the Prefect flow and the plain loop drive either of them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Protocol

from idic.errors import InputError
from idic.experiment_file.load import load_experiment
from idic.identify.loop import trial_states
from idic.identify.step.state import Evaluation, LoopState
from idic.model.experiment import Experiment
from idic.run.identification import (Session, Timing, checked_sensitivity, correlate_point, describe_evaluation,
                                     first_state, load_state, simulate_trials, take_up, update)
from idic.run.postprocess import finish, write_interrupted
from idic.run.prepare import check_before_writing, ingest, needs_free_dic, prepare
from idic.run.recovery import finished_result, recover
from idic.run.search import start_values
from idic.store.layout import DESCRIPTION
from idic.store.run_store import RunStore
from idic.workers.runner import TaskRunner

Progress = Callable[[str, int, int], None]


class Steps(Protocol):
    """The steps of an identification that has been prepared; all they leave is in the RUN folder.

    simulate : all trials of a state, why each failed or ""; correlate : those that arrived, an evaluation of each;
    update : what they lead to
    """

    def state(self) -> LoopState: ...
    def simulate(self, state: LoopState, timing: Timing) -> list[str]: ...
    def correlate(self, state: LoopState, failed: Sequence[str], timing: Timing) -> list[Evaluation]: ...
    def update(self, state: LoopState, evaluations: Sequence[Evaluation]) -> LoopState: ...
    def finish(self, state: LoopState, timing: Timing, began: float) -> dict: ...
    def write_interrupted(self, timing: Timing, began: float) -> None: ...


class Run(Protocol):
    """A RUN folder and what is identified in it.

    prepared : whether `prepare` is behind it; measures : whether it begins with a free FE-DIC;
    first_job : (folder, experiment, overrides) for the compilation of the image kernels.
    """

    store: RunStore
    prepared: bool
    measures: bool
    first_job: tuple[str, str, dict]

    def check(self, sensitivity: str) -> None: ...
    def claim(self, resume: bool): ...
    def recover(self) -> list[str]: ...
    def finished_result(self) -> dict | None: ...
    def ingest(self, progress: Callable[[int, int], None] | None = None) -> None: ...
    def prepare(self, runner: TaskRunner) -> None: ...
    def take_up(self, runner: TaskRunner, sensitivity: str, tasks: Progress | None = None,
                say: Callable[[str], None] | None = None) -> Steps: ...


@dataclass(frozen=True)
class SingleRun:
    """One experiment in one RUN folder. See `Run`."""

    store: RunStore
    path: str
    overrides: dict

    def __post_init__(self):
        _ = self.experiment  # whatever is wrong with it is said now

    @cached_property
    def experiment(self) -> Experiment:
        return load_experiment(self.path, self.overrides)

    def check(self, sensitivity: str) -> None:
        """Everything that can be wrong before something is written."""
        check_before_writing(self.experiment)
        checked_sensitivity(sensitivity, self.experiment)

    @contextmanager
    def claim(self, resume: bool) -> Iterator[None]:
        """Lock the folder; an existing run is only taken up with --resume."""
        if not resume and self.prepared:
            raise earlier_run(self.store.run)
        with self.store.claim(self.experiment.identity, title=self.experiment.title):
            yield

    def recover(self) -> list[str]:
        return recover(self.store, self.path)

    def finished_result(self) -> dict | None:
        return finished_result(self.store)

    def ingest(self, progress=None) -> None:
        ingest(self.store, self.experiment, progress)

    @property
    def prepared(self) -> bool:
        return (self.store.run / DESCRIPTION).exists()

    @property
    def measures(self) -> bool:
        return needs_free_dic(self.experiment)

    @property
    def first_job(self) -> tuple[str, str, dict]:
        return str(self.store.run), self.path, self.overrides

    def prepare(self, runner: TaskRunner) -> None:
        prepare(str(self.store.run), self.path, self.overrides, runner)

    def take_up(self, runner: TaskRunner, sensitivity: str, tasks: Progress | None = None,
                say: Callable[[str], None] | None = None) -> SingleSteps:
        return SingleSteps(take_up(self.store.run, runner, sensitivity, tasks, say))


@dataclass(frozen=True)
class SingleSteps:
    """The steps of `identification` on one session. See `Steps`."""

    session: Session

    def state(self) -> LoopState:
        state = load_state(self.session)
        return first_state(self.session, start_values(self.session)) if state is None else state

    def simulate(self, state: LoopState, timing: Timing) -> list[str]:
        return simulate_trials([(self.session, trial) for trial in trial_states(state)], timing)

    def correlate(self, state: LoopState, failed: Sequence[str], timing: Timing) -> list[Evaluation]:
        return [Evaluation(trial.evaluations, None, None, why) if why else correlate_point(self.session, trial, timing)
                for trial, why in zip(trial_states(state), failed, strict=True)]

    def update(self, state: LoopState, evaluations: Sequence[Evaluation]) -> LoopState:
        return update(self.session, state, evaluations)

    def finish(self, state: LoopState, timing: Timing, began: float) -> dict:
        return finish(self.session, state, timing, began)

    def write_interrupted(self, timing: Timing, began: float) -> None:
        write_interrupted(self.session, timing, began)


def earlier_run(folder: Path) -> InputError:
    """The refusal to write over a run."""
    return InputError("this RUN exists already", file=folder, expected="a new folder, or --resume",
                      found="an earlier run", remedy="add --resume to go on with it, or choose another --out")


def identify_by_steps(steps: Steps, timing: Timing, say: Callable[[str], None] = lambda text: None) -> LoopState:
    """The whole loop in this process; `say` gets a line per evaluated point."""
    state = steps.state()
    while state.running:
        known, failed = len(state.history), steps.simulate(state, timing)
        state = steps.update(state, steps.correlate(state, failed, timing))
        for entry in state.history[known:]:
            say(describe_evaluation(entry))
    return state
