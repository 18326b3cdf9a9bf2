"""Who conducts a command: this process alone, or a flow that shows its stages and jobs.

A command checks its input, opens its workers, and hands its work to an `Orchestrator`. The work gets a runner and a
stage hook from it; everything else is the same with every orchestrator, and so are the bits.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from typing import Any, Protocol, TypeVar

from idic.identification import LoopState, StageHook, log_progress
from idic.run.points import RunPoints
from idic.run.workers.runner import TaskRunner

T = TypeVar("T")


def _ignore(*_: object) -> None:
    """The callback of a console that shows nothing."""


def _called(_: str, function: Callable, *arguments: object) -> Any:
    """The stage hook that shows nothing."""
    return function(*arguments)


@dataclass(frozen=True)
class Console:
    """Where progress goes; every call may be ignored.

    stage(text), tasks(label, count, total), iteration(state), remark(line of the log),
    dashboards(address of Prefect, of Dask, password)
    """

    stage: Callable[[str], None] = _ignore
    tasks: Callable[[str, int, int], None] = _ignore
    iteration: Callable[[LoopState], None] = _ignore
    dashboards: Callable[[str | None, str | None, str | None], None] = _ignore
    remark: Callable[[str], None] = _ignore

    @classmethod
    def of_lines(cls, say: Callable[[str], None], tasks: Callable[[str, int, int], None] = _ignore) -> Console:
        """Everything but the tasks as lines: stages, evaluated points, remarks."""
        return cls(say, tasks, log_progress(say), remark=say)


@dataclass(frozen=True)
class Command:
    """What an orchestrator shows of a command.

    name : "identify"; subject : what it makes, "the identification"; parameters : by their names; several_runs :
    whether its jobs belong to several RUN folders
    """

    name: str
    subject: str
    parameters: Mapping[str, Any] = field(default_factory=dict)
    several_runs: bool = False


@dataclass(frozen=True)
class Hooks:
    """What the work of a command gets from its orchestrator.

    runner : does its jobs; stage : makes its stages; watch(points, state) : sees the states of an identification
    """

    runner: TaskRunner
    stage: StageHook = _called
    watch: Callable[[RunPoints, LoopState], None] = _ignore


class Orchestrator(Protocol):
    """Conducts a command.

    opened : for the length of the command, once its input is checked
    conduct : ``work(hooks)`` with the open workers; the work may be begun twice, and then resumes
    """

    def opened(self) -> AbstractContextManager[None]: ...
    def conduct(self, command: Command, runner: TaskRunner, console: Console, work: Callable[[Hooks], T]) -> T: ...


class Direct:
    """No flow, no server: the work is called. See `Orchestrator`."""

    def opened(self) -> AbstractContextManager[None]:
        return nullcontext()

    def conduct(self, command: Command, runner: TaskRunner, console: Console, work: Callable[[Hooks], T]) -> T:
        console.dashboards(None, runner.dashboard, None)
        return work(Hooks(runner))


DIRECT = Direct()
