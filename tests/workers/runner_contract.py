"""What every runner of tasks keeps to: a class of tests that the tests of each runner inherit."""

from __future__ import annotations

import numpy as np
import pytest
from cluster_jobs import fail_until, refuse, slow_first, square

from idic.errors import InputError, NotConverged
from idic.run import SerialRunner


def names(n, what="job-it000"):
    return [f"{what}-{i}" for i in range(n)]


class Noted:
    """A watch that notes what it is told."""

    def __init__(self):
        self.begun, self.over = {}, {}

    def started(self, job, attempt, place):
        self.begun[attempt] = job

    def ended(self, attempt, problem):
        self.over[attempt] = problem

    def lost(self, place):
        raise AssertionError(f"{place} is lost")


class RunnerContract:
    """A subclass has a fixture `runner`."""

    def test_results_come_in_the_order_of_the_jobs(self, runner):
        seen = []
        results = runner.map(square, list(range(20)), names(20), progress=lambda *counts: seen.append(counts))
        assert results == [i * i for i in range(20)]
        assert seen == [(i + 1, 20) for i in range(20)]

    def test_no_jobs_give_no_results(self, runner):
        assert runner.map(square, [], []) == [] and list(runner.stream(square, [], [])) == []

    def test_a_sum_has_the_bits_of_one_process(self, runner):
        sums = []
        for one in (SerialRunner(), runner, runner):
            total = np.zeros(50)
            for share in one.stream(slow_first, list(range(8)), names(8), ahead=4):
                total += share
            sums.append(total.tobytes())
        assert len(set(sums)) == 1

    def test_the_exceptions_of_the_product_arrive_with_their_fields(self, runner):
        with pytest.raises(InputError, match="frame 2") as problem:
            runner.map(refuse, [0, 1, 2], names(3))
        assert problem.value.remedy == "remove it"
        with pytest.raises(NotConverged, match="t = 3"):
            runner.map(refuse, [0, 3], names(2))
        assert runner.map(square, [3], names(1)) == [9]  # the runner is still of use

    def test_a_job_that_raises_is_tried_again(self, runner, tmp_path):
        assert runner.map(fail_until, [(tmp_path / "mark", 2)], names(1), retries=2) == [2]
        with pytest.raises(RuntimeError, match="not yet"):
            runner.map(fail_until, [(tmp_path / "other", 2)], names(1), retries=1)

    def test_the_same_job_twice_is_computed_twice(self, runner, tmp_path):
        counts = [runner.map(fail_until, [(tmp_path / "mark", 0)], names(1)) for _ in range(2)]
        assert counts == [[0], [1]]

    def test_a_watch_is_told_of_every_start_and_end(self, runner):
        noted = Noted()
        assert list(runner.stream(square, [3, 4], names(2), watch=noted)) == [9, 16]
        assert sorted(noted.begun.values()) == [0, 1] and set(noted.over) <= set(noted.begun)
        assert set(noted.over.values()) <= {""}

    def test_work_in_the_background_can_be_waited_for(self, runner):
        runner.background(square, 3, "compile")()
        assert runner.map(square, [3], names(1)) == [9]

    def test_every_runner_says_how_many_workers_it_has_and_what_they_see(self, runner):
        assert runner.workers >= 1 and runner.threads_for(1) >= 1 and runner.sees_files in (True, False)
        assert runner.dashboard is None or runner.dashboard.startswith("http")
