"""Every worker of an existing cluster is asked before a run writes anything: packages, experiment, disk, rounding."""

import os
import subprocess
import sys
from contextlib import contextmanager

import distributed
import pytest
from experiment_file.small_experiment import write_experiment
from one_thread import ONE_THREAD

from idic.errors import InputError
from idic.experiment_file import load_experiment
from idic.run import Workplace, check_scheduler, identify_run
from idic.run.workers import probe as probing
from idic.run.workers.dask_connection import LOOPBACK
from idic.run.workers.probe import ExperimentToSee, ProbeJob, check_workers, probe, rounding_here, versions_here

SECONDS = 60


@contextmanager
def foreign_cluster(folder, **environment):
    """A scheduler here and `dask worker` in a process and a working folder of its own, as on another machine."""
    with distributed.LocalCluster(n_workers=0, host=LOOPBACK, dashboard_address=f"{LOOPBACK}:0",
                                  silence_logs=50) as cluster:
        command = [sys.executable, "-m", "dask", "worker", cluster.scheduler_address, "--host", LOOPBACK, "--nthreads",
                   "1",
                   "--no-dashboard", "--local-directory", str(folder)]
        worker = subprocess.Popen(command, env={**os.environ, **ONE_THREAD, **environment}, cwd=folder,
                                  stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            with distributed.Client(cluster, set_as_default=False) as client:
                client.wait_for_workers(1, timeout=SECONDS)
                yield client
        finally:
            worker.terminate()
            worker.wait(SECONDS)


@pytest.fixture(scope="module")
def client(tmp_path_factory):
    with foreign_cluster(tmp_path_factory.mktemp("worker")) as client:
        yield client


@pytest.fixture
def experiment(tmp_path):
    folder = write_experiment(tmp_path / "test")
    return ExperimentToSee(str(folder), {}, load_experiment(folder).recording.identity)


def test_a_worker_that_shares_everything_passes_and_nothing_is_left(client, experiment, tmp_path):
    said, before = [], sorted(tmp_path.iterdir())
    check_workers(client, [experiment], tmp_path / "runs" / "first", said.append)
    assert said == []  # the same machine rounds the same way
    assert sorted(tmp_path.iterdir()) == before


def test_a_worker_that_reads_another_experiment_is_named_before_anything_is_written(client, tmp_path):
    """The driver has read the experiment; then the worker finds another one at its path."""
    folder = write_experiment(tmp_path / "test")
    read = ExperimentToSee(str(folder), {}, load_experiment(folder).recording.identity)
    toml = folder / "experiment.toml"
    toml.write_text(toml.read_text().replace("thickness_mm = 2.0", "thickness_mm = 2.5"))
    with pytest.raises(InputError) as refused:
        check_workers(client, [read], tmp_path / "run")
    message = str(refused.value)
    assert "another experiment at this path" in message and f"tcp://{LOOPBACK}" in message
    assert not (tmp_path / "run").exists()


def test_a_worker_without_the_experiment_is_told_where_to_put_it(client, experiment, tmp_path):
    missing = ExperimentToSee(str(tmp_path / "elsewhere"), {}, experiment.identity)
    with pytest.raises(InputError, match="mount at the same path"):
        check_workers(client, [missing], tmp_path / "run")


def test_a_worker_with_another_disk_does_not_pass(tmp_path):
    """On its disk, the file of the driver is not there, or holds something else."""
    other = tmp_path / "token"
    assert "another folder or none" in probe(ProbeJob((), str(other), "expected")).problem[1]
    other.write_text("something else")
    assert "something else" in probe(ProbeJob((), str(other), "expected")).problem[1]
    other.write_text("expected")
    assert probe(ProbeJob((), str(other), "expected")).problem == ()


def test_a_worker_with_another_package_is_refused_by_name_and_version(tmp_path):
    stale = tmp_path / "site" / "zarr-0.0.1.dist-info"
    stale.mkdir(parents=True)
    (stale / "METADATA").write_text("Metadata-Version: 2.1\nName: zarr\nVersion: 0.0.1\n")
    path = os.pathsep.join([str(stale.parent), *filter(None, [os.environ.get("PYTHONPATH")])])
    with foreign_cluster(tmp_path, PYTHONPATH=path) as client, pytest.raises(InputError) as refused:
        check_workers(client, [], tmp_path / "run")
    assert f"zarr {dict(versions_here())['zarr']}, as here" in str(refused.value)
    assert "zarr 0.0.1" in str(refused.value)


def test_other_rounding_is_a_note_and_no_refusal(client, tmp_path, monkeypatch):
    """The driver is made to round differently; the worker is a process of its own and does not."""
    kernel = rounding_here()
    assert kernel == rounding_here()
    monkeypatch.setattr(probing, "rounding_here", lambda: "0" * 64)
    said = []
    check_workers(client, [], tmp_path / "run", said.append)
    assert len(said) == 1 and "last digits" in said[0]


def test_a_relative_path_reaches_a_worker_in_another_folder(client, tmp_path, monkeypatch):
    """Before, the worker looked for it in its own working folder."""
    write_experiment(tmp_path / "test")
    monkeypatch.chdir(tmp_path)
    result = identify_run(["test"], "run", workplace=Workplace(scheduler=client.scheduler.address),
                          overrides={"options.max_iterations": 1})
    assert result["forward_runs"] >= 1 and (tmp_path / "run" / "result.json").exists()


def test_no_scheduler_needs_no_answer(tmp_path):
    check_scheduler(None, tmp_path / "run")
