"""Prefect as the orchestrator of a command: a flow run around its work, a task run per stage and job.

Inside a stage the simulations and the chunks of frames are Dask tasks with names such as ``simulate-it003-SPECIMEN.E``,
which Prefect shows as task runs (`idic_flows.shown_runner`). A killed command resumes from its folder alone; Prefect
holds none of its state.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from inspect import Parameter, Signature
from typing import Any, TypeVar

# before Prefect: it reads the environment
from idic_flows.settings import connected, flow_server, server_is_gone, show_dashboards
from idic_flows.shown_runner import ShownRunner
from idic_flows.stages import Publication, run_stage

from idic.run import Command, Console, Hooks, PrefectServer, TaskRunner

T = TypeVar("T")


class PrefectFlow:
    """See `idic.run.Orchestrator`. Where the server is lost, the work goes on without it."""

    def __init__(self) -> None:
        self._server: PrefectServer | None = None

    @contextmanager
    def opened(self) -> Iterator[None]:
        with flow_server() as self._server:
            yield

    def conduct(self, command: Command, runner: TaskRunner, console: Console, work: Callable[[Hooks], T]) -> T:
        console.stage("starting Prefect")
        with connected(self._server):
            show_dashboards(console.dashboards, self._server, runner.dashboard)
            hooks = Hooks(ShownRunner(runner, command.several_runs), run_stage, Publication())
            try:
                return _flow_of(command, lambda: work(hooks))(**command.parameters)
            except Exception as problem:
                if not server_is_gone(problem):
                    raise
                console.stage(f"the Prefect server no longer answers: {command.subject} continues without it")
                return work(Hooks(runner))


def _flow_of(command: Command, work: Callable[[], Any]) -> Callable[..., Any]:
    """The flow; made here because importing Prefect takes seconds. Its parameters are what Prefect's pages show."""
    from prefect import flow

    def command_run(**_: object) -> Any:
        return work()

    command_run.__signature__ = Signature(  # type: ignore[attr-defined]
        [Parameter(name, Parameter.KEYWORD_ONLY) for name in command.parameters])
    return flow(command_run, name=f"idic-{command.name}", flow_run_name=f"{command.name}-{time.strftime('%H%M%S')}",
                validate_parameters=False, persist_result=False)
