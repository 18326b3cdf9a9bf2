"""The Prefect server of a flow, and quiet settings. Import this before Prefect: it reads the environment."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from idic.store.run_lock import LOCK_NAME, is_held
from idic.workers.prefect_server import PrefectServer, start_server


@contextmanager
def flow_server() -> Iterator[PrefectServer | None]:
    """The server of a ``with`` block: the configured one, or one of its own. None inside a flow run: that of the
    flow."""
    if _inside_a_flow():
        yield None
    else:
        with start_server() as server:
            yield server


def _inside_a_flow() -> bool:
    if "prefect" not in sys.modules:
        return False
    from prefect.context import FlowRunContext

    return FlowRunContext.get() is not None


def show_dashboards(show: Callable[[str | None, str | None, str | None], None], server: PrefectServer | None,
                    dask: str | None) -> None:
    """Call show(address of Prefect, of Dask, password of Prefect); `server` as of `flow_server`."""
    show(None if server is None else server.dashboard, dask, None if server is None else server.password)


@contextmanager
def connected(server: PrefectServer | None) -> Iterator[None]:
    """Run flows against `server` for a ``with`` block; wait until it answers, hand over what is still on its way.

    server : None changes nothing: the flow becomes part of the flow run that calls it
    No heartbeat: it would add a second to every flow, and our own checkpoint says where a killed run stood.
    """
    if server is None:
        yield
        return
    from prefect.settings import (
        PREFECT_API_AUTH_STRING,
        PREFECT_API_URL,
        PREFECT_FLOWS_HEARTBEAT_FREQUENCY,
        PREFECT_HOME,
        PREFECT_LOGGING_LEVEL,
        PREFECT_SERVER_ALLOW_EPHEMERAL_MODE,
        temporary_settings,
    )

    url = server.wait()  # after the import, which takes as long as a server needs to start
    updates = {
        PREFECT_API_URL: url,
        PREFECT_FLOWS_HEARTBEAT_FREQUENCY: None,
        PREFECT_SERVER_ALLOW_EPHEMERAL_MODE: False,
        PREFECT_LOGGING_LEVEL: "WARNING",
    }
    if server.password is not None:
        updates[PREFECT_API_AUTH_STRING] = server.password
    if server.home is not None:
        updates[PREFECT_HOME] = server.home
    with temporary_settings(updates):
        try:
            yield
        finally:
            _hand_over()


def _hand_over() -> None:
    """Send the last events and log lines while the server still listens; later they end in a long traceback."""
    from prefect.events.worker import EventsWorker
    from prefect.logging.handlers import APILogWorker

    for worker in (APILogWorker, EventsWorker):
        worker.drain_all(timeout=5)  # s: a healthy server on this machine needs a tenth of one


def server_is_gone(problem: BaseException | None) -> bool:
    """Whether an exception, or what it came from, says that Prefect's server cannot be reached any more."""
    from httpx import TransportError  # Prefect's client

    while problem is not None:
        if isinstance(problem, TransportError):
            return True
        problem = problem.__cause__ or problem.__context__
    return False


def show_killed_as_crashed(flow: str) -> int:
    """Give the runs of a flow that say "Running", while no process works on their RUN folder, the state "Crashed".

    A process that was killed could not say so. Folders that this machine does not see are left alone. Returns how many
    there were.
    """
    from prefect.client.orchestration import get_client
    from prefect.client.schemas.filters import FlowFilter, FlowFilterName, FlowRunFilter, FlowRunFilterState
    from prefect.client.schemas.filters import FlowRunFilterStateType
    from prefect.states import Crashed, StateType

    running = FlowRunFilter(state=FlowRunFilterState(type=FlowRunFilterStateType(any_=[StateType.RUNNING])))
    with get_client(sync_client=True) as client:
        found = client.read_flow_runs(flow_filter=FlowFilter(name=FlowFilterName(any_=[flow])), flow_run_filter=running)
        killed = [one for one in found if _was_killed(one.parameters.get("out"))]
        for one in killed:
            client.set_flow_run_state(one.id, Crashed(message="the process was killed; --resume continues"), force=True)
    return len(killed)


def _was_killed(out: object) -> bool:
    return isinstance(out, str) and (Path(out) / LOCK_NAME).is_file() and not is_held(out)
