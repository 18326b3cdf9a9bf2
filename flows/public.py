"""``idic.flow``: the commands as Prefect flows, for scripts and for flows of your own.

Each takes the arguments of its function in `idic.run` (`identify_run`, `identify_batch`, `diagnose_run`, `systematic`),
and for the workers ``workers``, ``scheduler``, ``memory_limit`` and ``store`` as the options of the command. A call
inside a flow run is a sub-flow on the same server::

    import idic
    from prefect import flow

    @flow
    def overnight(folders: list[str]):
        return [idic.flow.identify([folder], folder + "/run")["status"] for folder in folders]

Outside of one, a Prefect server is started for the call unless PREFECT_API_URL names one. Importing this starts
nothing.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import Any

from idic.run import Workplace, diagnose_run, identify_batch, identify_run, systematic as assess
from idic_flows.orchestrator import PrefectFlow


def _as_flow(command: Callable[..., dict]) -> Callable[..., dict]:
    @wraps(command)
    def conducted(*arguments: Any, workers: int | None = None, scheduler: str | None = None,
                  memory_limit: str | None = None, store: str | None = None, **keywords: Any) -> dict:
        workplace = Workplace(workers, scheduler, memory_limit, store)
        return command(*arguments, workplace=workplace, orchestrator=PrefectFlow(), **keywords)

    return conducted


identify = _as_flow(identify_run)
batch = _as_flow(identify_batch)
diagnose = _as_flow(diagnose_run)
systematic = _as_flow(assess)

__all__ = ["batch", "diagnose", "identify", "systematic"]
