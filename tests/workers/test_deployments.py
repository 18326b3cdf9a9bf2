"""The deployments that `deploy/prefect_deploy.py` registers, as a real server holds them."""

from __future__ import annotations

import runpy
from pathlib import Path

import pytest
from prefect.client.orchestration import get_client
from prefect.states import Pending

from idic.run import PrefectServer
from idic_flows.deployed import FLOWS
from idic_flows.settings import connected

pytestmark = pytest.mark.usefixtures("shared_server")
register = runpy.run_path(str(Path(__file__).parents[2] / "deploy" / "prefect_deploy.py"))["main"]
COMMANDS = {"identify", "batch", "diagnose", "systematic"}


@pytest.fixture
def client():
    with connected(PrefectServer.start()), get_client(sync_client=True) as client:
        yield client


def test_every_long_command_is_a_deployment_whose_form_asks_for_typed_values(client):
    register("forms", None)
    register("forms", None)  # again, as after an update
    kept = {d.entrypoint: d for d in client.read_deployments() if d.work_pool_name == "forms"}
    assert set(kept) == {f"idic_flows.deployed.{name}" for name in COMMANDS} and len(FLOWS) == len(COMMANDS)
    asked = kept["idic_flows.deployed.identify"].parameter_openapi_schema
    types = {name: field.get("type") or {option["type"] for option in field["anyOf"]}
             for name, field in asked["properties"].items()}
    assert set(asked["required"]) == {"experiment", "out"}
    assert types["experiment"] == types["out"] == types["sensitivity"] == "string"
    assert types["workers"] == types["pause_after"] == {"integer", "null"}


def test_further_runs_of_a_limited_deployment_wait(client):
    register("limited", 1)
    kept = next(d for d in client.read_deployments()
                if d.work_pool_name == "limited" and d.entrypoint.endswith(".identify"))
    runs = [client.create_flow_run_from_deployment(kept.id, parameters={"experiment": "/data/test", "out": out})
            for out in ("/data/first", "/data/second")]
    first, second = (client.set_flow_run_state(run.id, Pending()) for run in runs)  # what a worker asks before a start
    assert first.status.value == "ACCEPT"
    assert second.status.value == "REJECT" and second.state.name == "AwaitingConcurrencySlot"
