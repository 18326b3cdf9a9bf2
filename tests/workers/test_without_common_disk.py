"""Workers that see neither the RUN nor the experiment: files go through an object storage or the driver; the same
bits."""

import json
import os
import sys
from contextlib import contextmanager

import numpy as np
import pytest
from experiment_file.small_experiment import write_experiment
from external.strip import write_strip
from test_probe import foreign_cluster
from typer.testing import CliRunner

from idic.cli.app import app
from idic.errors import InputError
from idic.experiment_file import inputs_of
from idic.run import Console, FrameArrays, RunStore, Workplace, identify_run, read_array, write_array
from idic.run.store.mirror.adopt import adopt
from idic.run.store.mirror.manifest import Entry, Scanner, decoded, digest_of, encoded, run_files
from idic.run.store.mirror.mirror import Mirror
from idic.run.store.mirror.objects import StoredObjects
from idic.run.workers.mirrored_runner import checked_store, relocated
from idic.run.workers.probe import ExperimentToSee

SHORT = {"options.max_iterations": 3}
HERE = os.path.dirname(__file__)
SECRETS = {"AWS_ACCESS_KEY_ID": "testing", "AWS_SECRET_ACCESS_KEY": "testing", "AWS_DEFAULT_REGION": "us-east-1"}


@contextmanager
def blind_cluster(folder, *unseen, **environment):
    """A worker that sees nothing below the folders `unseen`; what it tried is in ``folder/tried``."""
    folder.mkdir()
    environment |= {"BLIND_TO": os.pathsep.join(map(str, unseen)), "BLIND_LOG": str(folder / "tried"),
                    "PYTHONPATH": os.pathsep.join([HERE, *filter(None, [os.environ.get("PYTHONPATH")])]),
                    "DASK_DISTRIBUTED__WORKER__PRELOAD": "['blind_worker']"}
    with foreign_cluster(folder, **environment) as client:
        yield client


@pytest.fixture(scope="module")
def strip(tmp_path_factory):
    """An experiment and its RUN on this machine alone; three iterations see every kind of task."""
    folder = tmp_path_factory.mktemp("mine")
    write_experiment(folder / "test")
    return folder, identify_run([folder / "test"], folder / "alone", overrides=SHORT)


def contents(run):
    """The arrays of a RUN by group, in bits."""
    found = {}
    for path in sorted((run / "run.zarr").rglob("zarr.json")):
        described = json.loads(path.read_text())
        if described["node_type"] == "array":
            found[str(path.parent.relative_to(run))] = read_array(path.parent.parent, path.parent.name).tobytes()
    return found


def assert_same(result, run, alone_result, alone):
    assert result["parameters"] == alone_result["parameters"]
    assert contents(run) == contents(alone)


def test_the_driver_serves_a_worker_that_sees_neither_run_nor_experiment(strip, tmp_path):
    folder, alone = strip
    with blind_cluster(tmp_path / "worker", folder) as client:
        run = folder / "served"
        workplace = Workplace(scheduler=client.scheduler.address, store="driver")
        result = identify_run([folder / "test"], run, workplace=workplace, overrides=SHORT)
        assert not (tmp_path / "worker" / "tried").exists()
        assert_same(result, run, alone, folder / "alone")
        assert not list((tmp_path / "worker").rglob("*.tif")), "the folders of the worker are deleted at the end"
        with pytest.raises(InputError, match="--store URL"):  # without a store, this worker is refused
            identify_run([folder / "test"], folder / "refused", overrides=SHORT,
                         workplace=Workplace(scheduler=client.scheduler.address))
    assert (tmp_path / "worker" / "tried").exists() and not (folder / "refused").exists()


@pytest.fixture(scope="module")
def s3():
    """The address of an S3 server on the loopback interface with a bucket, and the file system of a client."""
    server = pytest.importorskip("moto.server",
                                 reason="needs moto[s3], flask and flask-cors (pip install 'idic[test-s3]')")
    pytest.importorskip("s3fs", reason="needs s3fs (pip install 'idic[test-s3]')")
    import logging

    import fsspec

    logging.getLogger("werkzeug").setLevel(logging.ERROR)
    running = server.ThreadedMotoServer("127.0.0.1", 0, verbose=False)
    running.start()
    host, port = running.get_host_and_port()
    with pytest.MonkeyPatch.context() as patch:
        for name, value in (SECRETS | {"AWS_ENDPOINT_URL": f"http://{host}:{port}"}).items():
            patch.setenv(name, value)
        files = fsspec.filesystem("s3")
        files.mkdir("idic-test")
        yield files
    running.stop()


@pytest.mark.slow
def test_an_object_storage_gives_the_same_bits_and_a_damaged_object_is_not_used(strip, s3, tmp_path):
    folder, alone = strip
    url, run = "s3://idic-test/runs", folder / "stored"
    with blind_cluster(tmp_path / "worker", folder) as client:
        address = client.scheduler.address

        def stop_at_the_second(state):
            if state.evaluations == 2:
                raise KeyboardInterrupt

        workplace = Workplace(scheduler=address, store=url)
        with pytest.raises(KeyboardInterrupt):
            identify_run([folder / "test"], run, workplace=workplace, overrides=SHORT,
                         console=Console(iteration=stop_at_the_second))
        frames = sorted((run / "run.zarr" / "images" / "frames" / "c").rglob("0"))[0]
        while frames.is_dir():
            frames = next(frames.iterdir())
        stored = s3.find("idic-test/runs")
        name = digest_of(frames.read_bytes())
        (images,) = [path for path in stored if path.endswith(name)]  # ingested once
        good = s3.cat_file(images)
        s3.pipe_file(images, good[:-1] + bytes([good[-1] ^ 1]))
        with pytest.raises(InputError) as refused:
            identify_run([folder / "test"], run, resume=True, workplace=workplace, overrides=SHORT)
        assert "damaged" in str(refused.value) and f"the worker {next(iter(client.nthreads()))}" in str(refused.value)
        result = identify_run([folder / "test"], run, resume=True, workplace=workplace, overrides=SHORT)
        assert s3.cat_file(images) == good
    assert not (tmp_path / "worker" / "tried").exists()
    assert_same(result, run, alone, folder / "alone")


@pytest.mark.slow
@pytest.mark.parametrize("store", ["driver", "s3://idic-test/joint"])
def test_a_joint_run_through_a_store_has_the_bits_of_one_on_this_machine(store, tmp_path, request):
    if store != "driver":
        request.getfixturevalue("s3")
    folder = tmp_path / "mine"
    tests = [folder / "first", folder / "second"]
    for test in tests:
        write_experiment(test)
    alone = identify_run(tests, folder / "alone", overrides=SHORT)
    with blind_cluster(tmp_path / "worker", folder) as client:
        workplace = Workplace(scheduler=client.scheduler.address, store=store)
        result = identify_run(tests, folder / "stored", workplace=workplace, overrides=SHORT)
    assert not (tmp_path / "worker" / "tried").exists()
    assert result["parameters"] == alone["parameters"]
    runs = sorted(path.parent.relative_to(folder / "alone") for path in (folder / "alone").rglob("run.zarr"))
    assert len(runs) >= len(tests)
    for run in runs:
        assert contents(folder / "stored" / run) == contents(folder / "alone" / run)


@pytest.mark.slow
def test_the_files_of_an_external_solver_travel_and_its_program_is_asked_for_on_every_worker(tmp_path, monkeypatch):
    """The program is Python and one of the files a Python file; the worker must have been given the permission."""
    folder = tmp_path / "mine"
    write_strip(folder / "test", "timeout_s = 30")
    monkeypatch.delenv("IDIC_ALLOW_EXTERNAL", raising=False)
    with blind_cluster(tmp_path / "forbidden", folder) as client:
        monkeypatch.setenv("IDIC_ALLOW_EXTERNAL", sys.executable)
        with pytest.raises(InputError) as refused:
            identify_run([folder / "test"], folder / "never", overrides=SHORT,
                         workplace=Workplace(scheduler=client.scheduler.address, store="driver"))
        assert "permission to run" in str(refused.value) and "the worker tcp://" in str(refused.value)
        assert "on the workers of a cluster" in str(refused.value) and not (folder / "never").exists()
    alone = identify_run([folder / "test"], folder / "alone", overrides=SHORT)
    with blind_cluster(tmp_path / "worker", folder) as client:
        workplace = Workplace(scheduler=client.scheduler.address, store="driver")
        result = identify_run([folder / "test"], folder / "served", workplace=workplace, overrides=SHORT)
    assert not (tmp_path / "worker" / "tried").exists()
    assert_same(result, folder / "served", alone, folder / "alone")


@pytest.mark.slow
def test_a_store_that_a_worker_cannot_reach_is_refused_with_the_worker_and_nothing_is_written(strip, s3, tmp_path):
    folder, _ = strip
    with blind_cluster(tmp_path / "worker", folder, AWS_ENDPOINT_URL="http://127.0.0.1:9") as client:
        with pytest.raises(InputError) as refused:
            identify_run([folder / "test"], folder / "never",
                         workplace=Workplace(scheduler=client.scheduler.address, store="s3://idic-test/x"))
        assert f"the worker {next(iter(client.nthreads()))}" in str(refused.value)
        assert "credentials" in str(refused.value)
    assert not (folder / "never").exists()


# the parts ----------------------------------------------------------------------------------------
class Held(dict):
    """Objects in memory, by their digests."""

    def get(self, sha256):
        return self[sha256]

    def put(self, contents):
        self.update({digest_of(content): content for content in contents})
        return [digest_of(content) for content in contents]


@pytest.fixture
def served(tmp_path):
    """A RUN with a group, and a mirror of it that reads from memory."""
    store = RunStore(tmp_path / "run")
    with store.claim("identity"):
        with store.building("images") as folder:
            FrameArrays.create(folder, "frames", 4, (40, 40), 2).write(0, np.arange(6400.0).reshape(4, 40, 40))
    objects, scanner = Held(), Scanner()

    def listed():
        entries = {f"run/{os.path.relpath(path, store.run)}": scanner.entry(path) for path in run_files(store.run)}
        objects.put([open(path, "rb").read() for path in run_files(store.run)])
        return tuple(objects.put([encoded(entries)]))

    mirror = Mirror(tmp_path / "mirror", objects, {str(store.run): "run"}, "the worker")
    yield store, mirror, objects, listed
    mirror.drop()


def test_a_mirror_brings_chunks_when_they_are_read(served):
    store, mirror, _, listed = served
    mirror.follow(listed())
    here = RunStore(relocated(str(store.run), mirror.moved))
    chunks_folder = here.path / "images/frames/c"
    chunks = lambda: len(list(chunks_folder.rglob("0/0"))) if chunks_folder.exists() else 0  # noqa: E731
    assert chunks() == 0
    group = here.described("images")
    np.testing.assert_array_equal(FrameArrays.open(group, "frames").read(2, 3),
                                  np.arange(3200.0, 4800.0).reshape(1, 40, 40))
    assert chunks() == 1
    assert here.finished("images") is not None  # asks for all chunks
    assert not mirror.written().files


def test_what_a_task_makes_is_a_whole_group_and_gone_from_the_mirror_until_the_driver_lists_it(served, tmp_path):
    store, mirror, objects, listed = served
    lists = listed()
    mirror.follow(lists)
    here = RunStore(relocated(str(store.run), mirror.moved))
    values = np.random.default_rng(0).normal(size=(30, 40))
    with here.building("prepared") as folder:
        write_array(folder, "local", values)
    made = mirror.written()
    assert {key.partition("prepared/")[2] for key in made.files} == {"zarr.json", "local/zarr.json", "local/c/0/0"}
    mirror.follow(lists)
    assert here.described("prepared") is None
    files = {key.removeprefix("run/"): entry for key, entry in made.files.items()}
    scanner = Scanner()
    adopt(store.run, files, lambda entry: entry.content or objects[entry.sha256], scanner)
    np.testing.assert_array_equal(read_array(store.group("prepared"), "local"), values)
    fetched = len(objects)
    mirror.follow(listed())
    objects.pop(made.files["run/run.zarr/prepared/local/c/0/0"].sha256)  # the mirror has kept it
    np.testing.assert_array_equal(read_array(here.group("prepared"), "local"), values)
    assert fetched < len(objects) + 2


def test_a_replaced_group_is_replaced_in_the_mirror(served):
    store, mirror, _, listed = served
    mirror.follow(listed())
    here = RunStore(relocated(str(store.run), mirror.moved))
    FrameArrays.open(here.group("images"), "frames").read()
    with store.building("images") as folder:
        write_array(folder, "other", np.zeros(1000))
    mirror.follow(listed())
    assert sorted(path.name for path in here.group("images").iterdir()) == ["other", "zarr.json"]
    np.testing.assert_array_equal(read_array(here.group("images"), "other"), np.zeros(1000))


def test_a_worker_writes_nowhere_but_into_the_run(tmp_path):
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "link").symlink_to(tmp_path)
    for path in ("../outside", "link/outside", str(tmp_path / "outside")):
        with pytest.raises(InputError, match="outside of the RUN"):
            adopt(tmp_path / "run", {path: Entry(1, digest_of(b"1"), b"1")}, lambda entry: entry.content, Scanner())
    assert not (tmp_path / "outside").exists()


def test_paths_of_a_job_are_moved_wherever_they_stand(tmp_path):
    stack = ExperimentToSee("/data/test", {"a": "/data/testing"}, "/data/run/run.zarr")
    moved = relocated((stack, ["/data/run"], {"k": "/data/test/x"}, 3),
                      {"/data/test": "/here/t", "/data/run": "/here/r"})
    assert moved == (ExperimentToSee("/here/t", {"a": "/data/testing"}, "/here/r/run.zarr"), ["/here/r"],
                     {"k": "/here/t/x"}, 3)


def test_images_that_the_run_holds_are_described_and_not_sent(tmp_path):
    found = inputs_of(write_experiment(tmp_path / "test"), {})
    assert [path.name for path in found.images] == ["frame_001.tif", "frame_002.tif", "frame_003.tif"]
    assert [path.name for path in found.read_files] == ["experiment.toml", "loads.csv", "mesh.inp", "frame_000.tif"]
    entry = {"a": Entry(7, image=next(iter(found.images.values())))}
    assert decoded(encoded(entry))["a"].image.ends_sha256 == entry["a"].image.ends_sha256


def test_python_files_of_an_external_solver_are_sent(tmp_path):
    found = inputs_of(write_strip(tmp_path / "strip"), {})
    names = {path.name for path in found.read_files}
    assert {"strip.deck.template", "nodes.txt", "strange_solver.py"} < names


def test_a_store_needs_a_scheduler_and_a_file_system_that_is_installed(tmp_path):
    with pytest.raises(InputError, match="no cluster"):
        checked_store("s3://bucket", None)
    assert checked_store(None, None) is None
    with pytest.raises(InputError, match="cannot be opened"):
        StoredObjects("nowhere://bucket", "the driver")


def test_a_store_in_a_folder_keeps_what_it_was_given(tmp_path):
    objects = StoredObjects(f"file://{tmp_path}/store", "the driver")
    names = objects.put([b"one", b"two"])
    assert [objects.get(name) for name in names] == [b"one", b"two"] and objects.sizes() == {names[0]: 3, names[1]: 3}
    (file,) = (tmp_path / "store").rglob(names[0])
    file.write_bytes(b"on")  # half written
    with pytest.raises(InputError, match="missing or damaged"):
        objects.get(names[0])
    assert not file.exists()
    objects.delete(names)
    assert objects.sizes() == {}


@pytest.mark.parametrize("command", [["batch", "test", "--out", "b"], ["demo", "--out", "d"],
                                     ["study", "coverage", "--out", "s"], ["trial", "--out", "t"]],
                         ids=lambda command: command[0])
def test_commands_that_send_no_files_refuse_a_store_and_say_what_takes_one(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("IDIC_STORE", "s3://bucket")
    said = CliRunner().invoke(app, [*command, "--scheduler", "tcp://127.0.0.1:1"])
    assert said.exit_code == 2 and f"idic {command[0]} does not send files to its workers" in said.output
    assert "idic identify" in said.output and not list(tmp_path.iterdir())
