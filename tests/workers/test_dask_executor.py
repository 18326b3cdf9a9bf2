"""One interface, with and without processes: order, names, lost workers, and nobody left behind."""

import os
import signal
import subprocess
import sys
import textwrap
import threading
import time
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import psutil
import pytest
import tifffile
from cluster_jobs import die_always, die_once, die_when_asked, hold_memory, loaded, slow_once, square, thread_limits
from experiment_file.small_experiment import load_experiment, write_experiment
from runner_contract import RunnerContract, names

from idic.errors import InputError
from idic.readers import open_stack
from idic.run import RunStore, SerialRunner, ZarrStack, open_cluster
from idic.run.workers.runner import JobKillsWorkers
from idic.run.prepared.prepare import ingest
from idic.run.workers.dask_connection import checked_address
from idic.run.workers import submission
from idic.run import checked_memory_limit
from idic.run.workers.submission import Submission
from idic.run.workers.task_limits import TaskLimits, task_limits
from idic_flows.shown_runner import ShownRunner

HERE = Path(__file__).parent
posix = pytest.mark.skipif(os.name != "posix", reason="sends POSIX signals")


@pytest.fixture(scope="module")
def cluster():
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", str(HERE))  # the workers import cluster_jobs
        with open_cluster(2) as runner:
            yield runner


class TestSerial(RunnerContract):
    @pytest.fixture
    def runner(self):
        return SerialRunner()


class TestCluster(RunnerContract):
    @pytest.fixture
    def runner(self, cluster):
        return cluster


class TestShown(RunnerContract):
    """Outside of a flow run: what it shows inside is seen in run/test_shown_jobs.py."""

    @pytest.fixture
    def runner(self):
        return ShownRunner(SerialRunner())


def test_a_worker_that_keeps_nearly_all_that_it_may_have_goes_on_working(monkeypatch):
    """Between the 80 % at which Dask would pause it until it has less, and the 95 % at which it is ended."""
    monkeypatch.setenv("PYTHONPATH", str(HERE))
    with open_cluster(1, memory_limit=700_000_000) as runner:
        (held,) = runner.map(hold_memory, [610_000_000], ["hold"])
        assert 0.85 * 700_000_000 < held < 0.93 * 700_000_000
        time.sleep(1.0)  # s: Dask looks ten times a second
        future = runner._client.submit(square, 3, key="after", pure=False)
        assert future.result(timeout=60) == 9


def test_cores_of_idle_workers_serve_the_jobs_of_the_others(cluster):
    assert (cluster.threads_for(1), cluster.threads_for(2), cluster.threads_for(7)) == (2, 1, 1)
    assert SerialRunner().threads_for(1) == 1 and SerialRunner(threads=2).threads_for(1) == 2


def test_the_number_of_jobs_under_way_is_bounded(cluster):
    done = []
    stream = cluster.stream(square, list(range(30)), names(30), progress=lambda n, _: done.append(n), ahead=4)
    assert next(stream) == 0
    time.sleep(0.2)  # s: more than enough for the four to finish
    assert len(done) <= 4
    assert list(stream) == [i * i for i in range(1, 30)]


def test_workers_use_one_thread_each(cluster):
    assert cluster.workers == 2
    assert cluster.map(thread_limits, [0], names(1)) == [("1", "1", 1)]


def test_the_dashboard_shows_the_names(cluster):
    cluster.map(square, [1], ["simulate-it003-SPECIMEN.E"])
    keys = cluster._client.run_on_scheduler(lambda dask_scheduler: list(dask_scheduler.task_prefixes))
    assert "simulate" in keys


def test_a_job_that_straggles_is_also_given_to_a_free_worker(cluster, tmp_path, monkeypatch):
    monkeypatch.setattr(cluster, "_limits", TaskLimits(seconds=1.0))
    said = []
    jobs = [(tmp_path / "mark", 1), (tmp_path, 2), (tmp_path, 3)]  # the first hangs until it is started again
    found = cluster.stream(slow_once, jobs, names(3), progress=lambda *counts: said.append(counts), copies=True)
    assert list(found) == [1, 2, 3]
    assert said == [(1, 3), (2, 3), (3, 3)]
    assert (tmp_path / "mark").read_text() == "xx"  # started twice


def test_a_job_without_leave_to_run_twice_is_waited_for(cluster, tmp_path, monkeypatch):
    monkeypatch.setattr(cluster, "_limits", TaskLimits(seconds=1.0))
    assert cluster.map(slow_once, [(tmp_path / "mark", 1, 3.5), (tmp_path, 2)], names(2)) == [1, 2]
    assert (tmp_path / "mark").read_text() == "x"


def test_the_workers_copy_images_as_one_process_does(cluster, tmp_path, monkeypatch):
    experiment = load_experiment(write_experiment(tmp_path / "test"))
    paths = [tmp_path / f"{k}.tif" for k in range(40)]  # three chunks
    for k, path in enumerate(paths):
        tifffile.imwrite(path, np.random.default_rng(k).integers(0, 256, (50, 60), dtype=np.uint8))
    experiment = replace(experiment, recording=replace(experiment.recording, stack=open_stack(paths)))
    monkeypatch.setattr("idic.run.prepared.prepare.BYTES_FOR_WORKERS", 0)
    seen, copies = [], []
    for name, runner in (("one", SerialRunner()), ("workers", cluster)):
        store = RunStore(tmp_path / name)
        with store.claim("identity"):
            ingest(store, experiment, runner, lambda *counts: seen.append(counts))
        copies.append(ZarrStack(store.group("images")))
    assert seen == [(14, 40), (28, 40), (40, 40)] * 2
    assert copies[0].files == copies[1].files and [file["name"]
                                                   for file in copies[1].files] == [path.name for path in paths]
    for k in range(40):
        assert np.array_equal(copies[1].frame(k), tifffile.imread(paths[k]))
    paths[20].write_bytes(paths[20].read_bytes()[:1000])
    with store.claim("identity"), pytest.raises(InputError, match="20.tif"):
        ingest(store, replace(experiment, recording=replace(experiment.recording, identity="another")), cluster)
    assert store.finished("images") is not None  # the earlier copy stays


def test_limits_of_a_task_come_from_the_environment(monkeypatch):
    assert task_limits() == TaskLimits()
    monkeypatch.setenv("IDIC_TASK_RETRIES", "2")
    monkeypatch.setenv("IDIC_TASK_SECONDS", "900")
    assert task_limits() == TaskLimits(2, 900.0)
    assert TaskLimits().straggles_after(0.0) == float("inf") and TaskLimits().straggles_after(100.0) == 300.0
    for name, text in (("IDIC_TASK_SECONDS", "soon"), ("IDIC_TASK_SECONDS", "0.1"), ("IDIC_TASK_RETRIES", "1.5"),
                       ("IDIC_TASK_RETRIES", "21")):
        with monkeypatch.context() as patch, pytest.raises(InputError, match=name):
            patch.setenv(name, text)
            task_limits()


@posix
def test_a_lost_worker_costs_nothing_but_time(cluster, tmp_path):
    jobs = [(tmp_path / f"mark{i}" if i == 3 else tmp_path, i) for i in range(8)]
    assert cluster.map(die_once, jobs, names(8)) == list(range(8))
    assert (tmp_path / "mark3").exists()


@posix
def test_work_in_the_background_is_given_up_with_its_worker(tmp_path):
    """Dask gives such a task to no other worker once all workers were lost."""
    with open_cluster(1) as runner:
        marker = tmp_path / "process"
        over = runner.background(die_when_asked, str(marker), "compile")
        while not marker.exists() or not marker.read_text():
            time.sleep(0.05)
        os.kill(int(marker.read_text()), signal.SIGKILL)
        waiting = threading.Thread(target=over, daemon=True)
        waiting.start()
        waiting.join(60.0)
        assert not waiting.is_alive()
        assert runner.map(square, [3], ["square"]) == [9]


def test_a_job_that_always_kills_its_worker_is_named(tmp_path):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", str(HERE))
        patch.setattr("idic.run.workers.dask_executor.ALLOWED_FAILURES", 1)
        patch.setattr("idic.run.workers.submission.ALLOWED_FAILURES", 1)  # each death costs the start of a worker
        with open_cluster(1) as runner, pytest.raises(InputError, match="dying on simulate-it001-A.E") as problem:
            runner.map(die_always, [0], ["simulate-it001-A.E"])
    assert "fewer --workers" in problem.value.remedy


class Over:
    """A future of a job that is over: with its own number, or with the death of its workers."""

    status = "finished"

    def __init__(self, number, kills):
        self.number, self.kills, self.tell = number, kills, None

    def add_done_callback(self, tell):
        self.tell = tell

    def result(self, timeout=None):
        from distributed import KilledWorker

        if self.kills:
            raise KilledWorker("simulate", None, 8)
        return self.number


class KillerFirst:
    """A client on which job 1 kills its workers, and is given up before anything else is over."""

    def __init__(self):
        self.futures = []

    def submit(self, function, job, **_):
        self.futures.append(Over(job, kills=job == 1))
        return self.futures[-1]

    def end_all(self):
        for number in (1, 2, 0):
            self.futures[number].tell(self.futures[number])


def test_a_job_that_kills_its_workers_is_blamed_in_its_place_and_earlier_results_come():
    client, came = KillerFirst(), []
    jobs = Submission(client, square, [0, 1, 2], names(3), TaskLimits(), copies=False)
    threading.Timer(0.1, client.end_all).start()
    with pytest.raises(JobKillsWorkers, match="dying on job-it000-1") as problem:
        for result in jobs.in_order(None, 3):
            came.append(result)
    assert came == [0] and problem.value.job == 1


class Killer(threading.Thread):
    """Kills the first worker processes of this process that it sees, as they start."""

    def __init__(self, number):
        super().__init__(daemon=True)
        self.left, self.killed, self.over = number, [], False
        # before the thread runs: it may begin when the next process is there
        self.known = set(psutil.Process().children(recursive=True))

    def run(self):
        while self.left and not self.over:
            for child in set(psutil.Process().children(recursive=True)) - self.known:
                with suppress(psutil.Error):
                    if "spawn_main" in " ".join(child.cmdline()):
                        child.kill()
                        self.known.add(child)  # it stays a child until somebody waits for it
                        self.killed.append(child)
                        self.left -= 1
                        break
            time.sleep(0.005)

    def __enter__(self):
        self.start()
        return self

    def __exit__(self, *_):
        self.over = True
        self.join()


@posix
def test_a_worker_that_dies_as_it_starts_costs_nothing_but_time():
    with Killer(1) as killer, open_cluster(1) as runner:
        assert runner.map(square, [3], names(1)) == [9]
    assert len(killer.killed) == 1


@posix
def test_workers_that_never_start_are_reported_with_a_remedy():
    before = set(psutil.Process().children(recursive=True))
    with Killer(20) as killer, pytest.raises(InputError, match="die during their start") as problem, open_cluster(1):
        pass
    assert len(killer.killed) >= 3 and "--workers 0" in problem.value.remedy
    left = set(psutil.Process().children(recursive=True)) - before
    assert not [child for child in left if "spawn_main" in " ".join(child.cmdline())]


def test_workers_import_the_modules_that_they_need():
    with open_cluster(1, preload=("fractions",)) as runner:
        assert runner.map(loaded, ["fractions"], names(1)) == [True]


def test_no_workers_means_this_process():
    with open_cluster(0) as runner:
        assert isinstance(runner, SerialRunner)


def test_every_port_is_on_the_loopback_interface(cluster):
    listening = [c.laddr.ip for p in _family() for c in p.net_connections("tcp") if c.status == psutil.CONN_LISTEN]
    assert listening and set(listening) == {"127.0.0.1"}


@posix
@pytest.mark.parametrize("stop", [signal.SIGKILL, pytest.param(signal.SIGINT, marks=pytest.mark.slow)])
def test_workers_end_with_their_driver_however_it_ends(tmp_path, stop):
    script = tmp_path / "driver.py"
    script.write_text(
        textwrap.dedent(f"""
        import sys
        sys.path.insert(0, {str(HERE)!r})
        from cluster_jobs import wait_long
        from idic.run.workers.dask_executor import open_cluster
        if __name__ == "__main__":
            with open_cluster(2) as runner:
                runner.map(wait_long, [{str(tmp_path / "a")!r}, {str(tmp_path / "b")!r}], ["wait-a", "wait-b"])
        """)
    )
    driver = subprocess.Popen([sys.executable, str(script)], stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                              text=True)
    try:
        _wait_for(lambda: all((tmp_path / x).exists() and (tmp_path / x).read_text() for x in "ab"), 90)
        children = psutil.Process(driver.pid).children(recursive=True)
        assert len(children) >= 2
        driver.send_signal(stop)
        output, _ = driver.communicate(timeout=20)  # also: nobody keeps the pipe open
    finally:
        driver.kill()
    gone, alive = psutil.wait_procs(children, timeout=10)
    assert not [process for process in alive if process.status() != psutil.STATUS_ZOMBIE]  # dead, but not yet collected
    if stop == signal.SIGINT:
        assert output.count("Traceback") <= 1 and "KeyboardInterrupt" in output  # the driver's own, nothing from Dask


def test_an_existing_scheduler_is_used():
    from distributed import LocalCluster

    with LocalCluster(1, host="127.0.0.1", threads_per_worker=2, dashboard_address="127.0.0.1:0") as foreign:
        with open_cluster(scheduler=foreign.scheduler_address) as runner:
            assert runner.workers == 2
            assert runner.map(abs, [-1, -2], names(2)) == [1, 2]
        assert foreign.status.name == "running"


def test_a_scheduler_that_is_not_there_is_said(monkeypatch):
    monkeypatch.setattr("idic.run.workers.dask_connection.CONNECT_SECONDS", 1)
    with pytest.raises(InputError, match="cannot connect"), open_cluster(scheduler="127.0.0.1:1"):
        pass


def test_nothing_is_written_for_a_scheduler_that_is_not_there(tmp_path, monkeypatch):
    from idic_flows.public import identify

    monkeypatch.setattr("idic.run.workers.dask_connection.CONNECT_SECONDS", 1)
    folder = write_experiment(tmp_path / "test")
    with pytest.raises(InputError, match="cannot connect"):
        identify([folder], tmp_path / "run", scheduler="127.0.0.1:1")
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize("address",
                         ["10.0.0.5:8786", "tcp://cluster.example.org:8786", "ws://10.0.0.5:80", "0.0.0.0:8786"])
def test_an_open_scheduler_on_another_machine_is_refused(address):
    with pytest.raises(InputError, match="TLS only"):
        checked_address(address)


def test_addresses_on_this_machine_or_with_encryption_pass():
    assert checked_address("localhost:8786") == "tcp://localhost:8786"
    assert checked_address("tcp://[::1]:8786") == "tcp://[::1]:8786"
    assert checked_address("tls://10.0.0.5:8786") == "tls://10.0.0.5:8786"


def _family():
    me = psutil.Process()
    return [me, *me.children(recursive=True)]


def _wait_for(condition, seconds):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "waited too long"
        time.sleep(0.05)


@posix
def test_a_worker_that_is_lost_again_while_it_starts_is_replaced(tmp_path, monkeypatch):
    """Dask closes it and starts none in its place: with one worker the call would wait for ever."""
    import dask

    monkeypatch.setattr("idic.run.workers.dask_settings.LOST_AFTER", "1s")
    with open_cluster(1) as runner:
        assert dask.config.get("distributed.deploy.lost-worker-timeout") == "1s"
        assert runner.map(square, [2], names(1)) == [4]
        with Killer(2) as killer:
            for worker in psutil.Process().children(recursive=True):
                if "spawn_main" in " ".join(worker.cmdline()):
                    worker.kill()
            assert runner.map(square, [3, 4], names(2, "again")) == [9, 16]
        assert killer.killed


@posix
def test_a_result_that_is_lost_with_its_worker_is_made_again(monkeypatch):
    """The worker dies after the job is done and before the driver fetches the result."""
    monkeypatch.setattr("idic.run.workers.dask_settings.LOST_AFTER", "1s")
    monkeypatch.setattr(submission, "_FETCH_SECONDS", 0.5)
    with open_cluster(1) as runner:
        lost = submission.LostWorkers(runner._client, runner._client.cluster, "wait", lambda line: None)
        jobs = Submission(runner._client, square, [5], names(1), TaskLimits(), copies=False, lost=lost)
        jobs._submit(0)
        future, index = jobs._next()
        with Killer(1):
            for worker in psutil.Process().children(recursive=True):
                if "spawn_main" in " ".join(worker.cmdline()):
                    worker.kill()
            _wait_for(lambda: future.status != "finished", 20)
            assert jobs._result(future, index) == 25


@posix
@pytest.mark.parametrize("choice", ["end", "here"])
def test_without_any_worker_the_run_ends_or_goes_on_in_this_process_and_says_so(monkeypatch, choice):
    monkeypatch.setenv("IDIC_NO_WORKERS", choice)
    monkeypatch.setattr(submission, "MAX_WITHOUT_S", 2.0)
    monkeypatch.setattr(submission, "_REMARK_AFTER_S", 1.0)
    lines = []
    with open_cluster(1, say=lines.append) as runner, Killer(10**9):  # a quiet machine starts a hundred in a second
        for worker in psutil.Process().children(recursive=True):
            if "spawn_main" in " ".join(worker.cmdline()):
                worker.kill()
        if choice == "here":
            assert runner.map(square, [3, 4], names(2)) == [9, 16]
        else:
            with pytest.raises(InputError, match="no workers"):
                runner.map(square, [3, 4], names(2))
    assert lines and lines[0].startswith("0 of 1 workers")


@pytest.mark.parametrize("workers", [10**23, -1, 5000])
def test_a_number_of_workers_that_no_machine_has_is_refused(workers):
    with pytest.raises(InputError, match="number of worker processes"), open_cluster(workers):
        pass


@pytest.mark.parametrize("limit", ["1e400", "nan", "-1e400", "1e400GB"])
def test_a_memory_limit_that_is_no_number_is_refused(limit):
    with pytest.raises(InputError, match="memory limit"):
        checked_memory_limit(limit, 1, None)
