"""Start the deployed identification with a pause after its first stage, await the pause, resume it, await the end.

    python resume_paused_run.py EXPERIMENT RUN SECONDS
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path

from prefect.client.orchestration import get_client
from prefect.deployments import run_deployment
from prefect.flow_runs import resume_flow_run


def main(experiment: str, run: str, seconds: float) -> int:
    """0 where the run was suspended with a result, and has converged after it was resumed."""
    parameters = {"experiment": experiment, "out": run, "workers": 1, "pause_after": 1}
    started = run_deployment("idic-identify-deployed/idic", parameters=parameters, timeout=0)
    end = time.monotonic() + seconds
    if reached(started.id, ("PAUSED",), end) != "PAUSED" or status(run) != "interrupted":
        return 1
    resume_flow_run(started.id)
    return int(reached(started.id, ("COMPLETED",), end) != "COMPLETED" or status(run) != "converged")


def reached(flow_run_id, wanted: tuple[str, ...], end: float) -> str:
    """The state of a flow run once it is one of these, or final; the last one at `end` (`time.monotonic`)."""
    with get_client(sync_client=True) as client:
        while True:
            state = client.read_flow_run(flow_run_id).state
            if state.type.value in wanted or state.is_final() or time.monotonic() > end:
                sys.stdout.write(f"{state.type.value} {state.name}: {state.message}\n")
                return state.type.value
            time.sleep(1.0)


def status(run: str) -> str:
    """Of the result in a RUN folder."""
    return json.loads((Path(run) / "result.json").read_text(encoding="utf-8"))["status"]


if __name__ == "__main__":
    sys.exit(main(sys.argv[1], sys.argv[2], float(sys.argv[3])))
