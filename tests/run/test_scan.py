"""The integrity scan of a RUN that is resumed: the same groups are found by one process and by jobs of whole chunks."""

import numpy as np
import pytest

from idic.run.recovery import scan
from idic.run.recovery.scan import damaged_groups, is_whole
from idic.run import FrameArrays, RunStore, SerialRunner, write_array


class TwoWorkers(SerialRunner):
    """Says that it has two workers, and keeps the jobs."""

    workers = 2

    def __init__(self):
        self.jobs = []

    def stream(self, function, jobs, names, *further, **options):
        self.jobs = list(jobs)
        assert len(set(names)) == len(jobs)
        return super().stream(function, jobs, names, *further, **options)


class Images:
    """A stack of 5 frames of 10 x 20 px."""

    n_frames, shape = 5, (10, 20)

    def frame(self, k):
        return np.full(self.shape, k, dtype=np.uint8)


@pytest.fixture
def store(tmp_path):
    store = RunStore(tmp_path / "run")
    with store.claim("identity"):
        for name in ("whole", "flipped", "short"):
            with store.building(name) as folder:
                FrameArrays.create(folder, "u", 7, (3, 2), 2).write(0, np.ones((7, 3, 2)))
                write_array(folder, "phi", np.array(2.0))  # without frames
        store.ingest(Images())
    chunk = store.path / "flipped/u/c/3/0/0"  # the last one
    chunk.write_bytes(chunk.read_bytes()[:-1] + b"\0")
    (store.path / "short/u/c/1/0/0").unlink()
    return store


NAMES = ["whole", "flipped", "short", "absent"]


def test_workers_find_what_one_process_finds(store, monkeypatch):
    assert damaged_groups(store, NAMES, ["images"], SerialRunner()) == {"flipped", "short", "absent"}
    monkeypatch.setattr(scan, "BYTES_FOR_WORKERS", 0)
    monkeypatch.setattr(scan, "BYTES_OF_A_JOB", 2 * 2 * 48)  # two chunks of u
    runner = TwoWorkers()
    assert damaged_groups(store, NAMES, ["images"], runner) == {"flipped", "short", "absent"}
    spans = [(job.first, job.stop) for job in runner.jobs if (job.name, job.array) == ("whole", "u")]
    assert spans == [(0, 4), (4, 7)]
    assert [is_whole(job) for job in runner.jobs if job.name == "flipped" and job.array == "u"] == [True, False]


def test_little_is_read_here_and_so_is_what_workers_do_not_see(store, monkeypatch):
    runner = TwoWorkers()
    damaged_groups(store, NAMES, ["images"], runner)
    assert not runner.jobs
    monkeypatch.setattr(scan, "BYTES_FOR_WORKERS", 0)
    runner.sees_files = False
    assert damaged_groups(store, NAMES, ["images"], runner) == {"flipped", "short", "absent"} and not runner.jobs


def test_an_altered_image_is_found(store):
    chunk = next(path for path in (store.path / "images/frames/c").rglob("*") if path.is_file())
    chunk.write_bytes(b"\1" + chunk.read_bytes()[1:])
    assert damaged_groups(store, [], ["images"], SerialRunner()) == {"images"}
