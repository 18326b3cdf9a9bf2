"""The whole flow once, with perturbed runs: what Prefect and Dask show of it, on a scheduler that somebody started."""

from __future__ import annotations

import base64
import json
import os
import re
import socket
import subprocess
import sys
import textwrap
import time
import urllib.request

import cv2
import numpy as np
import prefect
import pytest
from experiment_file.small_experiment import write_experiment
from one_thread import ONE_THREAD

from idic_flows.settings import TAG, connected, process_tag, show_killed_as_crashed
from idic_flows.stages import EVALUATIONS, RESIDUAL, SCHEDULE
from prefect.client.orchestration import get_client
from prefect.states import Running
from virtual_tests.small_strip import write_small_strip

import idic
from idic.errors import InputError
from idic.run import PrefectServer, identify_run
from idic.run.workers.dask_connection import LOOPBACK
from idic.run.workers.prefect_server import QUIET

SECONDS = 600.0  # 10 s on a quiet machine
PARAMETERS = ["sheet.E", "sheet.nu", "sheet.yield_stress", "sheet.hardening_modulus"]
SPY = """
from distributed.diagnostics.plugin import SchedulerPlugin

class Spy(SchedulerPlugin):
    def transition(self, key, start, finish, *args, **kwargs):
        if finish == "memory":
            with open({file!r}, "a") as file:
                file.write(str(key) + "\\n")

def dask_setup(scheduler):
    scheduler.add_plugin(Spy(), name="spy")
"""


@pytest.fixture
def scheduler(tmp_path):
    """`dask scheduler` and one `dask worker` on the loopback interface: address, and a function for its task names."""
    spy, file = tmp_path / "spy.py", tmp_path / "tasks.txt"
    spy.write_text(SPY.format(file=str(file)))
    environment = dict(os.environ) | ONE_THREAD | {"DASK_LOGGING__DISTRIBUTED": "error"}
    address_file = tmp_path / "scheduler.json"
    common = ["--host", LOOPBACK, "--dashboard-address", f"{LOOPBACK}:0"]
    commands = [["scheduler", "--port", "0", "--scheduler-file", address_file, "--preload", spy, *common],
                ["worker", "--scheduler-file", address_file, "--nthreads", "1", "--local-directory", tmp_path, *common]]
    processes = [subprocess.Popen([sys.executable, "-m", "dask", *map(str, command)], env=environment,
                                  stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) for command in commands]
    try:
        yield _address(address_file), lambda: file.read_text().splitlines()
    finally:
        for process in reversed(processes):
            process.terminate()
        for process in processes:
            process.wait(20)


def _address(file):
    end = time.monotonic() + SECONDS
    while time.monotonic() < end:
        try:
            return json.loads(file.read_text())["address"]
        except (OSError, ValueError):
            time.sleep(0.05)
    raise AssertionError("the scheduler did not start")


def shown_by(server, what, *flow_runs):
    """All task runs, flow runs or artifacts that a Prefect server knows; flow_runs : only of those with these ids."""
    known = base64.b64encode(server.password.encode()).decode()
    asked = {"limit": 200} | ({"flow_runs": {"id": {"any_": flow_runs}}} if flow_runs else {})
    request = urllib.request.Request(f"{server.url}/{what}/filter", json.dumps(asked).encode(),
                                     {"Content-Type": "application/json", "Authorization": f"Basic {known}"})
    with urllib.request.build_opener(urllib.request.ProxyHandler({})).open(request, timeout=30) as answer:
        return json.load(answer)


def ended_tasks(server, flow_run, seconds=30.0):
    """Names and states of the task runs of a flow run: Prefect's server records their last states together, a moment
    after the flow has ended."""
    end = time.monotonic() + seconds
    while True:
        shown = {run["name"]: run["state_type"] for run in shown_by(server, "task_runs", flow_run)}
        if "RUNNING" not in shown.values() or time.monotonic() > end:
            return shown
        time.sleep(0.2)


def test_the_flow_shows_named_tasks_in_prefect_and_n_plus_1_perturbed_runs_in_dask(scheduler, tmp_path, shared_server):
    address, dask_tasks = scheduler
    write_small_strip(tmp_path / "experiment")
    script = tmp_path / "drive.py"
    script.write_text(textwrap.dedent("""
        import sys
        from idic_flows.public import identify
        if __name__ == "__main__":
            result = identify([sys.argv[1]], sys.argv[2], scheduler=sys.argv[3], sensitivity="perturbed",
                              overrides={"options.max_iterations": 2})
            print(result["status"], result["sensitivity"])
    """))
    with PrefectServer.start() as server:
        environment = dict(os.environ) | ONE_THREAD | QUIET | {"PREFECT_API_URL": server.wait()}
        found = subprocess.run([sys.executable, script, tmp_path / "experiment", tmp_path / "run", address],
                               env=environment, capture_output=True, text=True, timeout=SECONDS)
        assert found.returncode == 0, found.stderr
        out = str(tmp_path / "run")
        (flow,) = (run for run in shown_by(server, "flow_runs") if run["parameters"].get("out") == out)
        shown = ended_tasks(server, flow["id"])
        artifacts = shown_by(server, "artifacts", flow["id"])
    assert found.stdout.split() == ["max_iterations", "perturbed"]
    stages = [f"{stage} it{number:03d}" for number in range(2) for stage in ("simulate", "correlate", "update")]
    assert set(shown.values()) == {"COMPLETED"} and {"prepare", *stages, "postprocess"} <= set(shown)
    for number in range(2):
        simulated = [name for name in shown if name.startswith(f"simulate it{number:03d} ")]
        assert sorted(re.sub(r" \+ [0-9.e-]+( MPa)?$", "", name) for name in simulated) == sorted(
            f"simulate it{number:03d} {label}" for label in ["base", *PARAMETERS])
        chunks = [name for name in shown if name.startswith(f"correlate it{number:03d} frame")]
        assert all(name.endswith(f" of {len(chunks)}") for name in chunks) and len(chunks) > 1

    assert flow["parameters"] == {"experiments": [str(tmp_path / "experiment")], "out": str(tmp_path / "run"),
                                  "sensitivity": "perturbed", "workers": 1, "pause_after": None}
    (schedule,) = [json.loads(one["data"]) for one in artifacts if one["key"] == SCHEDULE]
    assert schedule[-1]["free"].split(", ") == PARAMETERS and schedule[-1]["locked"] == "none"
    courses = sorted((json.loads(one["data"]) for one in artifacts if one["key"] == EVALUATIONS), key=len)
    result = json.loads((tmp_path / "run" / "result.json").read_text())
    assert len(courses[-1]) == 2 and courses[-1][-1]["step"] == "accepted"
    assert float(courses[-1][-1]["sheet.E [MPa]"]) == pytest.approx(result["parameters"]["sheet.E"]["value"], rel=1e-5)

    pictures = [one["data"] for one in artifacts if one["key"] == RESIDUAL]
    assert len(pictures) == 2
    for picture in pictures:
        png = base64.b64decode(picture.removeprefix("data:image/png;base64,"))
        assert cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_UNCHANGED).shape[2] == 4

    names = [re.sub(r"-[0-9a-f]{8}-\d+$", "", key) for key in dask_tasks()]
    for number in range(2):
        simulated = [name for name in names if name.startswith(f"simulate-it{number:03d}-")]
        assert sorted(simulated) == sorted(f"simulate-it{number:03d}-{label}" for label in ["base", *PARAMETERS])
        assert any(name.startswith(f"correlate-it{number:03d}-frames") for name in names)


def test_a_flow_of_ones_own_calls_idic_and_a_run_pauses_between_the_stages_of_its_schedule(tmp_path, shared_server):
    """On the server of the flow that calls. Resumed, the run has the bits of one that did not pause."""
    write_small_strip(tmp_path / "experiment")
    file = tmp_path / "experiment" / "experiment.toml"
    file.write_text(file.read_text()
                    + '\n[[stage]]\nfree = ["sheet.E", "sheet.nu"]\nmax_iterations = 2\n[[stage]]\nfree = "all"\n')

    @prefect.flow(name="laboratory", persist_result=False)
    def laboratory(pause_after):
        return idic.flow.identify([tmp_path / "experiment"], tmp_path / "run", resume=True, workers=0,
                                  overrides={"options.max_iterations": 4}, pause_after=pause_after)

    with PrefectServer.start() as server, connected(server):
        paused = laboratory(1)
        resumed = laboratory(1)
        shown = shown_by(server, "flow_runs")
    whole = idic.identify(tmp_path / "experiment", tmp_path / "whole", overrides={"options.max_iterations": 4})
    assert paused["status"] == "interrupted" and paused["paused_after_stage"] == 1
    assert {entry["stage"] for entry in paused["history"]} == {0}
    assert "paused_after_stage" not in resumed
    assert resumed["parameters"] == whole["parameters"] and resumed["history"] == whole["history"]
    own = [run for run in shown if str(tmp_path) in str(run["parameters"])]
    assert len([run for run in own if run["name"].startswith("identify-") and run["parent_task_run_id"]]) == 2


def test_a_run_whose_process_was_killed_is_shown_as_crashed_with_its_tasks(shared_server):
    """A process that is gone, one whose number another one has now, this one, and one of another machine."""
    def identify(out):
        """Never run here: only the server knows of it."""

    @prefect.task
    def simulate():
        """Neither."""

    host, own = socket.gethostname(), process_tag()
    processes = [f"{TAG}{host}:{2**22 + 1}:1", f"{own.rpartition(':')[0]}:1", own, f"{TAG}another-{host}:{2**22 + 1}:1"]
    flow = prefect.flow(identify, name=f"idic-identify {os.getpid()} {time.time()}")
    with PrefectServer.start() as server, connected(server), get_client(sync_client=True) as client:
        runs = [client.create_flow_run(flow, parameters={"out": "RUN"}, state=Running(), tags=[tag])
                for tag in processes]
        task = client.create_task_run(simulate, runs[0].id, dynamic_key="0", state=Running())
        assert show_killed_as_crashed() == 2 and show_killed_as_crashed() == 0
        states = [client.read_flow_run(run.id).state for run in runs]
        assert client.read_task_run(task.id).state.name == "Crashed"
    assert [state.name for state in states] == ["Crashed", "Crashed", "Running", "Running"]
    assert "--resume" in states[0].message


def test_a_pause_after_a_stage_that_is_none_is_refused(tmp_path):
    write_experiment(tmp_path / "experiment")
    with pytest.raises(InputError, match="--pause-after") as problem:
        identify_run([tmp_path / "experiment"], tmp_path / "run", pause_after=1)
    assert "[[stage]]" in problem.value.expected and not (tmp_path / "run").exists()
