"""What Prefect shows of single simulations and chunks of frames: which runs, under which names, in which states."""

from __future__ import annotations

import os
import signal
import time

import prefect
import pytest
from run.test_flow import shown_by

from idic.errors import NotConverged
from idic.run import CorrelationJob, PrefectServer, SerialRunner, SimulationJob, open_cluster
from idic.run.prepared.tasks import SimulationReport
from idic_flows.job_runs import Budget, JobRuns
from idic_flows.job_titles import titles_of
from idic_flows.settings import connected
from idic_flows.shown_runner import ShownRunner
from idic_flows.stages import run_stage

HERE = "worker tcp://127.0.0.1:1"


def seen(states):
    return [(one.name, one.state) for one in states]


def test_short_jobs_are_shown_at_their_end_and_beyond_the_budget_together():
    runs = JobRuns(["chunk 1", "chunk 2", "chunk 3", "chunk 4"], Budget(burst=1, per_second=0.1), moment=0.0)
    shown = []
    for job, attempt in enumerate("abcd"):
        shown += runs.started(job, attempt, HERE, moment=0.1 * job)
        shown += runs.ended(attempt, "", moment=0.1 * job + 0.05)
    assert seen(shown) == [("chunk 1", "Completed")]
    (rest,) = runs.close(moment=0.5)
    assert rest.name == "chunk 2 … chunk 4 (3 short ones)" and rest.state == "Completed"
    assert (rest.began, rest.ended) == pytest.approx((0.1, 0.35))


def test_long_jobs_are_shown_while_they_wait_and_run():
    runs = JobRuns(["base", "E + 7 MPa"], Budget(), moment=0.0)
    assert runs.started(0, "a", HERE, moment=0.0) == [] and runs.due(moment=1.9) == []
    running, pending = runs.due(moment=2.1)
    assert seen([running, pending]) == [("base", "Running"), ("E + 7 MPa", "Pending")] and running.when == 0.0
    assert runs.due(moment=2.2) == []
    (over,), (next_one,) = runs.ended("a", "", moment=5.0), runs.started(1, "b", HERE, moment=5.0)
    assert over.run == running.run and over.state == "Completed" and HERE in over.message
    assert next_one.run == pending.run and next_one.state == "Running"


def test_a_job_that_takes_more_than_a_second_needs_no_budget():
    runs = JobRuns(["chunk 1", "chunk 2"], Budget(burst=0, per_second=0), moment=0.0)
    for job, attempt in enumerate("ab"):
        runs.started(job, attempt, HERE, moment=0.0)
    assert seen(runs.ended("a", "", moment=1.5)) == [("chunk 1", "Completed")]
    assert seen(runs.due(moment=2.5)) == [("chunk 2", "Running")]


def test_what_fails_or_is_lost_is_shown_whatever_the_budget_and_its_repetition_is_a_run_of_its_own():
    runs = JobRuns(["base", "E + 7 MPa"], Budget(burst=0, per_second=0), moment=0.0)
    for job, attempt in enumerate("ab"):
        assert runs.started(job, attempt, HERE, moment=0.0) == []
    (failed,) = runs.ended("a", "NotConverged: too large a step", moment=0.1)
    (lost,) = runs.lost(HERE, moment=0.2)
    assert seen([failed, lost]) == [("base", "Failed"), ("E + 7 MPa", "Crashed")]
    assert "too large" in failed.message and HERE in lost.message
    (again,) = runs.started(1, "c", "worker tcp://127.0.0.1:2", moment=0.3)
    (over,) = runs.ended("c", "", moment=0.4)
    assert seen([again, over]) == [("E + 7 MPa, attempt 2", "Running"), ("E + 7 MPa, attempt 2", "Completed")]
    assert again.run == over.run != lost.run
    assert runs.close(moment=0.5) == []


def test_what_is_no_longer_wanted_is_shown_as_cancelled():
    runs = JobRuns(["a", "b"], Budget(), moment=0.0)
    runs.started(0, "first", HERE, moment=0.0)
    runs.due(moment=2.5)
    assert seen(runs.close(moment=3.0)) == [("a", "Cancelled"), ("b", "Cancelled")]
    assert runs.close(moment=4.0) == []


def test_simulations_are_named_by_the_change_of_their_parameter_and_chunks_by_their_frames(tmp_path):
    values = {"E": 70000.0, "nu": 0.3}
    jobs = [SimulationJob("RUN", 3, "base", values), SimulationJob("RUN", 3, "E", values | {"E": 70007.0}),
            SimulationJob("RUN", 3, "nu", values | {"nu": 0.29})]
    assert titles_of(jobs, ["simulate-it003-x"] * 3) == [
        "simulate it003 base", "simulate it003 E + 7", "simulate it003 nu - 0.01"]
    chunks = [CorrelationJob("/RUNS/a", 3, first, last, values, {}) for first, last in ((0, 16), (16, 17))]
    assert titles_of(chunks, ["correlate-it003-x"] * 2, name_run=True) == [
        "a: correlate it003 frames 0-15, chunk 1 of 2", "a: correlate it003 frame 16, chunk 2 of 2"]
    assert titles_of(["other"], ["refit-plasticity-3"]) == ["refit-plasticity-3"]


class Told:
    """A watch that keeps what it is told."""

    def __init__(self):
        self.said = []

    def started(self, job, attempt, place):
        self.said.append(("started", job))

    def ended(self, attempt, problem):
        self.said.append(("ended", problem))

    def lost(self, place):
        self.said.append(("lost", place))


def step(job):
    """A job that fails once at 2, comes back without convergence at 3."""
    number, folder = job
    if number == 2 and not (folder / "tried").exists():
        (folder / "tried").touch()
        raise NotConverged("too large a step")
    return SimulationReport("base", "no convergence" if number == 3 else "", (), 0.0)


def test_a_watch_is_told_of_starts_ends_and_repetitions(tmp_path):
    told, jobs = Told(), [(number, tmp_path) for number in (1, 2, 3)]
    list(SerialRunner().stream(step, jobs, ["a", "b", "c"], retries=1, watch=told))
    assert told.said == [("started", 0), ("ended", ""), ("started", 1), ("ended", "NotConverged: too large a step"),
                         ("started", 1), ("ended", ""), ("started", 2), ("ended", "no convergence")]


@prefect.flow(name="jobs", persist_result=False)
def whole(runner, function, jobs, names, out):
    """A stage with jobs."""
    return run_stage("simulate it000", lambda: list(ShownRunner(runner).stream(function, jobs, names, retries=1)))


def shown_states(server, out, wanted, seconds=30.0):
    """Names and states of the task runs of the flow run with this `out`, when all `wanted` are among them."""
    end = time.monotonic() + seconds
    while True:
        (flow,) = (run for run in shown_by(server, "flow_runs") if run["parameters"].get("out") == str(out))
        runs = sorted((run["name"], run["state_name"]) for run in shown_by(server, "task_runs", flow["id"]))
        if wanted <= set(runs) or time.monotonic() > end:
            return runs
        time.sleep(0.2)


def test_jobs_of_a_stage_are_task_runs_on_the_server(tmp_path, shared_server):
    with PrefectServer.start() as server, connected(server):
        whole(SerialRunner(), step, [(number, tmp_path) for number in (1, 2, 3)], ["first", "second", "third"],
              str(tmp_path))
        wanted = [("first", "Completed"), ("second", "Failed"), ("second, attempt 2", "Completed"),
                  ("simulate it000", "Completed"), ("third", "Failed")]
        assert shown_states(server, tmp_path, set(wanted)) == wanted


def die_once(job):
    """A job that kills its worker the first time, after a while in which the worker reports its start."""
    number, folder = job
    if number == 1 and not (folder / "died").exists():
        (folder / "died").touch()
        time.sleep(0.5)
        os.kill(os.getpid(), signal.SIGKILL)
    return number


@pytest.mark.slow  # two worker processes
@pytest.mark.skipif(os.name != "posix", reason="sends SIGKILL")
def test_a_job_whose_worker_dies_is_shown_as_crashed_and_its_repetition_beside_it(tmp_path, shared_server):
    with PrefectServer.start() as server, open_cluster(2) as runner, connected(server):
        done = whole(runner, die_once, [(number, tmp_path) for number in range(3)], ["base", "E", "nu"], str(tmp_path))
        wanted = {("E", "Crashed"), ("E, attempt 2", "Completed")}
        shown = shown_states(server, tmp_path, wanted)
    assert done == [0, 1, 2]
    assert wanted <= set(shown), shown
    # another job may have lost its result, or its turn, with that worker
    assert {name.split(",")[0] for name, state in shown if state == "Completed"} >= {"base", "E", "nu"}
