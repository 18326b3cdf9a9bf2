"""The RUN folder: whole or not at all, damage never silent, one process at a time."""

import json
import os
import shutil
import signal
import subprocess
import sys
import textwrap
from contextlib import suppress

import numpy as np
import pytest

from idic.errors import InputError
from idic.images import ArrayStack, Stack
from idic.run.store.arrays import Damaged, open_array
from idic.run import FrameArrays, RunStore, ZarrStack, read_array, write_array
from idic.run.store.run_lock import LOCK_NAME


@pytest.fixture
def store(tmp_path):
    with RunStore(tmp_path / "run").claim("experiment-1", title="a test") as store:
        yield store


def images(n=20, shape=(11, 13), dtype="u2", seed=1):
    return np.random.default_rng(seed).integers(0, 200, (n, *shape)).astype(dtype)


def run_python(code, *arguments, **options):
    command = [sys.executable, "-c", textwrap.dedent(code), *map(str, arguments)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **options)


def test_an_array_is_opened_once_until_another_lies_in_its_place(tmp_path):
    write_array(tmp_path, "M", np.eye(2))
    first = open_array(tmp_path, "M")
    assert open_array(tmp_path, "M") is first
    shutil.rmtree(tmp_path / "M")
    with pytest.raises(Damaged):
        open_array(tmp_path, "M")
    write_array(tmp_path, "M", np.arange(3.0))
    assert np.array_equal(read_array(tmp_path, "M"), [0.0, 1.0, 2.0])
    description = tmp_path / "M" / "zarr.json"
    description.write_text(description.read_text().replace("float64", "foreign"))
    with pytest.raises(Damaged):
        open_array(tmp_path, "M")


# frame arrays -------------------------------------------------------------------------------------
def test_frame_arrays_come_back_bit_for_bit(store):
    u = np.random.default_rng(0).normal(size=(10, 7, 3))
    with store.building("it000/forward", {"theta": ["0x1p+0"]}) as group:
        array = FrameArrays.create(group, "u", 10, (7, 3), frames_per_chunk=4)
        for first, last in array.chunks():
            array.write(first, u[first:last])
    array = FrameArrays.open(store.group("it000/forward"), "u")
    assert np.array_equal(array.read(), u)
    assert np.array_equal(array.read(3, 9), u[3:9])
    assert array.chunks() == [(0, 4), (4, 8), (8, 10)]


def test_a_writer_appends_frame_by_frame_with_one_chunk_in_memory(store):
    u = np.arange(10 * 2.0).reshape(10, 2)
    with store.building("a") as group, FrameArrays.create(group, "u", 10, (2,), 4).writer() as writer:
        for record in u:
            writer.append(record)
    assert np.array_equal(FrameArrays.open(store.group("a"), "u").read(), u)


def test_records_that_are_all_zero_are_stored_like_any_other(store):
    with store.building("a") as group:
        FrameArrays.create(group, "u", 4, (2,), 2, dtype="u1").write(0, np.zeros((4, 2), "u1"))
    assert not FrameArrays.open(store.group("a"), "u").read().any()


def test_an_array_without_records_of_any_size_is_fine(store):
    with store.building("a") as group:
        FrameArrays.create(group, "du", 4, (5, 2, 0), 2).write(0, np.zeros((4, 5, 2, 0)))
    assert FrameArrays.open(store.group("a"), "du").read(1, 3).shape == (2, 5, 2, 0)


def test_a_block_that_cuts_a_chunk_is_refused(store):
    with pytest.raises(ValueError, match="whole chunks"), store.building("a") as group:
        FrameArrays.create(group, "u", 10, (2,), 4).write(2, np.zeros((4, 2)))


def test_small_arrays_keep_type_shape_and_bits(store):
    values = {"M": np.random.default_rng(0).normal(size=(3, 3)), "n": np.array(7), "empty": np.zeros((0, 3))}
    with store.building("a") as group:
        for name, value in values.items():
            write_array(group, name, value)
    for name, value in values.items():
        back = read_array(store.group("a"), name)
        assert back.dtype == value.dtype and np.array_equal(back, value)


@pytest.mark.parametrize("damage", ["missing", "truncated", "flipped", "emptied"])
def test_damage_to_a_chunk_is_never_read_as_data(store, damage):
    with store.building("a") as group:
        FrameArrays.create(group, "u", 6, (50,), 2).write(0, np.ones((6, 50)))
    chunk = store.path / "a" / "u" / "c" / "1" / "0"
    content = bytearray(chunk.read_bytes())
    content[20] ^= 1
    {"missing": chunk.unlink, "truncated": lambda: os.truncate(chunk, 40), "emptied": lambda: os.truncate(chunk, 0),
     "flipped": lambda: chunk.write_bytes(content)}[damage]()  # fmt: skip
    array = FrameArrays.open(store.path / "a", "u")
    assert np.array_equal(array.read(0, 2), np.ones((2, 50)))  # the sound part stays readable
    with pytest.raises(Damaged, match="missing or damaged"):
        array.read()


def test_what_a_finished_run_keeps_is_compressed_with_the_same_bits(store):
    u = np.sin(0.01 * np.arange(9600)).reshape(6, 800, 2)
    with store.building("a", {"x": 1}) as group:
        FrameArrays.create(group, "u", 6, (800, 2), 2).write(0, u)
        FrameArrays.create(group, "local_du", 6, (800, 2), 2).write(0, u)
        write_array(group, "steps", np.arange(6))
    before = sum(file.stat().st_size for file in (store.path / "a" / "u").rglob("*") if file.is_file())
    folder = store.thin("a", {"u": None, "steps": None})
    back = FrameArrays.open(folder, "u")
    assert np.array_equal(back.read(), u) and back.frames_per_chunk == 2 and store.finished("a", {"x": 1}) == folder
    assert sum(file.stat().st_size for file in (folder / "u").rglob("*") if file.is_file()) < 0.9 * before
    assert not (folder / "local_du").exists() and np.array_equal(read_array(folder, "steps"), np.arange(6))
    stamp = (folder / "zarr.json").stat().st_mtime_ns
    again = store.thin("a", {"u": None, "steps": None})
    assert again.joinpath("zarr.json").stat().st_mtime_ns == stamp  # it gets no smaller


def test_digits_that_a_finished_run_does_not_need_go(store):
    u = np.random.default_rng(1).standard_normal((6, 800, 2))
    u[0, 3], u[1, 4] = np.nan, 0.0
    with store.building("a") as group:
        FrameArrays.create(group, "u", 6, (800, 2), 2).write(0, u)
    folder = store.thin("a", {"u": 20})
    np.testing.assert_allclose(FrameArrays.open(folder, "u").read(), u, rtol=2.0**-20, atol=0.0)
    assert sum(file.stat().st_size for file in (folder / "u").rglob("*") if file.is_file()) < 0.5 * u.nbytes
    stamp = (folder / "zarr.json").stat().st_mtime_ns
    assert store.thin("a", {"u": 20}).joinpath("zarr.json").stat().st_mtime_ns == stamp  # cut once


def test_a_damaged_array_is_kept_as_it_is_and_still_found_damaged(store):
    with store.building("a") as group:
        FrameArrays.create(group, "u", 6, (800, 2), 2).write(0, np.ones((6, 800, 2)))
    chunk = store.path / "a" / "u" / "c" / "1" / "0" / "0"
    content = bytearray(chunk.read_bytes())
    content[20] ^= 1
    chunk.write_bytes(content)
    with pytest.raises(Damaged, match="missing or damaged"):
        FrameArrays.open(store.thin("a", {"u": None}), "u").read()


# groups -------------------------------------------------------------------------------------------
def test_a_group_that_fails_leaves_nothing_behind(store):
    with pytest.raises(ZeroDivisionError), store.building("it001/a") as group:
        FrameArrays.create(group, "u", 2, (2,)).write(0, np.zeros((2, 2)))
        raise ZeroDivisionError
    assert store.finished("it001/a") is None
    assert [p.name for p in (store.path / "it001").iterdir()] == ["zarr.json"]


def test_an_incomplete_group_is_not_accepted(store):
    with pytest.raises(RuntimeError, match=": .*incomplete"), store.building("a") as group:
        FrameArrays.create(group, "u", 4, (2,), 2).write(0, np.zeros((2, 2)))
    assert store.finished("a") is None


def test_a_group_counts_as_finished_only_for_its_own_inputs(store):
    ident = {"iteration": 3, "theta": ("0x1.8p+1",)}
    with store.building("a", ident):
        pass
    assert store.finished("a", ident) is not None
    assert store.finished("a", {**ident, "iteration": 4}) is None


def test_a_group_with_a_deleted_chunk_is_not_finished(store):
    with store.building("a") as group:
        FrameArrays.create(group, "u", 4, (2,), 2).write(0, np.zeros((4, 2)))
    (store.path / "a" / "u" / "c" / "0" / "0").unlink()
    assert store.finished("a") is None
    with pytest.raises(Damaged):
        store.group("a")


@pytest.mark.parametrize("place", ["zarr.json", "u/zarr.json", "u/c", "u/c/0", "u/c/0/0"])
@pytest.mark.parametrize("kind", ["folder", "file", "brackets"])
def test_a_group_with_something_else_in_the_place_of_a_file_is_not_finished(store, place, kind):
    with store.building("a") as group:
        FrameArrays.create(group, "u", 4, (2,), 2).write(0, np.ones((4, 2)))
    path = store.path / "a" / place
    if path.is_dir():
        shutil.rmtree(path)
    else:
        path.unlink()
    path.mkdir() if kind == "folder" else path.write_text("x" if kind == "file" else "[" * 200_000)
    try:
        array = FrameArrays.open(store.group("a"), "u").read()
    except Damaged:
        return
    assert np.array_equal(array, np.ones((4, 2)))


def test_a_group_may_be_replaced(store):
    for value in (1.0, 2.0):
        with store.building("a") as group:
            write_array(group, "M", np.array([value]))
    assert read_array(store.group("a"), "M") == [2.0]


def test_temporary_files_of_a_killed_process_are_removed_by_the_next_one(tmp_path):
    store = RunStore(tmp_path / "run")
    with store.claim("x"):
        (store.path / "it000" / ".a.0123.tmp" / "u").mkdir(parents=True)
    with store.claim("x"):
        assert not list(store.path.rglob("*.tmp"))


# images -------------------------------------------------------------------------------------------
@pytest.mark.parametrize("n, shape, per_chunk", [(20, (11, 13), 10), (3, (600, 900), 1)])
def test_images_come_back_bit_for_bit(store, n, shape, per_chunk):
    frames, seen = images(n, shape, "u1"), []
    stack = store.ingest(ArrayStack(frames), progress=lambda done, total: seen.append((done, total)))
    assert isinstance(stack, Stack) and (stack.n_frames, stack.shape) == (n, shape)
    assert stack.frames_per_chunk == per_chunk and seen[-1] == (n, n)
    assert all(np.array_equal(stack.frame(k), frames[k]) for k in (n - 1, 0, 1))


def test_height_maps_may_hold_nan_and_black_frames_are_frames(store):
    heights = images(3).astype("f4")
    heights[1, 2, 3] = np.nan
    heights[2] = 0.0
    stack = store.ingest(ArrayStack(heights))
    assert all(np.array_equal(stack.frame(k), heights[k], equal_nan=True) for k in range(3))


def test_a_stack_travels_to_another_process(store):
    import pickle

    stack = store.ingest(ArrayStack(images()))
    assert np.array_equal(pickle.loads(pickle.dumps(stack)).frame(3), images()[3])


def test_a_whole_copy_of_the_same_source_is_used_again(store):
    class Counting(ArrayStack):
        read = 0

        def frame(self, k):
            Counting.read += 1
            return super().frame(k)

    store.ingest(Counting(images()), source="s1")
    before = Counting.read
    store.ingest(Counting(images()), source="s1")
    assert Counting.read == before + 1  # the first frame, for its size and type
    store.ingest(Counting(images(seed=2)), source="s2")
    assert np.array_equal(ZarrStack(store.group("images")).frame(0), images(seed=2)[0])


def test_an_altered_frame_is_noticed(store):
    stack = store.ingest(ArrayStack(images(40)))
    (store.path / "images" / "frames" / "c" / "1" / "0" / "0").unlink()
    assert np.array_equal(stack.frame(0), images(40)[0])
    with pytest.raises(Damaged):
        stack.frame(16)


def test_images_of_different_size_are_refused_and_nothing_stays(store):
    class Odd(ArrayStack):
        def frame(self, k):
            return super().frame(k)[: 5 if k == 7 else None]

    with pytest.raises(InputError, match="frame 7"):
        store.ingest(Odd(images()))
    assert store.finished("images") is None and not list(store.path.rglob("*.tmp"))


def test_a_kill_during_ingest_leaves_no_half_stack(tmp_path):
    code = """
        import sys, os, signal, numpy as np
        from idic.run.store.run_store import RunStore
        from idic.images.stack import ArrayStack
        def progress(done, total):
            if done >= 32: os.kill(os.getpid(), signal.SIGKILL)
        with RunStore(sys.argv[1]).claim("x") as store:
            store.ingest(ArrayStack(np.ones((64, 9, 9), "u1")), progress)
    """
    process = run_python(code, tmp_path / "run")
    process.communicate(timeout=60)
    assert process.returncode == -signal.SIGKILL
    with RunStore(tmp_path / "run").claim("x") as store:  # the lock of the dead is taken over
        assert store.finished("images") is None
        assert store.ingest(ArrayStack(np.ones((64, 9, 9), "u1"))).n_frames == 64


# who may use the folder ---------------------------------------------------------------------------
def test_the_run_of_another_experiment_is_refused(tmp_path):
    with RunStore(tmp_path / "run").claim("one", title="first"):
        pass
    with pytest.raises(InputError, match="another experiment"), RunStore(tmp_path / "run").claim("two"):
        pass
    assert RunStore(tmp_path / "run").identity() == "one"


def test_a_folder_with_other_things_in_it_is_refused(tmp_path):
    (tmp_path / "experiment.toml").write_text("")
    with pytest.raises(InputError, match="in use for something else"), RunStore(tmp_path).claim("one"):
        pass
    assert not (tmp_path / "run.zarr").exists()


def test_a_second_process_is_refused_while_the_first_one_works(tmp_path):
    code = """
        import sys
        from idic.run.store.run_store import RunStore
        with RunStore(sys.argv[1]).claim("x"):
            print("locked", flush=True)
            sys.stdin.read()
    """
    process = run_python(code, tmp_path / "run", stdin=subprocess.PIPE)
    try:
        assert process.stdout.readline() == "locked\n"
        with pytest.raises(InputError,
                           match=f"process {process.pid}") as refusal, RunStore(tmp_path / "run").claim("x"):
            pass
        assert "wait for it" in str(refusal.value)
    finally:
        process.kill()
        process.communicate()
    with RunStore(tmp_path / "run").claim("x"):
        holder = json.loads((tmp_path / "run" / LOCK_NAME).read_text())
        assert holder["pid"] == os.getpid()


@pytest.mark.parametrize("dtype", [np.uint8, np.float32])
def test_a_chunk_of_nothing_but_the_fill_value_is_written_by_another_process_too(tmp_path, dtype):
    """A black frame, or a residual map without a valid pixel: a chunk that is not there means damage."""
    store = RunStore(tmp_path / "run")
    with store.claim("identity"), store.building("maps") as folder:
        FrameArrays.create(folder, "r", 2, (3, 4), 1, dtype=dtype)
        for k in range(2):
            FrameArrays.open(folder, "r",
                             "r+").write(k, np.full((1, 3, 4), np.nan if dtype is np.float32 else 0, dtype))
    assert not FrameArrays.open(store.group("maps"), "r").missing()


class Killed(BaseException):
    """What ends a process; nothing after it has an effect."""


@pytest.mark.parametrize("renames", range(4))
@pytest.mark.parametrize("killed", [True, False])
def test_a_group_that_is_being_replaced_is_there_afterwards_whenever_the_process_ends(tmp_path, renames, killed):
    def build(value):
        with store.building("evaluations/003/base", {"x": 1}) as group:
            write_array(group, "steps", np.full(3, value))

    store = RunStore(tmp_path / "run")
    with store.claim("id"):
        build(1.0)
    with pytest.MonkeyPatch.context() as patch, suppress(Killed):
        done = []

        def rename(source, target):
            if not str(target).endswith(("zarr.json", ".json")):
                done.append(target)
                if len(done) == renames + 1 or killed and len(done) > renames:
                    raise Killed
            os.replace(source, target)

        patch.setattr("idic.run.store.run_store.replace_file", rename)
        if killed:
            patch.setattr("shutil.rmtree", lambda *_, **__: None)
        build(2.0)
    with store.claim("id"):
        folder = store.finished("evaluations/003/base", {"x": 1})
        assert folder is not None and read_array(folder, "steps")[0] == (1.0 if renames < 2 else 2.0)
        assert sorted(path.name for path in folder.parent.iterdir()) == ["base", "zarr.json"]


def test_a_group_that_was_removed_does_not_come_back_after_a_kill(tmp_path):
    store = RunStore(tmp_path / "run")
    with store.claim("id"):
        with store.building("final") as group:
            write_array(group, "steps", np.arange(3))
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("shutil.rmtree", lambda *_, **__: None)
            store.remove("final")
    with store.claim("id"):
        assert not store.path.joinpath("final").exists()
        assert [path.name for path in store.path.iterdir()] == ["zarr.json"]
