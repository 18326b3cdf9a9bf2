"""The Prefect server of a flow, and quiet settings. Import this before Prefect: it reads the environment."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

from idic.errors import InputError
from idic.run import PASSWORD, PrefectServer, process_lives, this_process

TAG = "idic-process:"
REFUSED = (401, 403)  # status of a request without the right password, or without the right
KILLED = "the process was killed; --resume continues"


@contextmanager
def flow_server() -> Iterator[PrefectServer | None]:
    """The server of a ``with`` block: the configured one, or one of its own. None inside a flow run: that of the
    flow."""
    if _inside_a_flow():
        yield None
    else:
        with PrefectServer.start() as server:
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
    No heartbeat: it would add a second to every flow. Flow runs name their process instead; those of killed ones are
    shown as crashed by the next command.
    """
    if server is None:
        with _named_process():
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
    with temporary_settings(updates), _named_process():
        try:
            yield
        except Exception as problem:
            if not server.owned:
                _check_admitted(problem, url, bool(PREFECT_API_AUTH_STRING.value()))
            raise
        finally:
            _hand_over()


@contextmanager
def _named_process() -> Iterator[None]:
    """Flow runs of a ``with`` block name their process; those of processes that were killed are shown as crashed."""
    from prefect import tags

    with suppress(Exception):  # it would only tidy up: the run goes on where Prefect does not answer
        show_killed_as_crashed()
    with tags(process_tag()):
        yield


def _hand_over() -> None:
    """Send the last events and log lines while the server still listens; later they end in a long traceback."""
    from prefect.events.worker import EventsWorker
    from prefect.logging.handlers import APILogWorker

    for worker in (APILogWorker, EventsWorker):
        worker.drain_all(timeout=5)  # s: a healthy server on this machine needs a tenth of one


def _check_admitted(problem: BaseException | None, url: str, with_password: bool) -> None:
    """Say what to do where an exception comes from a configured server that does not let this user in."""
    from httpx import HTTPStatusError  # Prefect's client

    while problem is not None:
        if isinstance(problem, HTTPStatusError) and problem.response.status_code in REFUSED \
                and str(problem.request.url).startswith(url):
            raise InputError("the configured Prefect server refuses this command", key=PASSWORD,
                             expected=f"the user and password of the server at {url}, as user:password",
                             found=f"{'another one' if with_password else 'none'} (status "
                                   f"{problem.response.status_code})",
                             remedy=f"export {PASSWORD} with them (on Prefect Cloud: PREFECT_API_KEY), or leave the "
                                    "server out with --no-prefect") from problem
        problem = problem.__cause__ or problem.__context__


def server_is_gone(problem: BaseException | None) -> bool:
    """Whether an exception, or what it came from, says that Prefect's server cannot be reached any more."""
    from httpx import TransportError  # Prefect's client

    while problem is not None:
        if isinstance(problem, TransportError):
            return True
        problem = problem.__cause__ or problem.__context__
    return False


def show_killed_as_crashed() -> int:
    """Give the runs of idic's flows that say "Running", while the process that began them is gone, the state "Crashed",
    and so their tasks.

    A process that was killed could not say so. Runs of other machines are left alone. Returns how many there were.
    """
    from prefect.client.orchestration import get_client
    from prefect.client.schemas.filters import (
        FlowFilter,
        FlowFilterName,
        FlowRunFilter,
        FlowRunFilterId,
        FlowRunFilterState,
        FlowRunFilterStateType,
        TaskRunFilter,
        TaskRunFilterState,
        TaskRunFilterStateType,
    )
    from prefect.states import Crashed, StateType

    running = FlowRunFilter(state=FlowRunFilterState(type=FlowRunFilterStateType(any_=[StateType.RUNNING])))
    open_tasks = TaskRunFilter(state=TaskRunFilterState(type=TaskRunFilterStateType(
        any_=[StateType.RUNNING, StateType.PENDING])))
    with get_client(sync_client=True) as client:
        flow_filter = FlowFilter(name=FlowFilterName(like_="idic-"))
        flow_runs = client.read_flow_runs(flow_filter=flow_filter, flow_run_filter=running)
        killed = [flow_run for flow_run in flow_runs if any(map(_names_a_dead_process, flow_run.tags))]
        for flow_run in killed:
            tasks = client.read_task_runs(flow_run_filter=FlowRunFilter(id=FlowRunFilterId(any_=[flow_run.id])),
                                          task_run_filter=open_tasks)
            for task in tasks:
                client.set_task_run_state(task.id, Crashed(message=KILLED), force=True)
            client.set_flow_run_state(flow_run.id, Crashed(message=KILLED), force=True)
    return len(killed)


def process_tag() -> str:
    """The tag by which a flow run names its process: machine, number and second of its start."""
    process = this_process()
    return f"{TAG}{process['host']}:{process['pid']}:{process['process_started']:.2f}"


def _names_a_dead_process(tag: str) -> bool:
    if not tag.startswith(TAG):
        return False
    try:
        host, number, started = tag.removeprefix(TAG).rsplit(":", 2)
        return not process_lives({"host": host, "pid": int(number), "process_started": float(started)})
    except ValueError:  # written by somebody else: a run that is not known to be dead is left alone
        return False
